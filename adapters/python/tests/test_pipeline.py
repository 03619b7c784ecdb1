"""Tests the parts between operators: joins, budgets, order, substitutes and states."""

from __future__ import annotations

import asyncio
import gc
from typing import Any

import fuseline
import pytest
from conftest import Run
from fuseline import (
    Call,
    CarriedState,
    Ending,
    Full,
    Item,
    Items,
    Join,
    JoinCause,
    JoinDrop,
    JoinDropReason,
    Latency,
    Lineage,
    Local,
    Operator,
    OutOfOrder,
    StampedValue,
)
from fuseline.testing import VirtualLoop

MS = 0.001


def of(loop: VirtualLoop, seq: int, within: float | None = None) -> Lineage:
    """Returns the lineage of a frame that is captured now."""
    return Lineage("camera", seq, loop.time_ns(), within)


async def hang(*_: object) -> Any:
    await asyncio.Event().wait()


def test_a_set_is_given_when_it_is_complete_or_due_and_says_what_is_missing(run: Run[Any]) -> None:
    """A set is given when it is complete or due, and it names the missing inputs (E5, E6)."""
    drops: list[JoinDrop] = []

    async def main(loop: VirtualLoop) -> None:
        join = Join(wait=20 * MS, clock=loop.time_ns)
        left, right = join.aligned("left"), join.aligned("right")
        places = join.latest("place", 50 * MS)
        join.on_drop(drops.append)
        async with join:
            begin = loop.time()
            left.write("west", of(loop, 7))
            places.write("here", of(loop, 0))
            right.write("east", of(loop, 7))
            complete = await join.read()
            assert complete is not None and loop.time() == begin
            assert complete.set == {"left": "west", "right": "east", "place": "here"}
            assert (complete.key, complete.missing) == (7, [])
            assert complete.cause is JoinCause.COMPLETE
            left.write("alone", of(loop, 8))
            due = await join.read()
            assert due is not None and loop.time() == pytest.approx(begin + 20 * MS)
            assert (due.set, due.missing) == ({"left": "alone", "place": "here"}, ["right"])
            assert due.cause is JoinCause.DUE
            assert due.lineage is not None and due.lineage.missing == ("right",)
            right.write("late", of(loop, 8))
            right.write("nameless")
            await asyncio.sleep(20 * MS)
            left.write("once", of(loop, 9))
            left.write("twice", of(loop, 9))
            await asyncio.sleep(60 * MS)
            old = await join.read()
            assert old is not None and old.set == {"left": "once"}
            left.write("last", of(loop, 10))
            right.close()
            ended = await join.read()
            assert ended is not None and ended.set == {"left": "last"}
            assert ended.missing == ["right", "place"]
            left.close()
            assert await join.read() is None
        assert join.counts["right", "message", "dropped late"] == 1
        assert join.counts["join", "set", "due"] == 2

    run(main)
    assert drops == [
        JoinDrop("right", 8, JoinDropReason.LATE),
        JoinDrop("right", None, JoinDropReason.NO_KEY),
        JoinDrop("left", 9, JoinDropReason.DUPLICATE),
    ]


def test_sets_may_be_of_the_latest_message_and_are_due_by_the_aligned_ones(run: Run[Any]) -> None:
    """Control is as old as the frame behind its plan, or else belongs to the tick (E7)."""

    async def main(loop: VirtualLoop) -> None:
        join = Join(clock=loop.time_ns)
        ticks, plans = join.aligned("tick"), join.latest("plan", 80 * MS)
        join.origin_of("plan")
        async with join:
            start = loop.time_ns()
            plans.write("go", Lineage("camera", 7, start, 0.5, missing=("right",)))
            found = []
            for seq in range(2):
                await asyncio.sleep(50 * MS)
                ticks.write(seq, Lineage("control", seq, loop.time_ns(), 40 * MS))
                joined = await join.read()
                assert joined is not None and joined.lineage is not None
                it = joined.lineage
                assert it.captured is not None and isinstance(it.within, fuseline.ns)
                due = (it.captured + int(it.within) - start) // 1_000_000
                found.append((it.origin, it.seq, due, it.missing))
            assert found == [("camera", 7, 90, ("right",)), ("control", 1, 140, ("plan",))]

    run(main)


