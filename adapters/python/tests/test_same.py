"""Tests that a scenario leads to the same items, counts and trace in Python and in Rust."""

from __future__ import annotations

import asyncio
import logging
import os
import random
import subprocess
from collections import Counter
from collections.abc import Iterator
from dataclasses import astuple, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from conftest import Run
from fuseline import (
    Call,
    Item,
    Latency,
    Lineage,
    Local,
    Operator,
    StampedValue,
    Trace,
    check,
    ns,
    replay,
)
from fuseline.deadline import Constant
from fuseline.testing import VirtualLoop

#: The number of compared scenarios: a sample at a landing, and otherwise all.
SCENARIOS = int(
    os.environ.get("SCENARIOS", "200" if os.environ.get("FUSELINE_TIER") == "landing" else "1000")
)
MS = 0.001
#: The first side request's number, which it has in place of a priority.
SIDE = 100


@dataclass(frozen=True)
class DrawnAction:
    """Holds an action of a source on a message, and the message that its reply names."""

    kind: str
    ms: int
    of: int | None

    async def play(self, value: str) -> StampedValue[str]:
        if self.kind == "hangs":
            await asyncio.Event().wait()
        await asyncio.sleep(self.ms * MS)
        if self.kind == "fails":
            # There are more reasons than are counted separately.
            raise OSError(f"broke {self.ms % 97}")
        return StampedValue(value, self.of)

    def __str__(self) -> str:
        return to_text(self.kind, self.ms, self.of)


@dataclass(frozen=True)
class DrawnLineage:
    """Holds a message's number, age on arrival, end-to-end deadline, and a missing input."""

    seq: int | None
    age: int | None
    within: int | None
    missing: str | None

    def at(self, now: int) -> Lineage | None:
        """Returns the lineage of a message that comes now, or None if it has none."""
        if self.seq is None:
            return None
        captured = None if self.age is None else now - self.age * 1_000_000
        within = None if self.within is None else ns(self.within * 1_000_000)
        missing = () if self.missing is None else (self.missing,)
        return Lineage("camera", self.seq, captured, within, missing)


@dataclass(frozen=True)
class DrawnMessage:
    """Holds a message: its instant, its lineage, and the actions of all sources.

    A cloud or side request without a deadline gets no request.
    """

    at: int
    lineage: DrawnLineage
    local: DrawnAction
    asked: dict[int, tuple[int | None, DrawnAction]]

    def request(self, p: int) -> tuple[DrawnAction, float] | None:
        """Returns the request to a cloud or side request and its deadline, if there is one."""
        deadline, action = self.asked[p]
        return None if deadline is None else (action, deadline * MS)


