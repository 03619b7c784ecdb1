"""The questions that the solvers are asked, and what they must say."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass

from .solver import SOLVERS, Reply, ask
from .text import Fault, Form, Obligation, write
from .world import shrink


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
class Reckoned:
    """What a solver said."""

    question: Question
    reply: Reply
    seconds: float

    @property
    def is_as_wanted(self) -> bool:
        return self.reply == self.question.wants


def questions(
    rules: str, promises: str, stated: list[Obligation], seeded: list[Fault]
) -> Iterator[Question]:
    """All that is asked of both solvers; those that take longest come first."""

    def script(rules: str, *claims: Form) -> str:
        return "\n".join((rules, promises, *(f"(assert {write(claim)})" for claim in claims)))

    by_name = {obligation.name: obligation for obligation in stated}
    for solver in SOLVERS:
        for fault in seeded:
            broken = fault.put_into(rules)
            for name in fault.breaks:
                if name in by_name:
                    case = shrink(script(broken, ["not", name]))
                    yield Question(solver, name, fault.name, case, "sat")
        for one in stated:
            case = shrink(script(rules, one.given, f"{one.name}.case"))
            yield Question(solver, one.name, "case", case, "sat")
            for part in one.then:
                claims = script(rules, one.given, ["not", part])
                yield Question(solver, one.name, "holds", claims, "unsat")


def reckon(asked: list[Question], seconds: int) -> Iterator[Reckoned]:
    """Asks them all, several at a time, in no order."""
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for done in as_completed([pool.submit(_reckon, question, seconds) for question in asked]):
            yield done.result()


def _reckon(question: Question, seconds: int) -> Reckoned:
    begun = time.monotonic()
    reply = ask(question.solver, question.script, seconds)
    return Reckoned(question, reply, time.monotonic() - begun)