def test_sets_that_wait_are_bounded_and_a_reader_that_lags_takes_no_more(run: Run[Any]) -> None:
    """Waiting sets are bounded, and a join with a lagging reader accepts no more (E8)."""

    async def main(loop: VirtualLoop) -> None:
        join = Join(wait=1.0, window=2, output_len=2, clock=loop.time_ns)
        left, right = join.aligned("left"), join.aligned("right", key=lambda key, _: key)
        async with join:
            for seq in range(4):
                left.write(seq, of(loop, seq))
            with pytest.raises(Full):
                right.write(3)
            given = [await join.read() for _ in range(2)]
            assert [(it.key, it.cause) for it in given if it is not None] == [
                (0, JoinCause.FULL),
                (1, JoinCause.FULL),
            ]
            right.write(3)
            third = await join.read()
            assert third is not None and third.set == {"left": 3, "right": 3}

    run(main)


def test_an_operators_items_are_joined_with_the_last_of_their_message(run: Run[Any]) -> None:
    """A join uses the last item of each of an operator's messages (E1, E5)."""

    async def local(n: int, t: int) -> str:
        return "local's"

    async def handle(n: int, call: Call) -> str:
        await asyncio.sleep(10 * MS)
        return "the cloud's"

    async def main(loop: VirtualLoop) -> None:
        operator = Operator(Local.task(local), commit="progressive", clock=loop.time_ns)
        operator.use_cloud(handle, lambda n, t: (n, 0.1), str, 1)
        join = Join(wait=1.0, clock=loop.time_ns)
        join.items("boxes", operator)
        frames = join.aligned("frames")
        async with operator, join:
            begin = loop.time()
            frames.write("frame", of(loop, 5))
            operator.write(1, of(loop, 5))
            joined = await join.read()
            assert joined is not None and loop.time() - begin == pytest.approx(10 * MS)
            item: Item[str] = joined.set["boxes"]
            assert (item.value, joined.cause) == ("the cloud's", JoinCause.COMPLETE)

    run(main)


def test_a_value_ages_until_it_is_known_to_be_final(run: Run[Any]) -> None:
    """A value ages until it is known to be final (E7)."""

    async def local(n: int, t: int) -> str:
        return "local's"

    async def tracker(n: int, call: Call) -> StampedValue[str]:
        return StampedValue("the tracker's", 0)

    async def main(loop: VirtualLoop) -> None:
        operator = Operator(Local.task(local), commit="progressive", clock=loop.time_ns)
        operator.use_cloud(hang, lambda n, t: (n, 100 * MS), str, 2)
        operator.use_cloud(tracker, lambda n, t: (n, 50 * MS), _as_it_is, 1)
        operator.use_substitute(lambda item: "a substitute")
        async with operator:
            operator.write(1, of(loop, 0))
            await asyncio.sleep(1.0)
            item = await operator.read()
            assert item is not None and item.ending is Ending.FORWARDED
            assert item.age == pytest.approx(100 * MS)
            assert (item.value, item.of, item.substitute) == ("the tracker's", 0, None)

    run(main)


def _as_it_is(value: StampedValue[str]) -> StampedValue[str]:
    return value


def test_items_are_joined_as_before_once_the_reader_of_the_sets_lags_no_longer(
    run: Run[Any],
) -> None:
    """Items are joined again once the reader of the sets no longer lags (D8, E8)."""

    async def main(loop: VirtualLoop) -> None:
        operator = Operator(Local.task(_same), clock=loop.time_ns)
        join = Join(wait=1.0, output_len=1, clock=loop.time_ns)
        join.items("numbers", operator)
        async with operator, join:
            for n in range(6):
                operator.write(n, of(loop, n))
            await asyncio.sleep(MS)
            sets = [await asyncio.wait_for(join.read(), 1.0) for _ in range(6)]
            assert [it.key for it in sets if it is not None] == list(range(6))

    run(main)


