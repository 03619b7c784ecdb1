"""Whether the rules, evaluated, and the shipped core say the same."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product

from . import code
from .machine import Cloud, Machine
from .step import Rules, Step

FEW = 4
MANY = 16
MANY_STATES = 400
RUNS = 24
INPUTS_OF_A_RUN = 40
END = 2**64 - 1

# Answers of the core to lines.
Ask = Callable[[list[str]], list[str]]


@dataclass(frozen=True)
class Agreement:
    """How much was compared, and where the two differ first."""

    what: str
    compared: int
    difference: str | None

    def told(self) -> str:
        """A line for people."""
        said = "as the core does" if self.difference is None else f"NOT: {self.difference}"
        return f"{self.what}: {self.compared:,} {said}"


def agreements(script: str, seed: int, ask: Ask = code.ask) -> Iterator[Agreement]:
    """The comparisons, one after the other."""
    few, many = Rules(script, FEW), Rules(script, MANY)
    every = [Step(eager, sets) for eager in (True, False) for sets in product(range(1 << FEW), repeat=4)]
    answers = ask([step.line() for step in every])
    said = ["valid" if few.is_state(step) else "invalid" for step in every]
    yield _compared(f"sets of {FEW} sources that are a state", every, said, answers)
    states = [step for step, answer in zip(every, answers) if answer == "valid"]
    steps = [next_step for state in states for next_step in _steps(state)]
    yield _compared(
        f"steps, all from every state of {FEW} sources",
        steps, (few.answer(step) for step in steps), ask([step.line() for step in steps]),
    )
    drawn = random.Random(seed)
    steps = [_some_step(drawn, _some_state(drawn)) for _ in range(MANY_STATES)]
    for step in steps:
        if not many.is_state(step):
            raise AssertionError(f"{step.line()} is drawn and no state")
    yield _compared(
        f"steps from random states of {MANY} sources",
        steps, (many.answer(step) for step in steps), ask([step.line() for step in steps]),
    )
    yield _runs(script, drawn, ask)


def disagrees(script: str, seed: int) -> bool:
    """Whether rules with a fault differ from the core in a step or an input."""
    comparisons = agreements(script, seed)
    # Which sets are a state is a matter of the promises, not of the rules.
    next(comparisons)
    return any(agreement.difference is not None for agreement in comparisons)


def _compared(
    what: str, asked: Sequence[Step], said: Sequence[str] | Iterator[str], answers: list[str]
) -> Agreement:
    for number, (step, by_rules, by_core) in enumerate(zip(asked, said, answers), 1):
        if by_rules != by_core:
            where = f"{step.line()}: the rules say {by_rules}, the core {by_core}"
            return Agreement(what, number, where)
    return Agreement(what, len(asked), None)


def _steps(state: Step) -> Iterator[Step]:
    """Everything that can come there; a firing has at least one armed timer, an offer is a cloud's."""
    for source in range(FEW):
        yield Step(state.eager, state.sets, "result", source)
        yield Step(state.eager, state.sets, "failure", source)
        if source:
            yield Step(state.eager, state.sets, "offer", source)
    for fired in range(1 << FEW):
        if fired & state.sets[2]:
            yield Step(state.eager, state.sets, "timers", fired)


def _some_state(drawn: random.Random) -> Step:
    eager = drawn.random() < 0.5
    likely = drawn.choice([(1, 1, 3, 2), (6, 1, 2, 1), (1, 3, 2, 4)])
    places = [drawn.choices(("not", "closed", "pending", "cached"), likely)[0] for _ in range(MANY)]
    if places[0] == "not":
        places[0] = "closed"
    best = max(source for source in range(MANY) if places[source] != "not")
    if "pending" not in places[1:] or places[best] == "cached":
        places[best] = "pending"
    last = max(source for source in range(MANY) if places[source] == "pending")
    for source in range(last, MANY):
        if places[source] == "cached":
            places[source] = "closed"

    def among(*kinds: str) -> int:
        return sum(1 << source for source in range(MANY) if places[source] in kinds)

    armed = among("pending", "cached") if eager else among("pending")
    armed = armed & ~1 | (among("pending") & drawn.getrandbits(1))
    return Step(eager, (among("closed", "pending", "cached"), among("pending"), armed, among("cached")))


def _some_step(drawn: random.Random, state: Step) -> Step:
    kind = drawn.choice(("result", "failure", "offer", "timers"))
    if kind == "timers" and state.sets[2]:
        some = state.sets[2] & (drawn.getrandbits(MANY) & drawn.getrandbits(MANY))
        least = state.sets[2] & -state.sets[2]
        return Step(state.eager, state.sets, kind, some or least)
    kind = "result" if kind == "timers" else kind
    return Step(state.eager, state.sets, kind, drawn.randrange(1 if kind == "offer" else 0, MANY))


def _runs(script: str, drawn: random.Random, ask: Ask) -> Agreement:
    """Runs of the whole machine: clock, window, gates, the order of firings."""
    what, compared = "inputs of random runs of the whole machine", 0
    for _ in range(RUNS):
        eager, window = drawn.random() < 0.5, drawn.randint(1, 4)
        priorities = sorted(drawn.sample(range(1, 9), drawn.randint(0, 3)))
        limits = [drawn.randint(1, 3) for _ in priorities]
        clouds = [Cloud(p, limit, drawn.randrange(limit)) for p, limit in zip(priorities, limits)]
        lines = list(_run(drawn, priorities))
        numbers = {int(line.split()[2]) for line in lines if len(line.split()) > 2}
        machine = Machine(script, eager, window, clouds, sorted(numbers | {0}), [9])
        told = " ".join(f"{c.priority} {c.limit} {c.resume}" for c in clouds)
        made = f"machine {'eager' if eager else 'patient'} {window} {told}".rstrip()
        answers = ask([made, *lines])[1:]
        for number, (line, by_core) in enumerate(zip(lines, answers), 1):
            compared += 1
            by_rules = machine.answer(line)
            if by_rules != by_core:
                run = " / ".join([made, *lines[:number]])
                return Agreement(what, compared, f"{run}: the rules say {by_rules}, the core {by_core}")
    return Agreement(what, compared, None)


def _run(drawn: random.Random, clouds: list[int]) -> Iterator[str]:
    """Inputs that lie close together, so that much of it meets; now and then at the ends of the ranges."""
    now, newest = drawn.choice([0, 0, 0, END - 20]), 0
    sources = [0, *clouds, 9]
    for _ in range(INPUTS_OF_A_RUN):
        now = max(0, min(END, now + drawn.choice([0, 0, 1, 1, 2, -1])))
        near = max(0, newest - drawn.choice([0, 0, 0, 1, 1, 2, -1]))
        source = drawn.choice(sources)
        match drawn.choice(("open", "open", "offer", "offer", "offer", "result", "result", "fail", "tick")):
            case "open":
                newest = max(0, newest + drawn.choice([1, 1, 1, 2, 0, -1]))
                yield f"{now} open {newest} {drawn.choice(['', '', 0, 2, 4, END])}".rstrip()
            case "offer":
                length = drawn.choice([0, 1, 2, 3, 5, END])
                yield f"{now} offer {near} {source} {length} {drawn.choice([0, 0, 0, 1, 2, 3])}"
            case "tick":
                yield f"{now}"
            case kind:
                yield f"{now} {kind} {near} {source}"
