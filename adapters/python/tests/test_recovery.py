"""Tests that everything is as before after a disturbance of any kind and length."""

from __future__ import annotations

import asyncio
import gc
import logging
import math
import threading
from typing import Any

import pytest
from conftest import Run
from fuseline import Call, Lineage, Local, Operator
from fuseline._threads import DaemonThreads
from fuseline.deadline import Chosen, End, Policy, Reason, Situation
from fuseline.testing import VirtualLoop

MS = 0.001
#: More than the greatest number of calls and overdue tasks together.
MANY = 1100


async def disturbed(request: int, call: Call) -> str:
    """Fails, never answers, is late, and answers in turn. The first and the last answer."""
    kind = request % 5 if 0 < request < MANY else 4
    if kind == 0:
        raise OSError("broke")
    if kind == 1:
        await asyncio.Event().wait()
    await asyncio.sleep((300 if kind == 2 else 20) * MS)
    if kind == 3:
        raise ValueError("late and broken")
    return f"{request} of the cloud"


async def local(message: int, t: int) -> str:
    await asyncio.sleep(5 * MS)
    if 0 < message < MANY and message % 7 == 0:
        raise RuntimeError("on purpose")
    return f"{message} on board"


def wanted(message: int, t: int) -> tuple[int, float]:
    if 0 < message < MANY and message % 11 == 0:
        raise KeyError("a message handler fails")
    return message, 0.1


def response(answer: str) -> str:
    if answer.startswith("9 "):
        raise KeyError("a response handler fails")
    return answer


def situation(message: int, t: int) -> Situation:
    if message % 13 == 5:
        raise KeyError("a situation's handler fails")
    return Situation()


async def one(operator: Operator[int, str], loop: VirtualLoop, message: int) -> tuple[Any, ...]:
    """Writes a message. Returns how it is answered, and how long that takes."""
    begin = loop.time()
    operator.write(message, Lineage("camera", seq=message))
    item = await anext(operator)
    return str(item.source), item.value, round(loop.time() - begin, 6)


@pytest.mark.parametrize("linger", [0.0, 50 * MS])
def test_after_any_disturbance_a_message_is_answered_as_the_first_was(
    run: Run[Any], linger: float
) -> None:
    """After disturbances of places, queues and tasks, answers are as before (D6, D7, D8)."""

    async def main(loop: VirtualLoop) -> None:
        operator: Operator[int, str] = Operator(
            Local.task(local, at_once=4), window=4, clock=loop.time_ns
        )
        operator.use_cloud(disturbed, wanted, response, 1, name="west", calls=2, linger=linger)
        operator.use_situation(situation)
        tasks = len(asyncio.all_tasks())
        async with operator:
            assert await one(operator, loop, 0) == ("west", "0 of the cloud", 0.02)

            async def items() -> None:
                while True:
                    await operator.read()

            reading = asyncio.ensure_future(items())
            # The messages come faster than they can be answered.
            for message in range(1, MANY):
                operator.write(message, Lineage("camera", seq=message))
                await asyncio.sleep(17 * MS)
            await asyncio.sleep(60)
            reading.cancel()
            await asyncio.sleep(1)
            driver = operator._driver
            assert driver is not None and driver.is_idle
            for source in driver._sources.values():
                assert not source.in_flight and not source.aborted
            assert not driver._lineages
            assert len(asyncio.all_tasks()) == tasks
            last = ("west", f"{MANY} of the cloud", 0.02)
            assert await one(operator, loop, MANY) == last

    run(main)