@dataclass(frozen=True)
class DrawnScenario:
    """Holds an operator and its messages, drawn by a seed. Times are milliseconds."""

    commit: Any
    window: int
    at_once: int
    deadline: int
    waiting: int | None
    skips: bool
    reserve: int | None
    substitutes: bool
    clouds: list[tuple[int, int, int, int, int | None, int]]
    sides: list[tuple[int, int, int, int]]
    messages: list[DrawnMessage]

    @classmethod
    def drawn(cls, seed: int) -> DrawnScenario:
        rng = random.Random(seed)

        kinds = ["answers"] * 7 + ["fails"] * 2 + ["hangs"]
        all_fail = rng.random() < 0.1

        def action(t: int) -> DrawnAction:
            kind = "fails" if all_fail else rng.choice(kinds)
            # Most replies do not name their message, and some name one that is still to come.
            of = rng.choice([None, None, None, t, t - 1, t - 2, t + 1])
            of = None if of is None or of < 0 else of
            return DrawnAction(kind, rng.randint(1, 900 if all_fail else 9000), of)

        def bounds(p: int) -> tuple[int, int, int, int, int | None, int]:
            policy = rng.choice([None, None, rng.randint(1, 6000)])
            linger = rng.choice([0, 0, rng.randint(1, 3000)])
            return p, rng.randint(1, 3), rng.randint(1, 3), linger, policy, rng.randint(0, 2)

        def side(number: int) -> tuple[int, int, int, int]:
            limit = rng.randint(1, 3)
            return number, rng.randint(1, 2), limit, rng.randrange(limit)

        def lineage(t: int) -> DrawnLineage:
            age = rng.choice([None, rng.randint(0, 4000), rng.randint(0, 4000)])
            # A budget that is already over would end a nanosecond later, which tokio's timers
            # cannot do.
            within = (age or 0) + (reserve or 0) + rng.randint(1, 9000)
            return DrawnLineage(
                rng.choice([None, t + 7]),
                age,
                rng.choice([None, within, within]),
                rng.choice([None, None, "lidar"]),
            )

        clouds = [bounds(p) for p in rng.sample(range(1, 9), rng.randint(1, 3))]
        sides = [side(SIDE + number) for number in range(rng.randint(0, 2))]
        reserve = rng.choice([None, rng.randint(1, 2000)])
        at, messages = 0, []
        for t in range(rng.randint(12 if all_fail else 3, 12)):
            at += rng.randint(1, 3000)
            asked = {
                p: (rng.choice([None, *[rng.randint(1, 9000)] * 5]), action(t))
                for p in [*(p for p, *_ in clouds), *(number for number, *_ in sides)]
            }
            messages.append(DrawnMessage(at, lineage(t), action(t), asked))
        return cls(
            rng.choice(["eager", "patient", "progressive"]),
            rng.choice([1, 2, 16]),
            rng.randint(1, 3),
            rng.randint(1, 9000),
            rng.choice([None, 0, 2]),
            rng.random() < 0.5,
            reserve,
            rng.random() < 0.5,
            clouds,
            sides,
            messages,
        )

    def lines(self) -> Iterator[str]:
        """Yields the lines that `adapters/tokio/examples/scenarios.rs` reads."""
        skips = "skips" if self.skips else None
        substitutes = "substitutes" if self.substitutes else None
        operator = self.commit, self.window, self.at_once, self.deadline, self.waiting, skips
        yield to_text("scenario", *operator, self.reserve, substitutes)
        for cloud in self.clouds:
            yield to_text("cloud", *cloud)
        for side in self.sides:
            yield to_text("side", *side)
        for message in self.messages:
            lineage = to_text(*astuple(message.lineage))
            asked = [to_text(p, *request) for p, request in message.asked.items()]
            yield to_text("message", message.at, lineage, message.local, *asked)

    async def play(self, loop: VirtualLoop, trace: Path) -> tuple[list[str], bool]:
        """Plays it. Returns the outcome in lines, and True if side requests make it ambiguous."""
        instants: list[int] = []

        async def local(message: DrawnMessage, t: int) -> str:
            return (await message.local.play("of 0")).value

        on_board = Local.task(
            local,
            at_once=self.at_once,
            deadline=self.deadline * MS,
            waiting=self.waiting,
            skip_answered=self.skips,
        )
        operator: Operator[DrawnMessage, str] = Operator(
            on_board,
            window=self.window,
            commit=self.commit,
            output_len=1024,
            clock=loop.time_ns,
            trace=trace,
            reserve=[] if self.reserve is None else [Latency.stated(self.reserve * MS)],
        )
        for p, calls, limit, linger, policy, max_age in self.clouds:

            def ask(message: DrawnMessage, t: int, p: int = p) -> tuple[DrawnAction, float] | None:
                return message.request(p)

            async def handle(action: DrawnAction, call: Call, p: int = p) -> StampedValue[str]:
                return await action.play(f"of {p} in {nanos(call.deadline)} at {nanos(call.age)}")

            operator.use_cloud(
                handle,
                ask,
                lambda stamped: stamped,
                p,
                calls=calls,
                limit=limit,
                linger=linger * MS,
                policy=None if policy is None else Constant(policy * MS),
                max_age=max_age,
            )
        for number, calls, limit, resume in self.sides:

            def want(
                message: DrawnMessage, t: int, number: int = number
            ) -> tuple[DrawnAction, float] | None:
                request = message.request(number)
                if request is not None:
                    instants.append(loop.time_ns() + round(request[1] * 1e9))
                return request

            async def side(action: DrawnAction, call: Call) -> None:
                try:
                    await action.play("")
                except OSError:
                    instants.append(loop.time_ns())
                    raise
                instants.append(loop.time_ns())

            operator.use_side_request(
                side, want, lambda answer: None, calls=calls, limit=limit, resume=resume
            )
        if self.substitutes:
            # Every third message has no substitute.
            operator.use_substitute(lambda item: "stop" if item.timestamp % 3 else None)
        async with operator:
            read = loop.create_task(read_all(operator))
            begin = loop.time()
            for message in self.messages:
                await asyncio.sleep(begin + message.at * MS - loop.time())
                instants.append(loop.time_ns())
                operator.write(message, message.lineage.at(loop.time_ns()))
            operator.close()
            items = await read
            instants.append(loop.time_ns())
        counts = [f"count|{'|'.join(key)}|{n}" for key, n in operator.counts.items()]
        return items + sorted(counts), bool(self.sides) and len(set(instants)) < len(instants)


