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
COMMITS = ("eager", "patient", "progressive")
LIKELY = ["open"] * 4 + ["offer"] * 9 + ["result"] * 3 + ["fail", "tick"]

# Answers of the core to lines.
Ask = Callable[[list[str]], list[str]]


@dataclass(frozen=True)
class Agreement:
    """How much was compared, and where the two differ first."""

    what: str
    compared: int
    difference: str | None

    def text(self) -> str:
        """A line for people."""
        result = "as the core does" if self.difference is None else f"NOT: {self.difference}"
        return f"{self.what}: {self.compared:,} {result}"


def agreements(script: str, seed: int, ask: Ask = code.ask) -> Iterator[Agreement]:
    """The comparisons, one after the other."""
    few = Rules(script, FEW)
    every = _all_sets()
    by_rules = ("valid" if few.is_state(step) else "invalid" for step in every)
    what = f"sets of {FEW} sources that are a state"
    yield _compared(what, every, by_rules, ask([step.line() for step in every]))
    yield from _steps_and_runs(script, seed, ask)


def disagrees(script: str, seed: int, ask: Ask = code.ask) -> bool:
    """Whether rules with a fault differ from the core in a step or an input."""
    return any(one.difference is not None for one in _steps_and_runs(script, seed, ask))


def _steps_and_runs(script: str, seed: int, ask: Ask) -> Iterator[Agreement]:
    few, many, drawn = Rules(script, FEW), Rules(script, MANY), random.Random(seed)
    every = _all_sets()
    answers = ask([step.line() for step in every])
    states = [step for step, answer in zip(every, answers) if answer == "valid"]
    steps = [next_step for state in states for next_step in _steps(state)]
    what = f"steps, all from every state of {FEW} sources"
    yield _compared(what, steps, map(few.answer, steps), ask([step.line() for step in steps]))
    steps = [_some_step(drawn, _some_state(drawn)) for _ in range(MANY_STATES)]
    what = f"steps from random states of {MANY} sources"
    yield _compared(what, steps, map(many.answer, steps), ask([step.line() for step in steps]))
    yield _runs(script, drawn, ask)


def _all_sets() -> list[Step]:
    return [
        Step(commit, (requested, pending, armed, cached))
        for commit in COMMITS
        for requested, pending, armed, cached in product(range(1 << FEW), repeat=4)
    ]


def _compared(
    what: str, steps: Sequence[Step], by_rules: Sequence[str] | Iterator[str], by_core: list[str]
) -> Agreement:
    for number, (step, expected, answer) in enumerate(zip(steps, by_rules, by_core), 1):
        if expected != answer:
            where = f"{step.line()}: the rules say {expected}, the core {answer}"
            return Agreement(what, number, where)
    return Agreement(what, len(steps), None)


def _steps(state: Step) -> Iterator[Step]:
    """All that can come there; a firing has at least one armed timer, an offer is a cloud's."""
    for source in range(FEW):
        yield Step(state.commit, state.sets, "result", source)
        yield Step(state.commit, state.sets, "failure", source)
        if source:
            yield Step(state.commit, state.sets, "offer", source)
    for fired in range(1 << FEW):
        if fired & state.armed:
            yield Step(state.commit, state.sets, "timers", fired)


def _some_state(drawn: random.Random) -> Step:
    commit = drawn.choice(COMMITS)
    likely = drawn.choice([(1, 1, 3, 2), (6, 1, 2, 1), (1, 3, 2, 4)])
    kinds = ("not", "closed", "pending", "cached")
    states = drawn.choices(kinds, likely, k=MANY)
    if states[0] == "not":
        states[0] = "closed"
    best = max(source for source in range(MANY) if states[source] != "not")
    if "pending" not in states[1:] or states[best] == "cached":
        states[best] = "pending"
    last = max(source for source in range(MANY) if states[source] == "pending")
    for source in range(last, MANY):
        if states[source] == "cached":
            states[source] = "closed"

    if commit == "progressive":
        last = max((source for source in range(MANY) if states[source] == "cached"), default=-1)
        for source in range(last):
            if states[source] in ("pending", "cached"):
                states[source] = "closed"

    def among(*kinds: str) -> int:
        return sum(1 << source for source in range(MANY) if states[source] in kinds)

    armed = among("pending", "cached") if commit == "eager" else among("pending")
    armed = armed & ~1 | (among("pending") & drawn.getrandbits(1))
    requested = among("closed", "pending", "cached")
    return Step(commit, (requested, among("pending"), armed, among("cached")))


def _some_step(drawn: random.Random, state: Step) -> Step:
    kind = drawn.choice(("result", "failure", "offer", "timers"))
    if kind == "timers" and state.armed:
        some = state.armed & (drawn.getrandbits(MANY) & drawn.getrandbits(MANY))
        least = state.armed & -state.armed
        return Step(state.commit, state.sets, kind, some or least)
    kind = "result" if kind == "timers" else kind
    return Step(state.commit, state.sets, kind, drawn.randrange(1 if kind == "offer" else 0, MANY))


def _runs(script: str, drawn: random.Random, ask: Ask) -> Agreement:
    """Runs of the whole machine: clock, window, gates, the order of firings."""
    what, compared = "inputs of random runs of the whole machine", 0
    for _ in range(RUNS):
        commit, window = drawn.choice(COMMITS), drawn.randint(1, 4)
        priorities = sorted(drawn.sample(range(1, 9), drawn.choice([0, 1, 3, 3, 3])))
        limits = [drawn.randint(1, 3) for _ in priorities]
        clouds = [Cloud(p, limit, drawn.randrange(limit)) for p, limit in zip(priorities, limits)]
        lines = list(_run(drawn, priorities))
        numbers = {int(line.split()[2]) for line in lines if len(line.split()) > 2}
        machine = Machine(script, commit, window, clouds, sorted(numbers | {0}), [9])
        registered = " ".join(f"{c.priority} {c.limit} {c.resume}" for c in clouds)
        made = f"machine {commit} {window} {registered}".rstrip()
        answers = ask([made, *lines])[1:]
        for number, (line, by_core) in enumerate(zip(lines, answers), 1):
            compared += 1
            by_rules = machine.answer(line)
            if by_rules != by_core:
                run = " / ".join([made, *lines[:number]])
                differ = f"{run}: the rules say {by_rules}, the core {by_core}"
                return Agreement(what, compared, differ)
    return Agreement(what, compared, None)


def _run(drawn: random.Random, clouds: list[int]) -> Iterator[str]:
    """Inputs that lie close together, so that much of it meets; now and then at the end of time."""
    now, newest = drawn.choice([0, 0, 0, END - 20]), 0
    sources = [0, *clouds * 3, 9]
    for _ in range(INPUTS_OF_A_RUN):
        now = max(0, min(END, now + drawn.choice([0, 0, 0, 0, 0, 1, 1, 6, -1])))
        near = max(0, newest - drawn.choice([0, 0, 0, 0, 0, 1, 1, 2, -1]))
        source = drawn.choice(sources)
        match drawn.choice(LIKELY):
            case "open":
                newest = max(0, newest + drawn.choice([1, 1, 1, 1, 1, 2, 0, -1]))
                yield f"{now} open {newest} {drawn.choice(['', '', '', 3, 5, 0, END])}".rstrip()
            case "offer":
                length = drawn.choice([2, 3, 4, 5, 9, 9, 0, END])
                backlog = drawn.choice([0, 0, 0, 0, 0, 1, 2, 3])
                yield f"{now} offer {near} {source} {length} {backlog}"
            case "tick":
                yield f"{now}"
            case kind:
                yield f"{now} {kind} {near} {source}"
