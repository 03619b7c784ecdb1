"""The asyncio operator, in virtual time: what it promises, one by one."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
import random
import time
import weakref
from collections import Counter
from collections.abc import Awaitable, Callable
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
    Items,
    Local,
    Operator,
    Trace,
    Trigger,
    check,
    check_observed,
)
from fuseline.deadline import (
    Accuracy,
    Case,
    Chosen,
    Constant,
    End,
    Expected,
    Guard,
    Reason,
    Situation,
)
from fuseline.testing import VirtualLoop

Handle = Callable[[Any, Call], Awaitable[Any]]

MS = 0.001


def after(seconds: float) -> Handle:
    """A cloud that answers so long after it was called."""

    async def handle(request: Any, call: Call) -> Any:
        await asyncio.sleep(seconds)
        return request

    return handle


def local_after(seconds: float) -> Callable[[Any, int], Awaitable[Any]]:
    async def local(message: Any, t: int) -> Any:
        await asyncio.sleep(seconds)
        return f"{message} on board"

    return local


def ask(deadline: float) -> Callable[[Any, int], tuple[Any, float]]:
    return lambda message, t: (message, deadline)


async def items_of(operator: Operator[Any, Any], messages: Any) -> list[Item[Any]]:
    async with operator:
        operator.feed(messages)
        return [item async for item in operator]


def judged(path: Path, messages: int) -> None:
    """The trace conforms strictly, byte for byte, and as observed without any tolerance."""
    verdict = check(path)
    assert verdict.conforms, str(verdict)
    assert verdict.judged == messages
    assert fuseline.replay(path) == path.read_bytes()
    observed = check_observed(path, tolerance=0, lateness=0)
    assert observed.conforms, str(observed)


def test_the_best_that_is_in_time_goes(run: Run[Any], tmp_path: Path) -> None:
    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        trace = tmp_path / "trace.jsonl"
        operator: Operator[Any, Any] = Operator(
            local_after(30 * MS), name="lane", clock=loop.time_ns, trace=trace
        )
        operator.use_cloud(after(50 * MS), ask(0.1), "{} by west".format, 1, name="west")
        operator.use_cloud(after(500 * MS), ask(0.1), "{} by east".format, 2, name="east")
        return await items_of(operator, ["a"])

    (item,) = run(main)
    # East's timer commits the best available result, which is west's.
    assert item.value == "a by west"
    assert (str(item.source), item.trigger, item.ending) == (
        "west",
        Trigger.TIMER,
        Ending.FORWARDED,
    )
    assert (item.opened, item.arrived, item.decided) == (0, 50_000_000, 100_000_000)
    assert item.took == 0.1
    judged(tmp_path / "trace.jsonl", 1)


def test_without_a_cloud_locals_result_goes_when_it_comes(run: Run[Any]) -> None:
    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        operator: Operator[Any, Any] = Operator(local_after(30 * MS), clock=loop.time_ns)
        operator.use_cloud(after(1), lambda message, t: None, str, 1)
        return await items_of(operator, ["a"])

    (item,) = run(main)
    assert (item.value, item.decided) == ("a on board", 30_000_000)


@pytest.mark.parametrize(("response", "goes"), [(99, "cloud"), (100, "local"), (101, "local")])
def test_a_result_at_its_due_instant_is_late(run: Run[Any], response: int, goes: str) -> None:
    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        operator: Operator[Any, Any] = Operator(local_after(1 * MS), clock=loop.time_ns)
        operator.use_cloud(after(response * MS), ask(100 * MS), str, 1, name="cloud")
        return await items_of(operator, ["a"])

    (item,) = run(main)
    assert str(item.source) == goes


def test_what_is_no_longer_wanted_is_cancelled_at_once(run: Run[Any]) -> None:
    ended: dict[str, float] = {}

    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        def slow(name: str) -> Handle:
            async def handle(request: Any, call: Call) -> Any:
                try:
                    await asyncio.sleep(10)
                finally:
                    ended[name] = round(loop.time() - 1000, 6)

            return handle

        operator: Operator[Any, Any] = Operator(local_after(1 * MS), clock=loop.time_ns)
        operator.use_cloud(slow("timer"), ask(20 * MS), str, 1, name="timer")
        operator.use_cloud(slow("cancelled"), ask(5.0), str, 3, name="cancelled")
        operator.use_cloud(after(50 * MS), ask(5.0), str, 4)
        async with operator:
            operator.write("a")
            item = await anext(operator)
            # The operator goes on: it is not its end that ends the calls.
            await asyncio.sleep(1)
            return [item]

    (item,) = run(main)
    # The first timer commits under eager, and what is still pending is cancelled with it.
    assert (item.decided, ended) == (20_000_000, {"timer": 0.02, "cancelled": 0.02})


def test_under_progressive_each_better_result_is_an_item_at_once(
    run: Run[Any], tmp_path: Path
) -> None:
    trace = tmp_path / "trace.jsonl"

    async def breaks(request: Any, call: Call) -> Any:
        await asyncio.sleep(30 * MS)
        raise OSError("broke")

    async def west(request: Any, call: Call) -> Any:
        await asyncio.sleep((50 if request == "a" else 60) * MS)
        return request

    async def main(loop: VirtualLoop) -> tuple[list[Item[Any]], Counter[tuple[str, str, str]]]:
        operator: Operator[Any, Any] = Operator(
            local_after(10 * MS), commit="progressive", clock=loop.time_ns, trace=trace
        )
        operator.use_cloud(breaks, ask(1.0), str, 1)
        operator.use_cloud(west, ask(1.0), "{} of west".format, 2, name="west")
        operator.use_cloud(after(9.0), lambda m, t: (m, 0.1) if t == 0 else None, str, 3)
        return await items_of(operator, ["a", "b"]), operator.counts

    items, counts = run(main)
    seen = [
        (it.decided, it.timestamp, it.revision, it.ending, it.value, it.last, len(it.failures))
        for it in items
    ]
    preliminary, forwarded, final = Ending.PRELIMINARY, Ending.FORWARDED, Ending.FINAL
    assert seen == [
        (10_000_000, 0, 0, preliminary, "a on board", False, 0),
        (20_000_000, 1, 0, preliminary, "b on board", False, 0),
        (50_000_000, 0, 1, preliminary, "a of west", False, 1),
        (60_000_000, 1, 1, forwarded, "b of west", True, 1),
        (100_000_000, 0, 2, final, None, True, 1),
    ]
    assert str(items[-1].source) == "west"
    assert counts["west", "result", "preliminary"] == counts["west", "output", "final"] == 1
    judged(trace, 2)


def test_a_reader_that_lags_reads_the_newest_item_of_each_message(run: Run[Any]) -> None:
    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        local = Local.task(local_after(10 * MS), at_once=2)
        operator: Operator[Any, Any] = Operator(local, commit="progressive", clock=loop.time_ns)
        operator.use_cloud(after(20 * MS), ask(1.0), "{} of west".format, 1)
        operator.use_cloud(after(9.0), lambda m, t: (m, 0.1) if t == 0 else None, str, 2)
        async with operator:
            operator.write("a")
            operator.write("b")
            await asyncio.sleep(15 * MS)
            first = [await anext(operator)]
            await asyncio.sleep(1)
            operator.close()
            return first + [item async for item in operator]

    items = run(main)
    seen = [(item.timestamp, item.revision, item.value, item.last) for item in items]
    # What was read before is not given again; what was not comes with the last item.
    assert seen == [
        (0, 0, "a on board", False),
        (1, 1, "b of west", True),
        (0, 2, "a of west", True),
    ]


def test_a_reader_of_last_items_alone_gets_one_with_its_value_for_each_message(
    run: Run[Any],
) -> None:
    async def main(loop: VirtualLoop) -> list[list[Item[Any]]]:
        local = Local.task(local_after(10 * MS), at_once=2)
        operator: Operator[Any, Any] = Operator(local, commit="progressive", clock=loop.time_ns)
        operator.use_cloud(after(20 * MS), ask(1.0), "{} of west".format, 1)
        operator.use_cloud(after(9.0), lambda m, t: (m, 0.1) if t == 0 else None, str, 2)
        async with operator:
            every = Items(operator)
            last = every.another().last_only()
            operator.write("a")
            operator.write("b")
            operator.close()

            async def all_of(items: Items[Item[Any]]) -> list[Item[Any]]:
                return [item async for item in items]

            return list(await asyncio.gather(all_of(every), all_of(last)))

    every, last = run(main)
    forwarded, final = Ending.FORWARDED, Ending.FINAL
    assert [(it.timestamp, it.revision, it.ending, it.value) for it in last] == [
        (1, 1, forwarded, "b of west"),
        (0, 2, forwarded, "a of west"),
    ]
    # The other reader's item is as it was.
    assert [it.revision for it in every] == [0, 0, 1, 1, 2]
    assert (every[-1].ending, every[-1].value) == (final, None)


def test_a_guard_under_progressive_is_refused_with_the_remedy(run: Run[Any]) -> None:
    class MyGuard(Guard):
        pass

    expected = Expected(Accuracy(local=42.0, cloud=50.0, price_per_ms=0.01), 0.05)

    async def main(loop: VirtualLoop) -> None:
        for policy in (Guard(), MyGuard(), Guard().caps(expected)):
            operator: Operator[Any, Any] = Operator(local_after(0), commit="progressive")
            operator.use_cloud(after(0), ask(1.0), str, 1, name="west", policy=policy)
            with pytest.raises(fuseline.ConfigError, match="the guard of west promises"):
                await operator.start()
        async with Operator[Any, Any](local_after(0), commit="progressive") as operator:
            operator.close()
        other: Operator[Any, Any] = Operator(local_after(0), commit="progressive")
        other.use_cloud(after(0), ask(1.0), str, 1, policy=expected)
        async with other:
            other.close()

    run(main)


def test_what_an_aborted_call_returns_all_the_same_is_not_taken(run: Run[Any]) -> None:
    async def stubborn(request: Any, call: Call) -> Any:
        try:
            await asyncio.sleep(1)
        except asyncio.CancelledError:
            return "too late"

    async def main(loop: VirtualLoop) -> None:
        operator: Operator[Any, Any] = Operator(local_after(0), clock=loop.time_ns)
        operator.use_cloud(stubborn, ask(10 * MS), str, 1, name="stubborn")
        async with operator:
            operator.write("a")
            await anext(operator)
            await asyncio.sleep(1)
        assert not [
            what for who, what, _ in operator.counts if (who, what) == ("stubborn", "result")
        ]

    run(main)


def test_a_reader_that_gives_up_is_forgotten(run: Run[Any]) -> None:
    async def main(loop: VirtualLoop) -> None:
        operator: Operator[Any, Any] = Operator(local_after(0.9), clock=loop.time_ns)
        async with operator:
            for _ in range(3):
                with pytest.raises(asyncio.TimeoutError):
                    await asyncio.wait_for(anext(operator), 0.1)
            assert not operator._readers._waiters
            operator.write("a")
            assert (await anext(operator)).value == "a on board"

    run(main)


def test_what_was_missed_is_written_at_once(run: Run[Any], tmp_path: Path) -> None:
    trace = tmp_path / "trace.jsonl"

    async def broken(message: Any, t: int) -> Any:
        raise ValueError("nothing")

    async def main(loop: VirtualLoop) -> None:
        operator: Operator[Any, Any] = Operator(broken, clock=loop.time_ns, trace=trace)
        async with operator:
            operator.write("a")
            assert (await anext(operator)).ending is Ending.MISSED
            # The loop's time stands still meanwhile; the disk has its own thread.
            for _ in range(10_000):
                if b'"miss"' in trace.read_bytes():
                    return
                time.sleep(0.001)
            raise AssertionError("the miss is not in the file")

    run(main)


def test_a_policy_is_asked_about_what_is_admitted_alone(run: Run[Any]) -> None:
    asks: list[int] = []

    def policy(situation: Situation, cap: int) -> int:
        asks.append(cap)
        return cap

    async def main(loop: VirtualLoop) -> None:
        operator: Operator[Any, Any] = Operator(
            Local.task(local_after(0.9), at_once=9), clock=loop.time_ns
        )
        operator.use_cloud(after(1), ask(0.5), str, 1, calls=1, limit=2, policy=policy)
        async with operator:
            for message in range(6):
                operator.write(message)
        assert operator.counts["cloud-1", "request", "admitted"] == 3
        assert operator.counts["cloud-1", "request", "refused queue"] == 3

    run(main)
    assert asks == [500_000_000] * 3


def test_a_capped_policy_says_whose_limit_it_is() -> None:
    capped = Guard().caps(Constant(60.0))
    chosen = capped.decide(Situation(speed=11.0), 90.0)
    assert (chosen.reason, chosen.case) == (Reason.GUARD, Case.LOCAL_STOPS)
    assert chosen == Guard().decide(Situation(speed=11.0), 90.0)
    assert capped.decide(Situation(speed=11.0), 0.1).reason is Reason.CAP


def test_local_is_never_cancelled_by_a_decision(run: Run[Any]) -> None:
    done = []

    async def local(message: Any, t: int) -> Any:
        await asyncio.sleep(1)
        done.append(message)

    async def main(loop: VirtualLoop) -> None:
        operator: Operator[Any, Any] = Operator(local, clock=loop.time_ns)
        operator.use_cloud(after(1 * MS), ask(1.0), str, 1)
        async with operator:
            operator.write("a")
            assert (await anext(operator)).value == "a"
            await asyncio.sleep(2)
        assert operator.counts["local", "result", "dropped superseded"] == 1

    run(main)
    assert done == ["a"]


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


@pytest.mark.parametrize("first", [1, 3])
@pytest.mark.parametrize("where", ["message", "policy", "ended", "response"])
def test_stopping_in_a_handler_ends_calls_and_items_and_leaves_the_trace_whole(
    run: Run[Any], tmp_path: Path, caplog: pytest.LogCaptureFixture, where: str, first: int
) -> None:
    trace = tmp_path / "trace.jsonl"
    calls: Counter[str] = Counter()

    async def main(loop: VirtualLoop) -> tuple[list[int], list[int]]:
        operator: Operator[Any, Any] = Operator(
            local_after(30 * MS), clock=loop.time_ns, trace=trace
        )

        def stop(at: str) -> None:
            if at == where and operator.counts["operator", "message", "accepted"] >= first:
                operator.stop()

        class Stopping:
            def decide(self, situation: Situation, cap: Any) -> Chosen:
                stop("policy")
                return Chosen(cap, Reason.CONSTANT)

            def ended(self, end: End, age: Any) -> None:
                stop("ended")

        async def handle(request: Any, call: Call) -> Any:
            calls["begun"] += 1
            try:
                await asyncio.sleep(20 * MS)
            finally:
                calls["ended"] += 1
            return request

        def ask_and_stop(message: Any, t: int) -> tuple[Any, float]:
            stop("message")
            return message, 0.1

        def respond(response: Any) -> Any:
            stop("response")
            return response

        operator.use_cloud(handle, ask_and_stop, respond, 1, policy=Stopping())
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
    assert verdict.conforms, str(verdict)
    assert [line.t for line in Trace(trace).lines if line.ev == "open"] == written
    assert fuseline.replay(trace) == trace.read_bytes()


@pytest.mark.parametrize("where", ["message", "policy", "ended", "response"])
def test_closing_in_a_handler_ends_the_operator_once_all_is_answered(
    run: Run[Any], where: str
) -> None:
    async def main(loop: VirtualLoop) -> list[Any]:
        operator: Operator[Any, Any] = Operator(local_after(30 * MS), clock=loop.time_ns)

        def close(at: str) -> None:
            if at == where:
                operator.close()

        class Closing:
            def decide(self, situation: Situation, cap: Any) -> Chosen:
                close("policy")
                return Chosen(cap, Reason.CONSTANT)

            def ended(self, end: End, age: Any) -> None:
                close("ended")

        def ask_and_close(message: Any, t: int) -> tuple[Any, float]:
            close("message")
            return message, 0.1

        def respond(response: Any) -> Any:
            close("response")
            return response

        operator.use_cloud(after(10 * MS), ask_and_close, respond, 1, policy=Closing())
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


def test_stopping_ends_calls_and_items_and_leaves_the_trace_whole(
    run: Run[Any], tmp_path: Path
) -> None:
    trace = tmp_path / "trace.jsonl"
    ended: list[str] = []

    async def handle(request: Any, call: Call) -> Any:
        try:
            await asyncio.sleep(100)
        finally:
            ended.append(request)

    async def main(loop: VirtualLoop) -> None:
        operator: Operator[Any, Any] = Operator(
            Local.task(local_after(50), deadline=None), clock=loop.time_ns, trace=trace
        )
        operator.use_cloud(handle, ask(60.0), str, 1)
        with pytest.raises(KeyError, match="mine"):
            async with operator:
                operator.write("a")
                operator.write("b")
                await asyncio.sleep(1)
                raise KeyError("mine")
        assert [item async for item in operator] == []
        assert repr(operator) == "<Operator 'operator' clouds=['cloud-1'] over, 2 messages>"

    run(main)
    assert sorted(ended) == ["a", "b"]
    verdict = check(trace)
    assert verdict.conforms
    # The last one says that the run is over (A44).
    assert (verdict.lines, list(Trace(trace).lines)[-1].ev) == (8, "tick")


def test_a_source_of_messages_that_fails_is_raised_at_the_end(run: Run[Any]) -> None:
    async def camera() -> Any:
        yield "a"
        raise OSError("no camera")

    async def main(loop: VirtualLoop) -> None:
        operator: Operator[Any, Any] = Operator(local_after(0.9), clock=loop.time_ns)
        items = []
        with pytest.raises(OSError, match="no camera"):
            async with operator:
                operator.feed(camera())
                items = [item.value async for item in operator]
        assert items == ["a on board"]

    run(main)


def stubborn(seconds: float, count: list[int]) -> Handle:
    """A cloud whose first calls go on for so long after they were cancelled."""

    async def handle(request: Any, call: Call) -> Any:
        if call.timestamp >= count[0]:
            return request
        count[1] += 1
        try:
            await asyncio.sleep(1)
        except asyncio.CancelledError:
            await asyncio.sleep(seconds)
        finally:
            count[1] -= 1

    return handle


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
    """D8: beyond the bound a request fails at once, and local's result goes."""
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
        why = "10 calls have not ended, though they should have"
        assert items[20].failures[0].why == why
        assert items[20].took < 1 * MS
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

    async def main(loop: VirtualLoop, lossy: bool) -> tuple[list[Ending], int]:
        on_board = Local.task(local, deadline=50 * MS, lossy=lossy)
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
    assert "local computation lost (timestamp=0)" in caplog.text