async def read_all(operator: Operator[DrawnMessage, str]) -> list[str]:
    return [item_line(item) async for item in operator]


def to_text(*of: Any) -> str:
    """Joins words to a line, with `-` for None."""
    return " ".join("-" if it is None else str(it) for it in of)


def nanos(seconds: float | None) -> int | str:
    """Returns seconds in nanoseconds, as the Rust side writes them."""
    return "-" if seconds is None else round(seconds * 1e9)


def item_line(item: Item[str]) -> str:
    failures = ", ".join(f"{it.source}: {it.why}" for it in item.failures)
    value = ("" if item.substitute else item.value) or item.refusal or ""
    seq = None if item.lineage is None else item.lineage.seq
    arrived = "" if item.arrived is None else item.arrived
    fields = (
        *(item.timestamp, item.opened, item.decided, item.ending.value, value),
        *(item.source or "", arrived, item.trigger.value if item.trigger else ""),
        *(item.revision, failures),
        *to_text(item.of, seq).split(),
        *(nanos(item.age), item.substitute or "-"),
    )
    return "item|" + "|".join(map(str, fields))


def is_ambiguous(trace: Path) -> bool:
    """Returns True if two events share an instant, because no rule orders them."""
    inputs: Counter[int] = Counter()
    ticks: set[int] = set()
    due: set[int] = set()
    for line in Trace(trace).lines:
        if line.ev in ("open", "result", "fail", "tick"):
            inputs[line.at] += 1
        if line.ev == "tick":
            ticks.add(line.at)
        if line.ev == "timer":
            due.add(line.at)
    return max(inputs.values()) > 1 or bool(due & (inputs.keys() - ticks))


@pytest.fixture(scope="module")
def scenarios() -> str:
    """Returns the path of the Rust operator's example, which was built from this project."""
    path = os.environ.get("FUSELINE_SCENARIOS")
    if not path:
        pytest.skip("FUSELINE_SCENARIOS does not name the example scenarios of fuseline-tokio")
    return path


def test_both_operators_do_the_same(run: Run[Any], tmp_path: Path, scenarios: str) -> None:
    """Both operators do the same (D1, D2, D5, D6, D8, D11, E2, E3, E4, E7)."""
    logging.getLogger("fuseline").setLevel(logging.CRITICAL)
    python, rust = tmp_path / "python", tmp_path / "rust"
    python.mkdir()
    rust.mkdir()
    played: list[tuple[int, DrawnScenario, list[str]]] = []
    seed = 0
    try:
        while len(played) < SCENARIOS:
            trace = python / f"{len(played)}.jsonl"
            drawn = DrawnScenario.drawn(seed)
            lines, is_unsure = run(partial(drawn.play, trace=trace))
            verdict = check(trace)
            assert not verdict.violations, f"of seed {seed}: {verdict}"
            assert replay(trace) == trace.read_bytes(), f"of seed {seed}"
            if not is_unsure and not is_ambiguous(trace):
                played.append((seed, drawn, lines))
            seed += 1
    finally:
        logging.getLogger("fuseline").setLevel(logging.NOTSET)
    assert seed < 3 * SCENARIOS, "most scenarios are ambiguous"
    given = "".join(f"{line}\n" for _, drawn, _ in played for line in drawn.lines())
    said = subprocess.run(
        [scenarios, rust], input=given, capture_output=True, text=True, check=True
    ).stdout
    results = [part.splitlines()[1:] for part in said.split("scenario ")[1:]]
    assert len(results) == len(played)
    endings: Counter[str] = Counter()
    unsure = 0
    for number, ((seed, _, lines), result) in enumerate(zip(played, results, strict=True)):
        traces = [folder / f"{number}.jsonl" for folder in (rust, python)]
        if is_ambiguous(traces[0]):
            unsure += 1
            continue
        items = [line for line in result if line.startswith("item")]
        counts = sorted(line for line in result if line.startswith("count"))
        assert items + counts == lines, f"of seed {seed}"
        assert traces[0].read_text() == traces[1].read_text(), f"of seed {seed}"
        endings.update(line.split("|")[4] for line in items)
        endings["old value"] += sum("the value was computed from message" in line for line in items)
        endings["substitute"] += sum(line.endswith("|stop") for line in items)
        for line in counts:
            _, _, what, outcome, _ = line.split("|")
            endings[outcome] += what in ("side request", "failed because")
    assert unsure <= SCENARIOS / 100
    rare = {"old value", "substitute", "other reasons", "requested", "expired", "answered"}
    for what in ("forwarded", "preliminary", "final", "missed", "refused", *rare):
        assert endings[what], f"no scenario has {what}"
