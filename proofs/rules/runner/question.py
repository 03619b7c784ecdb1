"""The questions to the solvers, and the answers that they must give."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass

from .solver import SOLVERS, Reply, ask
from .text import Fault, Form, Obligation, constructors, write
from .world import shrink

# A question that a solver does not answer so soon is asked of each kind of input apart, then each
# commit rule apart. Together these are all cases.
SOON = 5
APART = (("Kind", "input"), ("Commit", "(commit before)"))

@dataclass(frozen=True)
class Question:
    """One script for one solver."""

    solver: str
    obligation: str
    # "holds", "case", or the name of a fault.
    about: str
    script: str
    wants: Reply


@dataclass(frozen=True)
class Answer:
    """What a solver answered."""

    question: Question
    reply: Reply
    seconds: float

    @property
    def is_as_wanted(self) -> bool:
        return self.reply == self.question.wants


def questions(
    rules: str, promises: str, stated: list[Obligation], seeded: list[Fault]
) -> Iterator[Question]:
    """All questions to both solvers; those that take longest come first.

    Where an obligation is given no more than `NAME.part`, its case and its faults are given `NAME`.
    """

    def script(rules: str, *claims: Form) -> str:
        return "\n".join((rules, promises, *(f"(assert {write(claim)})" for claim in claims)))

    def example(rules: str, one: Obligation, claim: Form) -> str:
        return shrink(script(rules, _whole(one.given), claim))

    by_name = {obligation.name: obligation for obligation in stated}
    for solver in SOLVERS:
        for fault in seeded:
            broken = fault.put_into(rules)
            for name in fault.breaks:
                if name in by_name:
                    one = by_name[name]
                    case = example(broken, one, ["not", ["and", *one.then]])
                    yield Question(solver, name, fault.name, case, "sat")
        for one in stated:
            case = example(rules, one, f"{one.name}.case")
            yield Question(solver, one.name, "case", case, "sat")
            for part in one.then:
                claims = script(rules, one.given, ["not", part])
                yield Question(solver, one.name, "holds", claims, "unsat")


def answers(questions: list[Question], seconds: int) -> Iterator[Answer]:
    """The answers to all of them, several at a time, in no order."""
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for done in as_completed([pool.submit(_answer, question, seconds) for question in questions]):
            yield done.result()


def _whole(given: Form) -> Form:
    if isinstance(given, str):
        return given.removesuffix(".part")
    return [_whole(part) for part in given]


def _answer(question: Question, seconds: int) -> Answer:
    begun = time.monotonic()
    apart = APART if question.wants == "unsat" else ()
    reply = _ask(question.solver, question.script, seconds, apart)
    return Answer(question, reply, time.monotonic() - begun)


def _ask(solver: str, script: str, seconds: int, apart: tuple[tuple[str, str], ...]) -> Reply:
    reply = ask(solver, script, min(SOON, seconds) if apart else seconds)
    if reply != "unknown" or not apart:
        return reply
    (sort, term), *rest = apart
    for case in constructors(script, sort):
        reply = _ask(solver, f"{script}\n(assert (= {term} {case}))", seconds, tuple(rest))
        if reply != "unsat":
            break
    return reply
