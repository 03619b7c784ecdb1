"""Tests that counts add up, and that each part of an operator releases what it used."""

from __future__ import annotations

import asyncio
import gc
import random
import threading
from collections import Counter
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import fuseline
import pytest
from conftest import Run, open_files
from fuseline import BlockingOperator, Call, Item, Items, Join, Latency, Lineage, Local, Operator
from fuseline.testing import VirtualLoop
from operator_support import MS, ask, local_after


@pytest.mark.parametrize("seed", range(4))
def test_each_side_request_ends_once_and_gives_its_place_back(
    run: Run[Any], seed: int, caplog: pytest.LogCaptureFixture
) -> None:
    """Counts of side requests agree with what the handlers saw (D8, D11)."""
    rng, seen = random.Random(seed), Counter[str]()
    running: set[int] = set()

    async def handle(n: int, call: Call) -> int:
        assert 0.0 < call.deadline <= 0.1
        running.add(n)
        assert len(running) <= 2, "more calls than may be"
        try:
            await asyncio.sleep(rng.choice([0, 10, 60, 200]) * MS)
        finally:
            running.remove(n)
        if rng.random() < 0.2:
            seen["failed"] += 1
            raise OSError("broke")
        return n

    def wanted(n: int, t: int) -> tuple[int, float] | None:
        if n % 17 == 3:
            seen["handler failed"] += 1
            raise KeyError(n)
        if n % 17 == 4:
            return None
        seen["wanted"] += 1
        return n, 0.0 if n % 17 == 5 else 0.1

    def answered(n: int) -> None:
        if n % 13 == 1:
            seen["failed"] += 1
            raise ValueError(n)
        seen["answered"] += 1

    async def main(loop: VirtualLoop) -> None:
        operator = Operator(local_after(0), window=64, clock=loop.time_ns)
        operator.use_side_request(handle, wanted, answered, name="plan", calls=2, limit=3, resume=1)
        async with operator:
            for n in range(400):
                operator.write(n)
                await operator.read()
                await asyncio.sleep(rng.choice([0, 5, 20]) * MS)
            await asyncio.sleep(1)
            counts = Counter({what: n for (who, _, what), n in operator.counts.items()
                              if who == "plan"})  # fmt: skip
            (side,) = operator._handlers.sides
            assert (side.waiting, side.tasks, running) == (0, set(), set())
            assert side.running is not None and side.running._value == 2
        for what in ("answered", "failed", "handler failed"):
            assert counts[what] == seen[what] > 0, what
        assert counts["requested"] + counts["refused"] == seen["wanted"]
        ended = counts["answered"] + counts["failed"] + counts["expired"]
        assert ended == counts["requested"] and counts["expired"] > 0 and counts["refused"] > 0
        assert caplog.text.count("no answer will come") == seen["failed"]

    run(main)


def test_readers_that_come_and_go_leave_no_trace_and_hold_nobody_back(run: Run[Any]) -> None:
    """Readers that come and go leave nothing behind and delay nobody (E8)."""

    async def main(loop: VirtualLoop) -> None:
        operator = Operator(local_after(0), clock=loop.time_ns)
        async with operator:
            first = Items(operator, output_len=2)
            for n in range(12):
                other = first.new_reader()
                operator.write(n)
                one = await first.read()
                # This reader waits with the others for the next item, and gets the one that another
                # has read.
                assert one is not None and one.timestamp == n
                if n % 3 == 0:
                    two = await other.read()
                    assert two is one
                del other
                gc.collect()
            assert len(first._shared._readers) == 1
            waiting = [asyncio.ensure_future(it.read()) for it in (first, first.new_reader())]
            await asyncio.sleep(MS)
            operator.write(12)
            read = await asyncio.gather(*waiting)
            assert [it.timestamp for it in read if it is not None] == [12, 12]

    run(main)


def test_reader_that_is_let_go_leaves_no_task(run: Run[Any]) -> None:
    """A reader in order that is dropped leaves no task (E9)."""

    async def main(loop: VirtualLoop) -> None:
        operator = Operator(Local.task(local_after(0), at_once=4), clock=loop.time_ns)
        async with operator:
            tasks = len(asyncio.all_tasks())
            ordered = Items(operator).in_order(50 * MS, clock=loop.time_ns)
            reading = asyncio.ensure_future(ordered.read())
            await asyncio.sleep(MS)
            reading.cancel()
            await asyncio.wait([reading])
            # A read that has begun belongs to the next reader. Without a reader, it ends.
            assert len(asyncio.all_tasks()) > tasks
            del ordered, reading
            gc.collect()
            await asyncio.sleep(MS)
            assert len(asyncio.all_tasks()) == tasks

    run(main)