def test_reasons_of_failures_and_refused_messages_are_counted_as_in_rust(run: Run[Any]) -> None:
    async def broken(request: int, call: Call) -> Any:
        raise OSError(["connection refused", *map(str, range(9))][max(0, request - 20)])

    async def main(loop: VirtualLoop) -> None:
        operator: Operator[Any, Any] = Operator(
            Local.task(local_after(1 * MS), at_once=99),
            clock=loop.time_ns,
            window=30,
            output_len=99,
        )
        operator.use_cloud(broken, ask(1.0), str, 1, name="west", calls=99, limit=99)
        async with operator:
            for message in range(32):
                operator.write(min(message, 29))
        counts = operator.counts
        assert counts["operator", "message", "accepted"] == 30
        assert counts["operator", "message", "refused full"] == 2
        assert counts["local", "request", "admitted"] == 30
        assert counts["west", "failed because", "connection refused"] == 21
        assert counts["west", "failed because", "6"] == 1
        assert counts["west", "failed because", "other reasons"] == 2
        assert ("west", "failed because", "7") not in counts
        assert counts["local", "result", "forwarded"] == counts["local", "output", "arrival"] == 30

    run(main)


def test_the_deadline_in_force_is_the_policys_under_its_cap(run: Run[Any], tmp_path: Path) -> None:
    trace = tmp_path / "trace.jsonl"

    class Long:
        def decide(self, situation: Situation, cap: Any) -> Chosen:
            return Chosen(cap + 7, Reason.GUARD, Case.UNSURE)

        def ended(self, end: End, age: Any) -> None: ...

    async def main(loop: VirtualLoop) -> None:
        operator: Operator[Any, Any] = Operator(local_after(0), clock=loop.time_ns, trace=trace)
        guard = Guard()
        operator.use_cloud(after(0), ask(0.1), str, 1, name="long", policy=Long())
        operator.use_cloud(after(0), ask(0.2), str, 2, name="plain")
        operator.use_cloud(after(0), ask(9.0), str, 3, name="safe", policy=guard)
        operator.use_cloud(after(0), ask(9.0), str, 4, policy=guard.caps(Constant(0.4)))
        operator.use_situation(lambda message, t: Situation(speed=11.0))
        assert operator.deadlines == {}
        async with operator:
            operator.write("a")
        safe = guard.judge(Situation(speed=11.0)).deadline
        assert operator.deadlines == {
            "long": (100_000_000, "unsure"),
            "plain": (200_000_000, "offered"),
            "safe": (safe, "local-stops"),
            "cloud-4": (400_000_000, "constant"),
        }

    run(main)
    dues = {line.p: line.due for line in Trace(trace).lines if line.ev == "request"}
    assert (dues[1], dues[4]) == (100_000_000, 400_000_000)