def test_many_messages_leave_no_objects_behind(
    run: Run[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Many messages leave no objects behind (D8)."""
    # The test runner keeps all log records, so logging is off.
    monkeypatch.setattr(logging.getLogger("fuseline"), "disabled", True)

    async def main(loop: VirtualLoop) -> None:
        operator: Operator[int, str] = Operator(local, window=4, clock=loop.time_ns)
        operator.use_cloud(disturbed, wanted, response, 1, calls=2)

        async def messages(first: int, last: int) -> int:
            for message in range(first, last):
                operator.write(message, Lineage("camera", seq=message))
                await operator.read()
            await asyncio.sleep(1)
            gc.collect()
            return len(gc.get_objects())

        async with operator:
            before = await messages(1, 300)
            assert await messages(300, 900) - before < 300

    run(main)


@pytest.mark.parametrize("output_len", [1, 16])
def test_a_feed_goes_on_when_its_reader_no_longer_lags(run: Run[Any], output_len: int) -> None:
    """A feed continues when its reader no longer lags (D8)."""

    async def main(loop: VirtualLoop) -> list[int]:
        operator: Operator[int, str] = Operator(
            local, window=2, output_len=output_len, clock=loop.time_ns
        )
        read = []

        async def fed() -> None:
            async with operator:
                operator.feed(range(100))
                # Without a reader, messages are accepted as long as there is room for their items.
                await asyncio.sleep(10)
                assert operator.counts["operator", "message", "accepted"] >= output_len
                async for item in operator:
                    read.append(item.timestamp)
                    if item.timestamp % 10 == 3:
                        await asyncio.sleep(3600)

        await asyncio.wait_for(fed(), 1e6)
        return read

    assert run(main) == list(range(100))


class ApprovingPolicy(Policy):
    """Records the known speeds, and chooses the greatest deadline."""

    def __init__(self) -> None:
        self.speeds: list[Any] = []

    def decide(self, situation: Situation, cap: Any) -> Chosen:
        self.speeds.append(situation.speed)
        return Chosen(cap, Reason.CONSTANT)

    def ended(self, end: End, age: Any) -> None:
        pass


def test_after_a_situations_handler_failed_no_speed_is_known(run: Run[Any]) -> None:
    """After the situation's handler has failed, no speed is known (D7)."""
    noting = ApprovingPolicy()

    def at(message: int, t: int) -> Situation:
        assert message != 1, "on purpose"
        return Situation(7.0)

    async def main(loop: VirtualLoop) -> None:
        operator: Operator[int, str] = Operator(local, clock=loop.time_ns)
        operator.use_cloud(disturbed, wanted, response, 1, policy=noting)
        operator.use_situation(at)
        async with operator:
            for message in range(3):
                operator.write(message)
                await operator.read()

    run(main)
    first, failed, last = noting.speeds
    assert first == last == 7.0
    assert math.isnan(failed)


def test_each_timer_goes_off_at_its_own_instant_however_far(run: Run[Any]) -> None:
    """Each timer fires at its own instant, however far away that is (D9)."""
    # Much further ahead, a float of seconds cannot distinguish single nanoseconds.
    days = [days * 86_400 + 1 for days in (1, 2, 7, 40)]

    async def never(request: int, call: Call) -> str:
        await asyncio.Event().wait()
        return ""

    async def main(loop: VirtualLoop) -> list[float]:
        operator: Operator[int, str] = Operator(
            local, clock=loop.time_ns, greatest_deadline=400 * 86_400.0
        )
        operator.use_cloud(never, lambda message, t: (message, float(days[message])), str, 1)
        async with operator:
            begin = loop.time()
            for message in reversed(range(len(days))):
                operator.write(message)
            ended = []
            for _ in days:
                await operator.read()
                ended.append(loop.time() - begin)
            return ended

    assert run(main) == pytest.approx(days, abs=2 * MS)


def test_messages_from_another_thread_are_taken_after_any_that_were_not(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Messages from another thread are accepted again after some that were not (D8)."""

    async def main() -> None:
        operator: Operator[int, str] = Operator(local, window=4, output_len=1)
        async with operator:
            operator.write(0)
            while not operator.counts["local", "result", "forwarded"]:
                await asyncio.sleep(MS)
            # The reader lags, so each message is refused on its way.
            refused = 0
            for message in range(1, 40):
                future = await asyncio.to_thread(operator.write_threadsafe, message)
                with pytest.raises(Exception, match="wait to be read"):
                    await asyncio.wrap_future(future)
                refused += 1
            assert operator.counts["operator", "message", "not taken"] == refused
            await operator.read()
            future = await asyncio.to_thread(operator.write_threadsafe, 40)
            assert await asyncio.wrap_future(future) == 1
            await operator.read()

    asyncio.run(main())
    said = [it.getMessage() for it in caplog.records if "was not taken" in it.getMessage()]
    assert [it.rpartition("(")[2] for it in said] == [
        f"{times} so far)" for times in (1, 2, 4, 8, 16, 32)
    ]


def test_a_job_that_was_cancelled_is_not_begun() -> None:
    """A job that was cancelled early is never begun (D6)."""
    begun: list[int] = []
    go_on = threading.Event()

    def compute(n: int) -> int:
        begun.append(n)
        go_on.wait(60)
        return n

    async def main() -> None:
        threads = DaemonThreads(lambda: compute, 1, "test")
        first, cancelled = threads.run(0), threads.run(1)
        cancelled.cancel()
        go_on.set()
        assert [await first, await threads.run(2)] == [0, 2]
        threads.stop()

    asyncio.run(main())
    assert begun == [0, 2]


def test_threads_of_local_end_with_their_operator() -> None:
    """Local's threads end with their operator (D8)."""

    def compute(message: int, t: int) -> str:
        if message % 3 == 1:
            raise ValueError("on purpose")
        return str(message)

    async def main() -> None:
        operator: Operator[int, str] = Operator(Local.threads(compute, workers=3))
        async with operator:
            for message in range(60):
                operator.write(message)
                await operator.read()
            assert not operator._local._running

    before = threading.active_count()
    for _ in range(5):
        asyncio.run(main())
    for thread in threading.enumerate():
        if thread.name == "fuseline-local":
            thread.join(10)
    assert threading.active_count() <= before