def test_a_blocking_operator_leaves_no_thread_loop_or_file(tmp_path: Path) -> None:
    """A blocking operator leaves nothing behind, however its block ends (D8)."""

    async def local(message: int, t: int) -> int:
        return message

    def once(number: int) -> None:
        operator: Operator[int, int] = Operator(local, trace=tmp_path / f"{number % 3}.jsonl")
        try:
            with BlockingOperator(operator) as blocking:
                assert blocking.write(number) == 0
                item = blocking.read()
                assert item is not None and item.value == number
                with pytest.raises(fuseline.ConfigError, match="started before"):
                    blocking.__enter__()
                if number % 3 == 1:
                    raise KeyError(number)
        except KeyError:
            assert number % 3 == 1
        assert blocking._loop is not None and blocking._loop.is_closed()
        with pytest.raises(fuseline.ConfigError, match="does not run"):
            blocking.write(1)

    once(0)
    threads, files = threading.active_count(), open_files()
    for number in range(12):
        once(number)
        # An operator that cannot start ends its thread too.
        nowhere: Operator[int, int] = Operator(local, trace=tmp_path / "nowhere" / "trace.jsonl")
        with pytest.raises(OSError, match="nowhere"), BlockingOperator(nowhere):
            pass
    # The thread that wrote the last trace may still be ending.
    for thread in threading.enumerate():
        if thread.name.startswith("fuseline-"):
            thread.join(30)
    assert threading.active_count() <= threads
    gc.collect()
    assert open_files() <= files


def test_places_of_calls_that_ended_in_any_way_are_free_again_over_grpc() -> None:
    """Places are free again after every kind of end, at a server with two places (D8, D12)."""
    grpc = pytest.importorskip("fuseline.grpc")

    async def infer(payload: bytes, call: Call) -> bytes:
        if payload == b"hang":
            await asyncio.Event().wait()
        if payload == b"fail":
            raise OSError("broke")
        return payload

    async def main() -> None:
        async with (
            grpc.Server(infer, calls=2) as server,
            grpc.Remote(server.url) as remote,
        ):
            for n in range(12):
                words = (b"hang", b"fail") if n % 2 else (b"late", b"hang")
                deadline = 0.05 if n % 3 else 30.0
                calls = [asyncio.ensure_future(remote.infer(it, Call(n, deadline))) for it in words]
                await asyncio.sleep(0.01)
                calls[words.index(b"hang")].cancel()
                await asyncio.gather(*calls, return_exceptions=True)
                assert all(it.done() for it in calls)
                # The server notices the ends a moment later.
                while True:
                    both = [remote.infer(it, Call(n, 30.0)) for it in (b"a", b"b")]
                    if await asyncio.gather(*both, return_exceptions=True) == [b"a", b"b"]:
                        break

    asyncio.run(asyncio.wait_for(main(), 120))


def test_a_join_that_ends_early_lets_its_inputs_and_timers_go(run: Run[Any]) -> None:
    """A join that ends early releases its inputs and timers (E5, E8)."""

    async def main(loop: VirtualLoop) -> None:
        operator = Operator(local_after(0), clock=loop.time_ns)
        join = Join(wait=1.0, output_len=1, clock=loop.time_ns)
        camera = join.aligned("camera")
        join.items("objects", operator)
        async with operator:
            tasks = len(asyncio.all_tasks())
            async with join:
                for seq in range(3):
                    operator.write(seq, Lineage("camera", seq))
                    await asyncio.sleep(MS)
                camera.write(0, Lineage("camera", 0))
                joined = await join.read()
                assert joined is not None and joined.key == 0 and not joined.missing
                camera.write(1, Lineage("camera", 1))
                # The next set waits to be read, and another message finds no room.
                with pytest.raises(fuseline.Full):
                    camera.write(2, Lineage("camera", 2))
            assert len(asyncio.all_tasks()) == tasks
            for late in (camera.write, camera.write):
                with pytest.raises(fuseline.Closed):
                    late(3, Lineage("camera", 3))
            rest = [joined async for joined in join]
            assert [it.key for it in rest] == [1, 2]
            assert [it.missing for it in rest] == [[], ["camera"]]

    run(main)


async def camera(frames: int) -> AsyncIterator[int]:
    for frame in range(frames):
        yield frame
        await asyncio.sleep(10 * MS)