@pytest.mark.parametrize("wrong", [RuntimeError("no idea"), None, 250, Chosen(-1, Reason.CAP)])  # type: ignore[arg-type]
def test_a_policy_that_fails_asks_for_nothing(
    run: Run[Any], caplog: pytest.LogCaptureFixture, wrong: Any
) -> None:
    class Failing:
        def decide(self, situation: Situation, cap: Any) -> Any:
            if isinstance(wrong, Exception):
                raise wrong
            return wrong

        def ended(self, end: End, age: Any) -> None:
            raise LookupError("who ended?")

    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        operator: Operator[Any, Any] = Operator(local_after(20 * MS), clock=loop.time_ns)
        operator.use_cloud(after(0), ask(1.0), str, 1, policy=Guard().caps(Failing()))
        operator.use_cloud(after(0), ask(10 * MS), str, 2, policy=Constant(1.0))
        items = await items_of(operator, ["a"])
        assert operator.counts["cloud-1", "request", "admitted"] == 0
        assert operator.counts["cloud-2", "request", "admitted"] == 1
        return items

    (item,) = run(main)
    assert item.value == "a"
    assert caplog.text.count("a policy failed\n") == 1
    assert "no request is sent (timestamp=0, source=cloud-1)" in caplog.text


def test_no_handler_or_policy_can_enter_the_engine_while_it_decides(
    run: Run[Any], caplog: pytest.LogCaptureFixture
) -> None:
    tried: list[str] = []

    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        operator: Operator[Any, Any] = Operator(local_after(0), clock=loop.time_ns)

        def enter() -> None:
            assert operator._driver is not None
            with pytest.raises(RuntimeError, match="the operator decides about a message"):
                operator._driver._engine.tick(1)
            with pytest.raises(RuntimeError, match="a handler must not write"):
                operator.write("b")
            tried.append(repr(operator.counts))

        class Entering:
            def decide(self, situation: Situation, cap: Any) -> Chosen:
                enter()
                return Chosen(cap, Reason.CAP)

            def ended(self, end: End, age: Any) -> None:
                assert operator.counts

        def handler(message: Any, t: int) -> Any:
            enter()
            return message, 1.0

        operator.use_cloud(after(0), handler, str, 1, policy=Entering())
        return await items_of(operator, ["a"])

    (item,) = run(main)
    assert (item.value, len(tried)) == ("a", 2)
    assert not caplog.records


