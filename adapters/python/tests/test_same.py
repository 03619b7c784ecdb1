"""One engine, two operators: a scenario leads to the same items, counts and trace in Rust."""

from __future__ import annotations

import asyncio
import logging
import os
import random
import subprocess
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from conftest import Run
from fuseline import Call, Item, Local, Operator, Trace
from fuseline.deadline import Constant
from fuseline.testing import VirtualLoop

#: How many are compared.
SCENARIOS = int(os.environ.get("SCENARIOS", "1000"))
MS = 0.001


@dataclass(frozen=True)
class DrawnAction:
    """What a source does with a message."""

    kind: str
    ms: int

    async def play(self, value: str) -> str:
        if self.kind == "hangs":
            await asyncio.Event().wait()
        await asyncio.sleep(self.ms * MS)
        if self.kind == "fails":
            raise OSError("on purpose")
        return value

    def __str__(self) -> str:
        return f"{self.kind} {self.ms}"


@dataclass(frozen=True)
class DrawnMessage:
    """When it comes, what local does, and of each cloud the deadline, if any, and what it does."""

    at: int
    local: DrawnAction
    clouds: dict[int, tuple[int | None, DrawnAction]]


@dataclass(frozen=True)
class DrawnScenario:
    """An operator and its messages, drawn by a seed; times are milliseconds."""

    commit: Any
    window: int
    at_once: int
    deadline: int
    waiting: int | None
    skips: bool
    clouds: list[tuple[int, int, int, int, int | None]]
    messages: list[DrawnMessage]

    @classmethod
    def drawn(cls, seed: int) -> DrawnScenario:
        rng = random.Random(seed)

        def action() -> DrawnAction:
            kind = rng.choice(["answers"] * 7 + ["fails"] * 2 + ["hangs"])
            return DrawnAction(kind, rng.randint(1, 9000))

        def bounds(p: int) -> tuple[int, int, int, int, int | None]:
            policy = rng.choice([None, None, rng.randint(1, 6000)])
            linger = rng.choice([0, 0, rng.randint(1, 3000)])
            return p, rng.randint(1, 3), rng.randint(1, 3), linger, policy

        clouds = [bounds(p) for p in rng.sample(range(1, 9), rng.randint(1, 3))]
        at, messages = 0, []
        for _ in range(rng.randint(3, 12)):
            at += rng.randint(1, 3000)
            offers = {
                p: (rng.choice([None, *[rng.randint(1, 9000)] * 5]), action()) for p, *_ in clouds
            }
            messages.append(DrawnMessage(at, action(), offers))
        return cls(
            rng.choice(["eager", "patient", "progressive"]),
            rng.choice([1, 2, 16]),
            rng.randint(1, 3),
            rng.randint(1, 9000),
            rng.choice([None, 0, 2]),
            rng.random() < 0.5,
            clouds,
            messages,
        )

    def lines(self) -> Iterator[str]:
        """As `adapters/tokio/examples/scenarios.rs` reads it."""

        def words(*of: Any) -> str:
            return " ".join("-" if it is None else str(it) for it in of)

        skips = "skips" if self.skips else "-"
        operator = self.commit, self.window, self.at_once, self.deadline, self.waiting, skips
        yield words("scenario", *operator)
        for cloud in self.clouds:
            yield words("cloud", *cloud)
        for message in self.messages:
            offers = [words(p, *offer) for p, offer in message.clouds.items()]
            yield words("message", message.at, message.local, *offers)

    async def play(self, loop: VirtualLoop, trace: Path) -> list[str]:
        """What became of it, in lines."""

        async def local(message: DrawnMessage, t: int) -> str:
            return await message.local.play("of 0")

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
        )
        for p, calls, limit, linger, policy in self.clouds:

            def ask(message: DrawnMessage, t: int, p: int = p) -> tuple[DrawnAction, float] | None:
                deadline, action = message.clouds[p]
                return None if deadline is None else (action, deadline * MS)

            async def handle(action: DrawnAction, call: Call, p: int = p) -> str:
                return await action.play(f"of {p}")

            operator.use_cloud(
                handle,
                ask,
                str,
                p,
                calls=calls,
                limit=limit,
                linger=linger * MS,
                policy=None if policy is None else Constant(policy * MS),
            )
        async with operator:
            read = loop.create_task(read_all(operator))
            begin = loop.time()
            for message in self.messages:
                await asyncio.sleep(begin + message.at * MS - loop.time())
                operator.write(message)
            operator.close()
            items = await read
        return items + sorted(f"count|{'|'.join(key)}|{n}" for key, n in operator.counts.items())


async def read_all(operator: Operator[DrawnMessage, str]) -> list[str]:
    return [item_line(item) async for item in operator]


def item_line(item: Item[str]) -> str:
    failures = ", ".join(f"{it.source}: {it.why}" for it in item.failures)
    value = item.value or item.refusal or ""
    arrived = "" if item.arrived is None else item.arrived
    fields = (
        *(item.timestamp, item.opened, item.decided, item.ending.value, value),
        *(item.source or "", arrived, item.trigger.value if item.trigger else ""),
        *(item.revision, failures),
    )
    return "item|" + "|".join(map(str, fields))


def is_ambiguous(trace: Path) -> bool:
    """Whether two events fall on one instant: in which order they are taken is no rule."""
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
    """The example of the Rust operator, built of this project."""
    path = os.environ.get("FUSELINE_SCENARIOS")
    if not path:
        pytest.skip("FUSELINE_SCENARIOS does not name the example scenarios of fuseline-tokio")
    return path


def test_both_operators_do_the_same_with_scenarios_drawn_by_seed(
    run: Run[Any], tmp_path: Path, scenarios: str
) -> None:
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
            lines = run(partial(drawn.play, trace=trace))
            if not is_ambiguous(trace):
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
    for number, ((seed, _, lines), result) in enumerate(zip(played, results, strict=True)):
        items = [line for line in result if line.startswith("item")]
        counts = sorted(line for line in result if line.startswith("count"))
        assert items + counts == lines, f"of seed {seed}"
        traces = [folder / f"{number}.jsonl" for folder in (rust, python)]
        assert traces[0].read_text() == traces[1].read_text(), f"of seed {seed}"
        endings.update(line.split("|")[4] for line in items)
    assert set(endings) == {"forwarded", "preliminary", "final", "missed", "refused"}