def test_stopped_operator_gives_everything_back(run: Run[Any], tmp_path: Path) -> None:
    """A stop releases feeds, calls, side requests, encoders, timers and the trace (D8, D10)."""
    calls = [0, 0]

    async def hang(request: Any, call: Call) -> Any:
        calls[0] += 1
        try:
            await asyncio.Event().wait()
        finally:
            calls[1] += 1

    async def main(loop: VirtualLoop) -> None:
        operator = Operator(
            Local.task(local_after(3600), at_once=4, deadline=7200.0),
            clock=loop.time_ns,
            trace=tmp_path / "trace.jsonl",
            greatest_deadline=7200.0,
            carry_messages=True,
        )
        operator.use_cloud(hang, ask(50.0), str, 1, encode=lambda it: it)
        operator.use_side_request(hang, ask(50.0), lambda _: None)
        async with operator:
            operator.feed(camera(1000))
            await asyncio.sleep(0.035)
            operator.stop()
            operator.stop()
            assert await operator.read() is None
            with pytest.raises(fuseline.Closed):
                operator.write(1)
        assert repr(operator) == "<Operator 'operator' clouds=['cloud-1'] over, 4 messages>"
        # Calls whose request is still being encoded have not begun.
        assert 4 <= calls[0] == calls[1]
        driver = operator._driver
        assert driver is not None and driver.is_idle and not operator._feeds.tasks
        for source in driver._sources.values():
            assert not source.in_flight and not source.aborted
        assert len(asyncio.all_tasks()) == 1

    run(main)
    verdict = fuseline.check(tmp_path / "trace.jsonl")
    assert not verdict.violations, str(verdict)


def test_a_clock_that_goes_back_stands_still(run: Run[Any], tmp_path: Path) -> None:
    """A clock that goes back stands still for the operator (D9)."""
    back = [0.0]

    async def main(loop: VirtualLoop) -> list[tuple[int, int, float]]:
        start = loop.time_ns()
        operator = Operator(
            Local.task(local_after(0), deadline=None),
            clock=lambda: round((loop.time() - back[0]) * 1e9),
            trace=tmp_path / "trace.jsonl",
        )
        items = []
        async with operator:
            for seconds in (0.0, 0.0, 7.0, 0.0):
                back[0] += seconds
                operator.write(0, Lineage("camera", 0, start))
                item = await operator.read()
                assert item is not None and item.age is not None
                items.append((round(item.opened / 1e9), round(item.age), item.latency))
                await asyncio.sleep(5)
        return items

    # The third message is accepted at the clock's earlier reading, and so is the fourth, 2 s too
    # early.
    assert run(main) == [(0, 0, 0.0), (5, 5, 0.0), (5, 5, 0.0), (8, 8, 0.0)]
    assert not fuseline.check(tmp_path / "trace.jsonl").violations


def test_an_operators_latency_is_how_long_its_own_messages_took(run: Run[Any]) -> None:
    """The latency covers only messages that were accepted, whenever they came (E3)."""

    async def main(loop: VirtualLoop) -> None:
        latency = Latency.measured(10, 0.5)
        operator = Operator(
            Local.task(local_after(30 * MS), deadline=0.04),
            window=1,
            clock=loop.time_ns,
            latency=latency,
        )
        async with operator:
            for n in range(200):
                operator.write(n)
                # There is no room for this message. It takes no time, so it must not count.
                operator.write(n)
                assert await operator.read() is not None and await operator.read() is not None
                await asyncio.sleep(1)
        assert latency.with_clouds / 1e9 == pytest.approx(0.03, rel=0.1)

    run(main)


def test_join_goes_on_after_handlers_that_fail(
    run: Run[Any], caplog: pytest.LogCaptureFixture
) -> None:
    """A join continues after handlers that fail, and reports them (D7, E5)."""

    def fails(drop: Any) -> None:
        raise KeyError("on purpose")

    async def broken() -> AsyncIterator[Any]:
        raise OSError("the objects are gone")
        yield

    async def main(loop: VirtualLoop) -> None:
        join = Join(wait=1.0, clock=loop.time_ns)
        left = join.aligned("left")
        join.items("objects", broken())
        join.on_drop(fails)
        async with join:
            left.write("no key")
            # The set does not wait for the input that ended.
            left.write("west", Lineage("left", 0))
            joined = await join.read()
            assert joined is not None and joined.set == {"left": "west"}
            left.write("west", Lineage("left", 0))
        assert join.counts["left", "message", "dropped no key"] == 1
        assert join.counts["left", "message", "dropped late"] == 1
        assert join.counts["join", "set", "complete"] == 1

    run(main)
    assert caplog.text.count("the handler of drops failed") == 2
    assert caplog.text.count("the input objects ends") == 1