def test_an_interrupt_in_a_policy_or_handler_is_no_failure_of_it(run: Run[Any]) -> None:
    class Interrupted:
        def decide(self, situation: Situation, cap: Any) -> Any:
            raise KeyboardInterrupt

        def ended(self, end: End, age: Any) -> None: ...

    def handler(message: Any, t: int) -> Any:
        raise KeyboardInterrupt

    async def main(loop: VirtualLoop, handler: Any, policy: Any) -> None:
        operator: Operator[Any, Any] = Operator(local_after(0), clock=loop.time_ns)
        operator.use_cloud(after(0), handler, str, 1, policy=policy)
        async with operator:
            with pytest.raises(KeyboardInterrupt):
                operator.write("a")
            operator.stop()

    run(lambda loop: main(loop, ask(1.0), Interrupted()))
    run(lambda loop: main(loop, handler, None))


def test_an_operator_that_has_ended_is_let_go(run: Run[Any], tmp_path: Path) -> None:
    async def main(loop: VirtualLoop) -> weakref.ref[Any]:
        operator: Operator[Any, Any] = Operator(
            local_after(0), clock=loop.time_ns, trace=tmp_path / "trace.jsonl"
        )

        def policy(situation: Situation, cap: Any) -> Any:
            return cap if operator.counts else 0.0

        operator.use_cloud(after(0), ask(1.0), str, 1, policy=policy)
        async with operator:
            operator.write("a")
        return weakref.ref(operator)

    operator = run(main)
    gc.collect()
    assert operator() is None