def test_state_of_a_sent_result_is_taken_over(run: Run[Any]) -> None:
    """The state of a result that is sent is taken over (E10)."""
    state = CarriedState(0)

    async def local(n: int, t: int) -> int:
        computed = state.current() + n
        state.computed(t, computed)
        return computed

    async def handle(n: int, call: Call) -> int:
        await asyncio.sleep(10 * MS)
        return 100 + n

    async def main(loop: VirtualLoop) -> None:
        operator = Operator(Local.task(local), clock=loop.time_ns)
        operator.use_cloud(handle, lambda n, t: (n, 0.1) if n == 1 else None, int, 1)
        operator.use_state(state, lambda output: output)
        async with operator:
            operator.write(1)
            await operator.read()
            assert state.current() == 101
            operator.write(2)
            await operator.read()
            assert state.current() == 103

    run(main)


def test_items_wait_for_earlier_ones_until_they_are_due_and_what_is_passed_over_is_reported(
    run: Run[Any],
) -> None:
    """Items wait for earlier ones until they are due, and passed-over ones are reported (E9)."""
    reports: list[OutOfOrder] = []

    async def local(ms: int, t: int) -> int:
        await asyncio.sleep(ms * MS)
        return ms

    async def main(loop: VirtualLoop) -> list[tuple[int, int]]:
        operator = Operator(Local.task(local, at_once=9), clock=loop.time_ns)
        items = Items(operator).in_order(50 * MS, report=reports.append, clock=loop.time_ns)
        begin = loop.time()
        async with operator:
            operator.feed([30, 10, 200, 20])
            return [(it.timestamp, round((loop.time() - begin) * 1000)) async for it in items]

    assert run(main) == [(0, 30), (1, 30), (3, 70)]
    assert reports == [OutOfOrder(range(2, 3), None), OutOfOrder(None, 2)]


def test_readers_share_the_items_and_the_slowest_holds_them_back_until_it_is_gone(
    run: Run[Any],
) -> None:
    """Readers share the items, and the slowest delays the others until it is gone (E1, E8)."""

    async def main(loop: VirtualLoop) -> None:
        operator = Operator(Local.task(_same), clock=loop.time_ns)
        async with operator:
            one = Items(operator, output_len=2)
            other = one.new_reader()
            for n in range(4):
                operator.write(n)
            read = [await one.read(), await one.read()]
            third = asyncio.ensure_future(one.read())
            await asyncio.sleep(MS)
            assert not third.done()
            read.append(await other.read())
            read.append(await third)
            assert [item.value for item in read if item is not None] == [0, 1, 0, 2]
            fourth = asyncio.ensure_future(one.read())
            await asyncio.sleep(MS)
            assert not fourth.done()
            del other
            gc.collect()
            last = await fourth
            assert last is not None and last.value == 3

    run(main)


async def _same(n: int, t: int) -> int:
    return n


def test_a_chain_is_fed_with_its_lineages_and_answers_by_the_end_to_end_deadline(
    run: Run[Any],
) -> None:
    """A chain answers by the end-to-end deadline, whatever hangs (E1, E2, E4)."""

    async def main(loop: VirtualLoop) -> list[tuple[int | None, str | None, float]]:
        reserve = [Latency.stated(50 * MS)]
        detector = Operator(Local.task(hang, at_once=9), clock=loop.time_ns, reserve=reserve)
        detector.use_substitute(lambda item: "the last boxes")

        async def plan(item: Item[str], t: int) -> str:
            await asyncio.sleep(20 * MS)
            return f"a plan by {item.value}"

        planner = Operator(Local.task(plan, at_once=9), clock=loop.time_ns)
        read = []
        async with planner, detector:
            planner.feed(detector)
            for seq in range(5):
                detector.write("frame", of(loop, seq, within=0.3))
                await asyncio.sleep(100 * MS)
            detector.close()
            async for item in planner:
                assert item.age is not None and item.lineage is not None
                read.append((item.lineage.seq, item.value, round(item.age, 6)))
        return read

    assert run(main) == [(seq, "a plan by the last boxes", 0.27) for seq in range(5)]