def test_timers_of_one_instant_go_off_in_the_order_in_which_they_were_set(run: Run[Any]) -> None:
    """Timers of one instant fire in the order in which they were set, as in Rust."""

    async def main(loop: VirtualLoop) -> list[int]:
        fired: list[int] = []
        for n in range(50):
            loop.call_at(loop.time() + 1.0, fired.append, n)
        loop.call_at(loop.time() + 1.0, fired.append, -1).cancel()
        await asyncio.sleep(2)
        return fired

    assert run(main) == list(range(50))


def test_no_side_request_is_made_for_a_message_whose_handler_stops_the_operator(
    run: Run[Any],
) -> None:
    """A handler that stops the operator prevents its message's side request (D10)."""
    asked: list[int] = []

    async def side(n: int, call: Call) -> None:
        asked.append(n)

    async def main(loop: VirtualLoop) -> None:
        operator = Operator(local_after(0), clock=loop.time_ns)

        def stops(n: int, t: int) -> None:
            operator.stop()

        operator.use_cloud(side, stops, str, 1)
        operator.use_side_request(side, ask(1.0), lambda _: None, name="plan")
        async with operator:
            operator.write(0)
            await asyncio.sleep(1)
        assert operator.counts["plan", "side request", "requested"] == 0

    run(main)
    assert not asked


def test_lagging_reader_holds_no_latest_item_back(run: Run[Any]) -> None:
    """A reader of sets that lags holds no item of a latest-value input back (E8)."""

    async def main(loop: VirtualLoop) -> None:
        operator = Operator(local_after(0), clock=loop.time_ns)
        join = Join(output_len=1, clock=loop.time_ns)
        ticks = join.aligned("tick")
        join.latest("plan", 0.2, operator)

        async def plan_at_tick(seq: int) -> int:
            ticks.write(seq, Lineage("control", seq))
            joined = await join.read()
            assert joined is not None
            item: Item[Any] = joined.set["plan"]
            return item.timestamp

        async with operator, join:
            operator.write(0)
            await asyncio.sleep(0.01)
            assert await plan_at_tick(0) == 0
            ticks.write(1, Lineage("control", 1))
            # While that set waits to be read, the plan goes on.
            for _ in range(3):
                operator.write(0)
                await asyncio.sleep(0.01)
            assert (await join.read() or ticks) is not None
            assert await plan_at_tick(2) == 3
            operator.close()
            await asyncio.sleep(0.01)
            assert not join._tasks, "one that has ended is let go"

    run(main)


@pytest.mark.parametrize(("warning", "late"), [(0.05, 1), (0.2, 0)])
def test_who_holds_up_the_loop_is_counted_from_the_warning_on(
    run: Run[Any], warning: float, late: int
) -> None:
    async def main(loop: VirtualLoop) -> None:
        operator = Operator(local_after(0), clock=loop.time_ns, lag_warning=warning)

        def blocks(n: int, t: int) -> None:
            loop.block(0.1)

        operator.use_cloud(local_after(0), blocks, str, 1, name="west")  # type: ignore[arg-type]
        async with operator:
            operator.write(0)
            await asyncio.sleep(1)
            await operator.read()
        assert operator.counts["west", "handler", "held up the loop"] == late
        assert operator.greatest_lag == pytest.approx(0.1 * late)

    run(main)


def test_source_is_closed_however_its_operator_ends(run: Run[Any]) -> None:
    """A source of messages is closed, however its operator ends (D8)."""
    closed: list[str] = []

    async def source(name: str) -> AsyncIterator[int]:
        try:
            while True:
                yield 0
        finally:
            closed.append(name)

    async def main(loop: VirtualLoop) -> None:
        for name in ("close", "stop"):
            operator = Operator(local_after(0.01), window=1, clock=loop.time_ns)
            async with operator:
                operator.feed(source(name))
                for _ in range(3):
                    await operator.read()
                getattr(operator, name)()
                await asyncio.sleep(0)
                await asyncio.sleep(0)
            assert closed[-1:] == [name] and not operator._feeds.tasks

    run(main)


def test_a_reader_in_order_gives_what_waits_when_nothing_more_comes(run: Run[Any]) -> None:
    """A reader in order returns the waiting items when no more come (E9)."""

    async def main(loop: VirtualLoop) -> list[int]:
        async def local(n: int, t: int) -> int:
            await asyncio.sleep(0.1 if t else 3600)
            return n

        on_board = Local.task(local, at_once=3, deadline=7200.0)
        operator = Operator(on_board, clock=loop.time_ns, greatest_deadline=7200.0)
        async with operator:
            items = Items(operator).in_order(1000.0, clock=loop.time_ns)
            for n in range(3):
                operator.write(n)
            loop.call_later(1.0, operator.stop)
            given = [item.timestamp async for item in items]
            assert loop.time() == pytest.approx(1001.0)
        return given

    assert run(main) == [1, 2]
