"""The two solvers. They share no code."""

from __future__ import annotations

from typing import Literal

from .text import Malformed

Reply = Literal["unsat", "sat", "unknown"]
SOLVERS = ("z3", "cvc5")


def versions() -> dict[str, str]:
    """Which solvers these are."""
    import cvc5
    import z3

    return {"z3": z3.get_version_string(), "cvc5": cvc5.__version__}


def ask(solver: str, script: str, seconds: int) -> Reply:
    """Whether the assertions of the script can hold together; `unknown` after so many seconds."""
    return _z3(script, seconds) if solver == "z3" else _cvc5(script, seconds)


def _z3(script: str, seconds: int) -> Reply:
    import z3

    # What was asked before moves nothing.
    solving = z3.Solver(ctx=z3.Context())
    solving.set("timeout", seconds * 1000)
    try:
        solving.from_string(script)
    except z3.Z3Exception as why:
        raise Malformed(f"z3 does not understand the formulas: {why}") from None
    return str(solving.check())  # type: ignore[return-value]


def _cvc5(script: str, seconds: int) -> Reply:
    import cvc5

    terms = cvc5.TermManager()
    solving = cvc5.Solver(terms)
    solving.setOption("tlimit-per", str(seconds * 1000))
    if "(forall " in script:
        # Where no term shows how to instantiate a quantifier, it goes through those that there are.
        solving.setOption("enum-inst", "true")
    else:
        # A small world is all truth values: its SAT solver finds the case by itself.
        solving.setOption("decision", "internal")
    symbols = cvc5.SymbolManager(terms)
    parser = cvc5.InputParser(solving, symbols)
    parser.setStringInput(cvc5.InputLanguage.SMT_LIB_2_6, script, "rules")
    try:
        while not (command := parser.nextCommand()).isNull():
            command.invoke(solving, symbols)
    except RuntimeError as why:
        raise Malformed(f"cvc5 does not understand the formulas: {why}") from None
    reply = solving.checkSat()
    return "unsat" if reply.isUnsat() else "sat" if reply.isSat() else "unknown"
