"""The asyncio operator, in virtual time: failures, queues, windows and places."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import fuseline
import pytest
from conftest import Run
from fuseline import (
    Call,
    Ending,
    Item,
    Local,
    Operator,
    Trigger,
)
from fuseline.testing import VirtualLoop
from operator_support import MS, after, ask, items_of, judged, local_after


def test_an_error_is_a_failure_of_its_message_alone(
    run: Run[Any], caplog: pytest.LogCaptureFixture
) -> None:
    async def broken(request: Any, call: Call) -> Any:
        raise OSError("connection refused")

    def response_handler(response: Any) -> Any:
        raise ValueError("no such\nclass " + "x" * 1000)

    async def local(message: int, t: int) -> Any:
        if message % 2:
            raise RuntimeError("odd")
        return message

    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        operator: Operator[Any, Any] = Operator(local, clock=loop.time_ns)
        operator.use_cloud(broken, ask(1.0), str, 1, name="broken")
        operator.use_cloud(after(0), ask(1.0), response_handler, 2, name="odd")
        return await items_of(operator, [0, 1])

    even, odd = run(main)
    assert (even.ending, even.value, even.trigger) == (Ending.FORWARDED, 0, Trigger.FAILURE)
    assert odd.ending is Ending.MISSED
    whys = {str(failure.source): failure.why for failure in odd.failures}
    assert whys["local"] == "odd"
    assert whys["broken"] == "connection refused"
    assert whys["odd"].startswith("no such class xxx")
    assert len(whys["odd"].encode()) == 200
    assert "operator: message missed (timestamp=1, why=failure)" in caplog.text
    assert "no result will come (timestamp=0, source=broken, why=connection refused)" in caplog.text


def test_a_message_handler_that_fails_does_not_ask(
    run: Run[Any], caplog: pytest.LogCaptureFixture
) -> None:
    def broken(message: Any, t: int) -> Any:
        raise RuntimeError("no frame")

    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        operator: Operator[Any, Any] = Operator(local_after(0.9), clock=loop.time_ns)
        operator.use_cloud(after(0), broken, str, 1)
        operator.use_cloud(after(0), lambda message, t: (message, -1.0), str, 2)
        return await items_of(operator, ["a"])

    (item,) = run(main)
    assert item.value == "a on board"
    assert "no frame" in caplog.text
    assert "a duration of -1" in caplog.text


def test_the_gate_sees_the_true_length_of_the_queue(run: Run[Any], tmp_path: Path) -> None:
    trace = tmp_path / "trace.jsonl"

    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        operator: Operator[Any, Any] = Operator(
            Local.task(local_after(1 * MS), at_once=8), clock=loop.time_ns, trace=trace
        )
        operator.use_cloud(after(10 * MS), ask(15 * MS), str, 1, calls=1, limit=2, resume=0)
        return await items_of(operator, range(6))

    items = run(main)
    assert len(items) == 6
    offers = [line for line in fuseline.Trace(trace).lines if line.ev in ("offer", "refuse")]
    backlogs = [line.backlog for line in offers if line.ev == "offer"]
    # One is under way; the queue holds two; then the gate is shut.
    assert backlogs == [0, 0, 1, 2, 2, 2]
    assert [line.why for line in offers if line.ev == "refuse"] == ["queue"] * 3
    judged(trace, 6)


def test_a_request_that_waits_is_given_the_time_that_is_left(run: Run[Any]) -> None:
    left: list[float] = []

    async def handle(request: Any, call: Call) -> Any:
        left.append(round(call.deadline, 6))
        await asyncio.sleep(10 * MS)

    async def main(loop: VirtualLoop) -> None:
        operator: Operator[Any, Any] = Operator(
            Local.task(local_after(0.9), at_once=9), clock=loop.time_ns
        )
        operator.use_cloud(handle, ask(25 * MS), str, 1, calls=1, limit=9)
        async with operator:
            for message in range(4):
                operator.write(message)
            operator.close()
            items = [item async for item in operator]
        # The fourth's timer fires while it waits: it is never sent.
        assert [str(item.source) for item in items] == ["cloud-1", "cloud-1", "local", "local"]

    run(main)
    assert left == [0.025, 0.015, 0.005]


def test_a_lagging_reader_holds_back_new_messages_and_loses_none(run: Run[Any]) -> None:
    async def main(loop: VirtualLoop) -> None:
        operator: Operator[Any, Any] = Operator(
            local_after(0), clock=loop.time_ns, output_len=2, window=4
        )
        async with operator:
            assert [operator.write("a"), operator.write("b")] == [0, 1]
            await asyncio.sleep(1)
            with pytest.raises(fuseline.Full, match="2 items wait"):
                operator.write("c")
            assert (await anext(operator)).timestamp == 0
            assert operator.write("c") == 2
            operator.feed(range(100))
            assert sorted([it.timestamp async for it in operator]) == list(range(1, 103))
            with pytest.raises(fuseline.Closed):
                operator.write("d")

    run(main)


def test_a_message_beyond_the_window_leaves_at_once_as_refused(run: Run[Any]) -> None:
    async def main(loop: VirtualLoop) -> None:
        operator: Operator[Any, Any] = Operator(local_after(0.9), clock=loop.time_ns, window=1)
        async with operator:
            operator.write("a")
            operator.write("b")
            operator.close()
            items = [(item.timestamp, item.ending, item.refusal) async for item in operator]
        assert items == [
            (1, Ending.REFUSED, fuseline.OpenRefusal.FULL),
            (0, Ending.FORWARDED, None),
        ]

    run(main)


def test_too_many_waiting_computations_fail_at_once(run: Run[Any]) -> None:
    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        local = Local.task(local_after(0.4), waiting=1)
        return await items_of(Operator(local, clock=loop.time_ns), ["a", "b", "c"])

    items = run(main)
    # D17: the oldest of those that wait.
    assert [(item.timestamp, item.ending) for item in items] == [
        (1, Ending.MISSED),
        (0, Ending.FORWARDED),
        (2, Ending.FORWARDED),
    ]
    assert items[0].failures[0].why == "too many computations wait"


def test_an_answered_message_is_skipped_by_local_if_wanted(run: Run[Any]) -> None:
    for skip, computed in [(True, [0]), (False, [0, 1])]:
        seen: list[int] = []

        async def local(message: int, t: int, seen: list[int] = seen) -> Any:
            seen.append(t)
            await asyncio.sleep(1)

        async def main(loop: VirtualLoop, skip: bool = skip, local: Any = local) -> None:
            operator: Operator[Any, Any] = Operator(
                Local.task(local, skip_answered=skip), clock=loop.time_ns
            )
            operator.use_cloud(after(1 * MS), ask(1.0), str, 1)
            async with operator:
                operator.write("a")
                operator.write("b")
                await asyncio.sleep(3)

        run(main)
        assert seen == computed


def test_locals_deadline_is_a_miss_and_its_computation_goes_on(run: Run[Any]) -> None:
    done = []

    async def local(message: Any, t: int) -> None:
        await asyncio.sleep(1)
        done.append(message)

    async def main(loop: VirtualLoop) -> None:
        on_board = Local.task(local, deadline=20 * MS)
        operator: Operator[Any, Any] = Operator(on_board, clock=loop.time_ns)
        async with operator:
            operator.write("a")
            item = await anext(operator)
            assert (item.ending, item.decided) == (Ending.MISSED, 20_000_000)
            await asyncio.sleep(2)

    run(main)
    assert done == ["a"]