def test_a_policy_learns_how_each_call_ended_and_chooses(run: Run[Any]) -> None:
    reported: list[tuple[End, int]] = []
    asks: list[tuple[int, list[int]]] = []

    class Policy:
        def decide(self, situation: Situation, cap: Any) -> Any:
            asks.append((cap, list(situation.under_way)))  # type: ignore[arg-type]
            return Constant(30 * MS).decide(situation, cap)

        def ended(self, end: End, age: Any) -> None:
            reported.append((end, age))

    async def handle(request: int, call: Call) -> Any:
        await asyncio.sleep([10, 20, 100][request] * MS)
        if request == 1:
            raise OSError("broke")

    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        operator: Operator[Any, Any] = Operator(
            Local.task(local_after(0), at_once=3), clock=loop.time_ns
        )
        operator.use_cloud(handle, ask(1.0), str, 1, policy=Policy())
        return await items_of(operator, [0, 1, 2])

    run(main)
    assert reported == [(End.ANSWERED, 10**7), (End.FAILED, 2 * 10**7), (End.CENSORED, 3 * 10**7)]
    assert asks == [(10**9, []), (10**9, [0]), (10**9, [0, 0])]


def test_a_call_that_lingers_shows_how_long_it_takes_and_changes_no_output(run: Run[Any]) -> None:
    for linger, ages in [(0.0, (End.CENSORED, 3 * 10**7)), (0.1, (End.ANSWERED, 5 * 10**7))]:
        reported: list[Any] = []

        class Policy(Constant):
            def ended(self, end: End, age: Any, reported: list[Any] = reported) -> None:
                reported.append((end, age))

        policy = Policy(1.0)

        async def main(loop: VirtualLoop, linger: float = linger, policy: Any = policy) -> None:
            operator: Operator[Any, Any] = Operator(local_after(0), clock=loop.time_ns)
            operator.use_cloud(after(50 * MS), ask(30 * MS), str, 1, policy=policy, linger=linger)
            async with operator:
                operator.write("a")
                item = await anext(operator)
                assert (item.value, item.decided) == ("a on board", 3 * 10**7)
                await asyncio.sleep(1)

        run(main)
        assert reported == [ages]


