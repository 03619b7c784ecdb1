"""The formulas, evaluated: the text that the solvers are given, in a finite world of plain values.

Each `define-fun` becomes a function of Python. What is declared is looked up: in a state if it is
about one, else in the world.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from .text import Form, Malformed, read

# A function that is declared, by its arguments; what is not there is false or 0.
Facts = dict[tuple[Any, ...], Any]
State = dict[str, Facts]

JOINED = {"and": " and ", "or": " or ", "+": " + "}
COMPARED = {"<": " < ", "<=": " <= ", ">": " > ", ">=": " >= ", "=": " == "}


class World:
    """Members of each sort, and what is declared outside of states; definitions can be called."""

    def __init__(self, script: str, domains: dict[str, Sequence[Any]]) -> None:
        self.facts: dict[str, Facts] = {}
        # What was decided of a state, by the definition and the state's identity, until `forget`.
        self.known: dict[tuple[str, int], Any] = {}
        self.domains = domains
        self._arity: dict[str, int] = {}
        self._literals: set[str] = set()
        self._scope: dict[str, Any] = {"facts": self.facts, "known": self.known}
        for sort, members in domains.items():
            self._scope[f"all_{sort}"] = members
        for form in read(script):
            self._take(form)

    def call(self, name: str, *arguments: Any) -> Any:
        """The value of a definition."""
        return self._function(name)(*arguments)

    def _function(self, name: str) -> Callable[..., Any]:
        function: Callable[..., Any] = self._scope[_identifier(name)]
        return function

    def forget(self) -> None:
        """To be called when the input or a state changes."""
        self.known.clear()

    def _take(self, form: Form) -> None:
        match form:
            case ["declare-datatype", _, constructors]:
                self._literals |= {constructor[0] for constructor in constructors}
            case ["declare-const", name, sort]:
                self._declare(name, [], sort)
            case ["declare-fun", name, sorts, sort]:
                self._declare(name, sorts, sort)
            case ["define-fun", name, parameters, _, body]:
                self._define(name, parameters, body)
            case ["declare-sort", *_] | ["set-logic", *_]:
                pass
            case _:
                raise Malformed(f"nothing is known of {form}")

    def _declare(self, name: str, sorts: Sequence[Form], sort: Form) -> None:
        unset = {"Bool": False, "Int": 0}.get(str(sort))
        if sorts and sorts[0] == "State":
            names = [f"a{index}" for index in range(1, len(sorts))]
            signature, place = ", ".join(["s", *names]), f"s[{name!r}]"
        else:
            names = [f"a{index}" for index in range(len(sorts))]
            signature, place = ", ".join(names), f"facts[{name!r}]"
        key = f"({''.join(f'{one}, ' for one in names)})"
        body = f"return {place}.get({key}, {unset!r})"
        self._compile(name, signature, len(sorts), body)
        if not (sorts and sorts[0] == "State"):
            self.facts[name] = {}

    def _define(self, name: str, parameters: Sequence[Form], body: Form) -> None:
        names = [str(parameter[0]) for parameter in parameters]
        value = self._expression(body, frozenset(names))
        signature = ", ".join(map(_identifier, names))
        if [parameter[1] for parameter in parameters] == ["State"]:
            key = f"key = ({name!r}, id({_identifier(names[0])}))"
            keep = f"if key not in known: known[key] = {value}"
            self._compile(name, signature, 1, f"{key}\n    {keep}\n    return known[key]")
        else:
            self._compile(name, signature, len(names), f"return {value}")

    def _compile(self, name: str, signature: str, arity: int, body: str) -> None:
        self._arity[name] = arity
        exec(f"def {_identifier(name)}({signature}):\n    {body}", self._scope)

    def _expression(self, form: Form, bound: frozenset[str]) -> str:
        if isinstance(form, str):
            return self._atom(form, bound)
        head, parts = form[0], form[1:]
        if head in ("forall", "exists"):
            return self._quantified(str(head), form[1], form[2], bound)
        values = [self._expression(part, bound) for part in parts]
        match head, values:
            case "not", [value]:
                return f"(not {value})"
            case "=>", [given, then]:
                return f"(not {given} or {then})"
            case "xor", [one, other]:
                return f"({one} != {other})"
            case "ite", [condition, then, otherwise]:
                return f"({then} if {condition} else {otherwise})"
        if head in JOINED:
            return f"({JOINED[str(head)].join(values)})"
        if head in COMPARED:
            # As in SMT-LIB, a comparison of more than two is one of neighbours.
            return f"({COMPARED[str(head)].join(values)})"
        if isinstance(head, str) and self._arity.get(head) == len(values):
            return f"{_identifier(head)}({', '.join(values)})"
        raise Malformed(f"nothing is known of {head} with {len(values)} arguments")

    def _atom(self, name: str, bound: frozenset[str]) -> str:
        if name in bound:
            return _identifier(name)
        if name in ("true", "false"):
            return name.capitalize()
        if name.isdigit():
            return name
        if name in self._literals:
            return repr(name)
        if self._arity.get(name) == 0:
            return f"{_identifier(name)}()"
        raise Malformed(f"nothing is known of {name}")

    def _quantified(
        self, kind: str, variables: Sequence[Form], body: Form, bound: frozenset[str]
    ) -> str:
        names = [str(name) for name, _ in variables]
        loops = " ".join(f"for {_identifier(name)} in all_{sort}" for name, sort in variables)
        inner = self._expression(body, bound | set(names))
        return f"{'all' if kind == 'forall' else 'any'}({inner} {loops})"


def _identifier(name: str) -> str:
    """A name of SMT-LIB as one of Python that clashes with none."""
    return "_" + name.replace("-", "_").replace(".", "__")
