"""Tests in virtual time how the asyncio operator ends, and what it leaves behind."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fuseline
import pytest
from conftest import Run
from fuseline import (
    Call,
    Closed,
    Ending,
    Item,
    Lineage,
    Local,
    Operator,
    Trace,
    Trigger,
    check,
)
from fuseline.deadline import (
    Chosen,
    End,
    Reason,
    Situation,
)
from fuseline.testing import VirtualLoop
from operator_support import MS, Handle, after, ask, local_after, stubborn


def use_acting_cloud(
    operator: Operator[Any, Any], handle: Handle, act: Callable[[str], None]
) -> None:
    """Registers a cloud whose policy and handlers call `act` with the place where they are."""

    class ActingPolicy:
        def decide(self, situation: Situation, cap: Any) -> Chosen:
            act("policy")
            return Chosen(cap, Reason.CONSTANT)

        def ended(self, end: End, age: Any) -> None:
            act("ended")

    def wanted(message: Any, t: int) -> tuple[Any, float]:
        act("message")
        return message, 0.1

    def respond(response: Any) -> Any:
        act("response")
        return response

    operator.use_cloud(handle, wanted, respond, 1, policy=ActingPolicy())


@pytest.mark.parametrize("first", [1, 3])
@pytest.mark.parametrize("where", ["message", "policy", "ended", "response"])
def test_stop_in_a_handler_ends_calls_and_items(
    run: Run[Any], tmp_path: Path, caplog: pytest.LogCaptureFixture, where: str, first: int
) -> None:
    """A stop in a handler ends calls and items, and leaves the trace complete (D6, D10)."""
    trace = tmp_path / "trace.jsonl"
    calls: Counter[str] = Counter()

    async def main(loop: VirtualLoop) -> tuple[list[int], list[int]]:
        operator: Operator[Any, Any] = Operator(
            local_after(30 * MS), clock=loop.time_ns, trace=trace
        )

        def stop(at: str) -> None:
            if at == where and operator.counts["operator", "message", "accepted"] >= first:
                operator.stop()

        async def handle(request: Any, call: Call) -> Any:
            calls["begun"] += 1
            try:
                await asyncio.sleep(20 * MS)
            finally:
                calls["ended"] += 1
            return request

        use_acting_cloud(operator, handle, stop)
        operator.use_cloud(after(1), ask(5.0), str, 2)

        async def read() -> list[int]:
            return [item.timestamp async for item in operator]

        async with operator:
            reader = loop.create_task(read())
            written = []
            with contextlib.suppress(Closed):
                for message in "abcdef":
                    written.append(operator.write(message))
                    await asyncio.sleep(5 * MS)
            items = await asyncio.wait_for(reader, 1)
        assert calls["begun"] == calls["ended"], "calls go on after the block"
        return written, items

    written, items = run(main)
    assert items == []
    if where in ("message", "policy"):
        assert len(written) == first
    assert not [it for it in caplog.records if it.levelno >= logging.ERROR]
    verdict = check(trace)
    assert not verdict.violations, str(verdict)
    assert [line.t for line in Trace(trace).lines if line.ev == "open"] == written
    assert fuseline.replay(trace) == trace.read_bytes()


@pytest.mark.parametrize("where", ["message", "policy", "ended", "response"])
def test_close_in_a_handler_ends_after_all_answers(run: Run[Any], where: str) -> None:
    async def main(loop: VirtualLoop) -> list[Any]:
        operator: Operator[Any, Any] = Operator(local_after(30 * MS), clock=loop.time_ns)

        def close(at: str) -> None:
            if at == where:
                operator.close()

        use_acting_cloud(operator, after(10 * MS), close)
        async with operator:
            operator.write("a")
            return [item.value async for item in operator]

    assert run(main) == ["a"]


def test_stopping_in_the_situations_handler_takes_no_message_more(
    run: Run[Any], tmp_path: Path
) -> None:
    trace = tmp_path / "trace.jsonl"

    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        operator: Operator[Any, Any] = Operator(local_after(0.9), clock=loop.time_ns, trace=trace)

        def assess(message: Any, t: int) -> Situation:
            if t == 1:
                operator.stop()
            return Situation()

        operator.use_situation(assess)
        async with operator:
            operator.write("a")
            with pytest.raises(Closed, match="ended the operator"):
                operator.write("b")
            return [item async for item in operator]

    assert run(main) == []
    assert [line.t for line in Trace(trace).lines if line.ev == "open"] == [0]


def test_calls_that_will_not_end_cost_no_other_call(run: Run[Any]) -> None:
    count = [50, 0]

    async def main(loop: VirtualLoop) -> None:
        operator: Operator[Any, Any] = Operator(local_after(0), clock=loop.time_ns, output_len=99)
        operator.use_cloud(stubborn(60, count), ask(10 * MS), str, 1, calls=3)
        async with operator:
            for message in range(60):
                operator.write(message)
                await asyncio.sleep(20 * MS)
            operator.close()
            sources = [str(item.source) async for item in operator]
        assert sources == ["local"] * 50 + ["cloud-1"] * 10
        assert count[1] == 50
        await asyncio.sleep(60)

    run(main)
    assert count[1] == 0


def test_calls_that_will_not_end_are_bounded(
    run: Run[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beyond the bound a request fails at once, and local's result is sent (D8)."""
    monkeypatch.setattr("fuseline._drive.OVERDUE_TASKS", 4)
    count = [99, 0]

    async def main(loop: VirtualLoop) -> None:
        operator: Operator[Any, Any] = Operator(local_after(0), clock=loop.time_ns, output_len=99)
        operator.use_cloud(stubborn(5, count), ask(10 * MS), str, 1, name="west", calls=3)
        async with operator:
            for message in range(50):
                operator.write(message)
                await asyncio.sleep(20 * MS)
                assert count[1] <= 10
            await asyncio.sleep(6)
            operator.write("after")
            operator.close()
            items = [item async for item in operator]
        triggers = Counter(item.trigger for item in items)
        assert triggers == {Trigger.TIMER: 11, Trigger.ARRIVAL: 40}
        why = "10 calls have not ended, although they should have"
        assert items[20].failures[0].why == why
        assert items[20].latency < 1 * MS
        assert operator.counts["west", "failed because", why] == 40
        await asyncio.sleep(6)

    run(main)