def test_a_guard_and_what_is_worth_it_decide_in_an_operator(run: Run[Any]) -> None:
    guard = Guard()
    expected = Expected(Accuracy(local=42.0, cloud=50.0, price_per_ms=0.01), 0.05, probe_every=16)

    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        operator: Operator[Any, Any] = Operator(
            Local.task(local_after(50 * MS), at_once=99), clock=loop.time_ns, window=99
        )
        operator.use_situation(lambda message, t: Situation(speed=11.0))
        operator.use_cloud(after(120 * MS), ask(2.0), str, 1, calls=99, policy=guard.caps(expected))

        async def camera() -> Any:
            for message in range(40):
                yield message
                await asyncio.sleep(0.5)

        return await items_of(operator, camera())

    items = run(main)
    assert {str(item.source) for item in items} == {"cloud-1"}
    assert {it.response for it in expected.observations()} == {120_000_000}
    assert len(expected.observations()) == 40
    assert expected.decide(Situation(), 2.0).deadline == 120_000_001


@pytest.mark.parametrize("commit", ["eager", "patient", "progressive"])
@pytest.mark.parametrize("seed", range(6))
def test_random_load_gives_one_item_a_message_and_a_conforming_trace(
    run: Run[Any], tmp_path: Path, commit: Any, seed: int
) -> None:
    trace = tmp_path / "trace.jsonl"
    rng = random.Random(seed)
    messages = 300

    async def flaky(request: Any, call: Call) -> Any:
        await asyncio.sleep(rng.choice([0, 1, 5, 10, 20, 20, 200]) * MS)
        if rng.random() < 0.2:
            raise OSError("broke")
        return request

    async def local(message: int, t: int) -> Any:
        await asyncio.sleep(rng.choice([0, 2, 10, 10]) * MS)
        if rng.random() < 0.1:
            raise RuntimeError("nothing seen")
        return message

    async def camera() -> Any:
        for message in range(messages):
            yield message
            await asyncio.sleep(rng.choice([0, 0, 1, 5, 30]) * MS)

    def handler(message: int, t: int) -> Any:
        assert message == t
        return None if rng.random() < 0.1 else (message, rng.choice([0, 5, 10, 20, 50]) * MS)

    async def main(loop: VirtualLoop) -> list[Item[Any]]:
        on_board = Local.task(
            local,
            at_once=rng.choice([1, 3]),
            deadline=rng.choice([None, 0.04]),
            waiting=rng.choice([None, 2]),
            skip_answered=rng.random() < 0.5,
        )
        operator: Operator[Any, Any] = Operator(
            on_board, window=rng.choice([2, 16]), commit=commit, clock=loop.time_ns, trace=trace
        )
        for p in rng.sample(range(1, 9), 3):
            operator.use_cloud(
                flaky,
                handler,
                lambda it: it,
                p,
                calls=rng.choice([1, 4]),
                limit=rng.choice([1, 3]),
                linger=rng.choice([0, 0, 0.05]),
            )
        items = await items_of(operator, camera())
        counts = operator.counts
        ends = [item.ending for item in items]
        assert counts["operator", "message", "missed"] == ends.count(Ending.MISSED)
        outputs = sum(n for (_, what, _), n in counts.items() if what == "output")
        assert outputs == ends.count(Ending.FORWARDED) + ends.count(Ending.FINAL)
        return items

    logging.getLogger("fuseline").setLevel(logging.CRITICAL)
    try:
        items = run(main)
    finally:
        logging.getLogger("fuseline").setLevel(logging.NOTSET)
    assert sorted(item.timestamp for item in items if item.last) == list(range(messages))
    # D2: each item bears the value of its own message, by the source that the trace names.
    lines = fuseline.Trace(trace).lines
    emitted = {(line.t, line.at, line.p) for line in lines if line.ev == "emit"}
    best = {line.t: line.p for line in lines if line.ev == "emit"}
    sent: dict[int, int] = {}
    for item in items:
        if item.source is None:
            assert item.timestamp not in best
            continue
        source = item.source.priority
        if item.ending is Ending.FINAL:
            assert (item.value, sent[item.timestamp]) == (None, source)
        else:
            # D1: items rise.
            assert sent.get(item.timestamp, -1) < source
            left = item.arrived if commit == "progressive" else item.decided
            assert (item.timestamp, left, source) in emitted
            assert item.value == item.timestamp
        assert not item.last or best[item.timestamp] == source
        sent[item.timestamp] = source
    assert any(not item.last for item in items) == (commit == "progressive")
    verdict = check(trace)
    assert verdict.conforms, str(verdict)
    assert fuseline.replay(trace) == trace.read_bytes()
    observed = check_observed(trace, tolerance=0, lateness=0)
    assert observed.conforms, str(observed)