def test_an_operator_ends_although_calls_do_not(
    run: Run[Any], caplog: pytest.LogCaptureFixture
) -> None:
    async def main(loop: VirtualLoop) -> None:
        operator: Operator[Any, Any] = Operator(local_after(0), name="lane", clock=loop.time_ns)
        operator.use_cloud(stubborn(3600, [3, 0]), ask(0.5), str, 1)

        async def camera() -> Any:
            try:
                yield "a"
                yield "b"
                await asyncio.sleep(3600)
            finally:
                await asyncio.sleep(3600)

        start = loop.time()
        with contextlib.suppress(KeyError):
            async with operator:
                operator.feed(camera())
                await asyncio.sleep(0.1)
                raise KeyError
        assert loop.time() - start == pytest.approx(2.1)
        await asyncio.sleep(3700)

    run(main)
    assert "lane: 2 aborted calls have not ended in 1.0 s: they go on" in caplog.text
    assert "lane: 1 feeds have not ended in 1.0 s: they go on" in caplog.text


def test_a_lost_computation_gives_its_place_back(
    run: Run[Any], caplog: pytest.LogCaptureFixture
) -> None:
    async def local(message: int, t: int) -> int:
        if t == 0:
            await asyncio.sleep(3600)
        return message

    async def main(loop: VirtualLoop, may_lose_results: bool) -> tuple[list[Ending], int]:
        on_board = Local.task(local, deadline=50 * MS, may_lose_results=may_lose_results)
        operator: Operator[Any, Any] = Operator(on_board, clock=loop.time_ns)
        async with operator:
            for message in range(3):
                operator.write(message)
                await asyncio.sleep(20 * MS)
            operator.close()
            items = [item async for item in operator]
        endings = [item.ending for item in sorted(items, key=lambda item: item.timestamp)]
        return endings, operator.counts["local", "request", "lost"]

    assert run(lambda loop: main(loop, False)) == ([Ending.MISSED] * 3, 1)
    lost = [Ending.MISSED, Ending.FORWARDED, Ending.FORWARDED]
    assert run(lambda loop: main(loop, True)) == (lost, 1)
    assert (
        "the local computation did not end in time and is counted as lost (timestamp=0)"
        in caplog.text
    )


def test_a_trace_is_whole_however_long(run: Run[Any], tmp_path: Path) -> None:
    """A trace is complete, however long it is (D10)."""
    trace = tmp_path / "trace.jsonl"

    async def main(loop: VirtualLoop) -> None:
        operator: Operator[Any, Any] = Operator(local_after(MS), clock=loop.time_ns, trace=trace)
        async with operator:
            for seq in range(400):
                operator.write("a", Lineage("x" * 50_000, seq))
                await operator.read()

    run(main)
    assert trace.stat().st_size > 19_000_000
    verdict = check(trace)
    assert not verdict.violations and verdict.judged == 400, str(verdict)