def test_what_makes_no_operator_is_refused() -> None:
    async def cloud(request: Any, call: Call) -> Any: ...

    async def handler(message: Any, t: int) -> Any: ...

    def plain(message: Any, t: int) -> Any: ...

    operator: Any = Operator(plain)
    local: Any = Local
    cases: list[tuple[Callable[[], Any], str]] = [
        (lambda: Operator(plain, output_len=0), "an output_len of 0"),
        (lambda: local.threads(plain, workers=0), "local computations at once of 0"),
        (lambda: local.task(plain), "give a plain one to Local.threads"),
        (lambda: local.threads(cloud), "give an async one to Local.task"),
        (lambda: operator.use_cloud(cloud, handler, str, 1), "not an async def"),
        (lambda: operator.use_cloud(cloud, plain, str, 1, calls=0), "calls at once of 0"),
        (lambda: operator.write(1), "has not started"),
    ]
    for make, message in cases:
        with pytest.raises(fuseline.ConfigError, match=message):
            make()


@pytest.mark.parametrize("window", [-5, 0, 1025])
def test_a_window_that_is_none_is_refused_at_the_start(run: Run[Any], window: int) -> None:
    async def main(loop: VirtualLoop) -> None:
        operator: Operator[Any, Any] = Operator(local_after(0), window=window)
        with pytest.raises(fuseline.ConfigError, match="a window of"):
            await operator.start()

    run(main)


def test_a_second_cloud_of_one_priority_is_refused() -> None:
    operator: Operator[Any, Any] = Operator(local_after(0))
    operator.use_cloud(after(0), ask(1.0), str, 7)
    with pytest.raises(fuseline.ConfigError, match="two clouds of priority 7"):
        operator.use_cloud(after(0), ask(1.0), str, 7)
