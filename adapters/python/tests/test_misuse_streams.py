"""Tests misuse of streams of messages, readers and threads. See test_misuse.py."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import itertools
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator
from datetime import timedelta
from functools import partial
from typing import Any

import pytest
from conftest import Run
from fuseline import (
    BlockingOperator,
    CarriedState,
    Closed,
    Full,
    Items,
    Join,
    Lineage,
    Local,
    Operator,
    ns,
)
from fuseline.testing import VirtualLoop
from misuse import ask, echo, elsewhere, misuse, operator_of, played

# Streams that are fed.


async def spaced(*messages: Any, seconds: float = 0.01) -> AsyncIterator[Any]:
    for message in messages:
        await asyncio.sleep(seconds)
        yield message


@misuse("feeds two streams", "the operator is closed once both have ended")
def test_two_feeds(run: Run[Any]) -> None:
    async def main(loop: VirtualLoop) -> list[Any]:
        async with operator_of(clock=loop.time_ns) as operator:
            operator.feed(["left"])
            operator.feed(spaced(1, 2, 3))
            operator.feed(spaced("a", "b", seconds=0.5))
            return [item.value async for item in operator]

    assert len(run(main)) == 6


@misuse("feeds a second stream after the first has ended", "`Closed`")
def test_feed_after_a_feed() -> None:
    async def main() -> None:
        async with operator_of() as operator:
            operator.feed([1])
            assert [item.value async for item in operator] == ["1 on board"]
            with pytest.raises(Closed, match="feed all streams"):
                operator.feed([2])

    asyncio.run(main())


@misuse("ends the block before a list was fed", "the list is fed to its end")
def test_block_that_ends_before_a_list(run: Run[Any]) -> None:
    async def main(loop: VirtualLoop) -> list[Any]:
        async with operator_of(clock=loop.time_ns) as operator:
            operator.feed(list("abcde"))
        return [item.value async for item in operator]

    assert len(run(main)) == 5


@pytest.mark.parametrize(
    ("messages", "error"),
    [(range(100), Full), (itertools.count(), Closed), (spaced(1, 2), Closed), (iter("ab"), Closed)],
)
@misuse("ends the block before anything was read of a stream", "an error at the end of the block")
def test_block_that_nobody_reads(run: Run[Any], messages: Any, error: type[Exception]) -> None:
    async def main(loop: VirtualLoop) -> None:
        async with operator_of(clock=loop.time_ns) as operator:
            operator.feed(messages)

    with pytest.raises(error, match="read the items within the block"):
        run(main)


@misuse("leaves the block in the midst of a list", "logged: the rest was not taken; counted")
def test_block_left_in_the_midst(run: Run[Any], caplog: pytest.LogCaptureFixture) -> None:
    async def main(loop: VirtualLoop) -> int:
        async with operator_of(clock=loop.time_ns) as operator:
            operator.feed(range(100))
            await operator.read()
        return operator.counts["operator", "message", "not taken"]

    left = run(main)
    assert 80 < left < 100
    assert f"{100 - left} were taken, {left} were not" in caplog.text


@misuse("feeds messages and reads no items", "logged after five seconds")
def test_feed_that_nobody_reads(run: Run[Any], caplog: pytest.LogCaptureFixture) -> None:
    async def main(loop: VirtualLoop) -> None:
        async with operator_of(clock=loop.time_ns, output_len=4) as operator:
            operator.feed(range(20))
            await asyncio.sleep(4.9)
            assert "items wait to be read" not in caplog.text
            await asyncio.sleep(0.2)
            assert "4 items wait to be read" in caplog.text
            assert len([item async for item in operator]) == 20

    run(main)


@misuse("makes a second reader of `Items` and does not read it", "logged after five seconds")
def test_reader_that_holds_the_other_back(run: Run[Any], caplog: pytest.LogCaptureFixture) -> None:
    async def main(loop: VirtualLoop) -> None:
        async with operator_of(clock=loop.time_ns, output_len=2) as operator:
            items = Items(operator, output_len=2)
            other = items.new_reader()
            operator.feed(range(50))
            with contextlib.suppress(asyncio.TimeoutError):
                await asyncio.wait_for(_all(items), 11.0)
            del other
            operator.stop()

    run(main)
    assert "items wait to be read" in caplog.text


async def _all(items: Items[Any]) -> None:
    async for _ in items:
        pass


class Ends(BaseException):
    """Is neither an `Exception` nor an exception that ends a program."""


def cancelled() -> Any:
    future: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
    future.cancel()
    return future.result()


def ends() -> Any:
    raise Ends


@pytest.mark.parametrize(("end", "error"), [(cancelled, RuntimeError), (ends, Ends)])
@pytest.mark.parametrize("kind", ["plain", "async"])
@misuse("feeds a stream that ends in `CancelledError`", "the items end; an error after the block")
def test_stream_that_is_cancelled(
    run: Run[Any], end: Callable[[], Any], error: type[BaseException], kind: str
) -> None:
    def plain() -> Iterator[int]:
        yield 1
        yield end()

    async def later() -> AsyncIterator[int]:
        yield 1
        yield end()

    async def main(loop: VirtualLoop) -> list[Any]:
        values = []
        with pytest.raises(error):
            async with operator_of(clock=loop.time_ns) as operator:
                operator.feed(plain() if kind == "plain" else later())
                values = [item.value async for item in operator]
        return values

    assert run(main) == ["1 on board"]


@pytest.mark.parametrize("where", ["message", "situation", "substitute", "policy", "side", "state"])
@misuse("asks in a handler for the result of a task that was cancelled", "the handler fails")
def test_cancelled_in_a_handler(run: Run[Any], where: str) -> None:
    def cancels(*_: Any) -> Any:
        return cancelled()

    async def fails(message: Any, t: int) -> Any:
        raise ValueError

    def prepare(operator: Operator[Any, Any], _: VirtualLoop) -> None:
        if where == "situation":
            operator.use_situation(cancels)
        if where == "substitute":
            operator.use_substitute(cancels)
        if where == "side":
            operator.use_side_request(echo, cancels, print)
        if where == "state":
            operator.use_state(CarriedState(0), cancels)
        message = cancels if where == "message" else ask
        policy = cancels if where == "policy" else None
        handle: Any = fails if where == "substitute" else echo
        operator.use_cloud(handle, message, str, 1, policy=policy)

    local = {"local": fails} if where == "substitute" else {}
    items, counts = played(run, prepare, of="abc", **local)
    assert [item.timestamp for item in items] == [0, 1, 2]
    outcomes = ("failed", "handler failed")
    assert sum(count for (*_, outcome), count in counts.items() if outcome in outcomes) == 3


@misuse("gives a join items that end in `CancelledError`", "logged; no set waits for them")
def test_joined_items_that_are_cancelled(run: Run[Any], caplog: pytest.LogCaptureFixture) -> None:
    async def items() -> AsyncIterator[Any]:
        await asyncio.sleep(0.1)
        yield cancelled()

    async def main(loop: VirtualLoop) -> Any:
        join = Join(wait=50.0, clock=loop.time_ns)
        join.items("west", items())
        east = join.aligned("east")
        async with join:
            east.write("a", Lineage("rig", 1))
            begin, joined = loop.time(), await join.read()
            return None if joined is None else (joined.missing, loop.time() < begin + 1)

    assert run(main) == (["west"], True)
    assert "the input west ends" in caplog.text


# Readers that give up.


@pytest.mark.parametrize("kind", ["in_order", "last_only", "plain", "generator"])
@misuse("gives up a read of `Items` after a timeout", "the next read has what it would have had")
def test_read_that_gives_up(run: Run[Any], kind: str) -> None:
    async def local(message: Any, t: int) -> Any:
        await asyncio.sleep(message)
        return message

    async def copied(operator: Operator[Any, Any]) -> AsyncIterator[Any]:
        async for item in operator:
            yield item

    async def main(loop: VirtualLoop) -> list[Any]:
        async with operator_of(local, clock=loop.time_ns) as operator:
            items: Items[Any] = Items(copied(operator) if kind == "generator" else operator)
            if kind == "in_order":
                items = items.in_order(0.5, clock=loop.time_ns)
            if kind == "last_only":
                items = items.last_only()
            values = []
            for message in (0.3, 0.25, 0.01):
                operator.write(message)
                for _ in range(2):
                    with contextlib.suppress(asyncio.TimeoutError):
                        item = await asyncio.wait_for(items.read(), 0.1)
                        values.append(item and item.value)
            operator.close()
            return values + [item.value async for item in items]

    assert run(main) == [0.3, 0.25, 0.01]


@misuse("lets two tasks read one operator, `Items` or join", "logged once: each gets a part")
def test_two_tasks_that_share_a_reader(run: Run[Any], caplog: pytest.LogCaptureFixture) -> None:
    async def shared(items: Any) -> list[int]:
        async def count() -> int:
            return len([item async for item in items])

        return list(await asyncio.gather(count(), count()))

    async def main(loop: VirtualLoop) -> list[list[int]]:
        counts = []
        for reads in (lambda it: it, Items):
            async with operator_of(clock=loop.time_ns) as operator:
                operator.feed(spaced(*range(8)))
                counts.append(await shared(reads(operator)))
        join = Join(clock=loop.time_ns, wait=0.1)
        left = join.aligned("left")
        async with join:
            reading = asyncio.create_task(shared(join))
            for seq in range(8):
                await asyncio.sleep(0.01)
                left.write(seq, Lineage("left", seq))
            left.close()
            counts.append(await reading)
        return counts

    assert [sum(it) for it in run(main)] == [8, 8, 8]
    said = [it.getMessage() for it in caplog.records if "share the items" in it.getMessage()]
    assert [it.split(":")[0] for it in said] == ["operator", "Items", "join"], said


def test_readers_one_after_another_are_not_reported(
    run: Run[Any], caplog: pytest.LogCaptureFixture
) -> None:
    async def main(loop: VirtualLoop) -> None:
        async with operator_of(clock=loop.time_ns) as operator:
            operator.feed(spaced(*range(8), seconds=0.2))
            for _ in range(3):
                with contextlib.suppress(asyncio.TimeoutError):
                    await asyncio.wait_for(operator.__anext__(), 0.1)
                assert await asyncio.create_task(operator.read()) is not None
            items = Items(operator)
            other = items.new_reader()
            await asyncio.gather(items.read(), other.read())
            assert [item async for item in other]

    run(main)
    assert "share the items" not in caplog.text


@misuse("reads items that fail with two readers", "each of them gets the error")
def test_items_that_fail_for_two_readers(run: Run[Any]) -> None:
    async def items() -> AsyncIterator[int]:
        yield 1
        raise OSError("the socket broke")

    async def main(loop: VirtualLoop) -> None:
        one = Items(items())
        other = one.new_reader()
        for reader in (one, other):
            assert await reader.read() == 1
            for _ in range(2):
                with pytest.raises(OSError, match="the socket broke"):
                    await reader.read()

    run(main)


class Watchdog(Exception):
    """Raised by a signal."""


@misuse("interrupts `BlockingOperator.read`", "the next read has the item")
def test_read_that_is_interrupted() -> None:
    def bark(*_: Any) -> None:
        raise Watchdog

    def slow(message: Any, t: int) -> Any:
        time.sleep(0.05)
        return message

    before = signal.signal(signal.SIGALRM, bark)
    values = []
    try:
        with BlockingOperator(Operator(Local.threads(slow, deadline=30.0))) as operator:
            for message in range(20):
                operator.write(message)
                # The interrupt comes early, late, or just when the item comes.
                signal.setitimer(signal.ITIMER_REAL, 0.045 + message * 0.0005)
                with contextlib.suppress(Watchdog):
                    item = operator.read()
                    signal.setitimer(signal.ITIMER_REAL, 0)
                    values.append(item and item.value)
                signal.setitimer(signal.ITIMER_REAL, 0)
            operator.close()
            values += [item.value for item in operator]
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert values == list(range(20))


@pytest.mark.parametrize("timeout", [ns(1_000_000), timedelta(milliseconds=1), 0.001, 0, -1])
@misuse("gives a timeout as `ns` or a `timedelta`", "taken as the duration that it is")
def test_timeout_with_a_unit(timeout: Any) -> None:
    with BlockingOperator(operator_of()) as operator:
        assert operator.read(timeout) is None


@pytest.mark.parametrize("timeout", ["1", True, float("nan"), object()])
@misuse("gives a timeout that is no duration", "`TypeError`")
def test_timeout_that_is_none(timeout: Any) -> None:
    with (
        BlockingOperator(operator_of()) as operator,
        pytest.raises(TypeError, match="seconds as a number"),
    ):
        operator.read(timeout)


# Threads and what ends them.


def leaves(*_: Any) -> Any:
    sys.exit("not calibrated")


async def leaves_later(*_: Any) -> Any:
    await asyncio.sleep(0.001)
    sys.exit("not calibrated")


def plainly(message: Any, t: int) -> Any:
    return message


CLOUD = (ask, str, 1)


@pytest.mark.parametrize(
    "make",
    [
        lambda: (Operator(leaves), None),
        lambda: (Operator(Local.task(leaves_later)), None),
        lambda: (Operator(plainly), (leaves_later, *CLOUD)),
        lambda: (Operator(plainly), (echo, ask, leaves, 1)),
    ],
)
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@misuse("calls `sys.exit` in a call of a `BlockingOperator`", "a failure; logged; it goes on")
def test_exit_in_a_call(make: Any, caplog: pytest.LogCaptureFixture) -> None:
    operator, cloud = make()
    if cloud is not None:
        operator.use_cloud(*cloud)
    with BlockingOperator(operator) as blocking:
        for message in range(3):
            blocking.write(message)
            item = blocking.read(timeout=5.0)
            assert item is not None
            assert "not calibrated" in item.failures[0].why
    assert "SystemExit: not calibrated in a call" in caplog.text
    gc.collect()


@misuse("calls `sys.exit` in a message handler of a `BlockingOperator`", "`write` raises it")
def test_exit_in_a_message_handler() -> None:
    operator = Operator(plainly)
    operator.use_cloud(echo, leaves, str, 1)
    with BlockingOperator(operator) as blocking:
        with pytest.raises(SystemExit, match="not calibrated"):
            blocking.write(1)
        item = blocking.read(timeout=5.0)
        assert item is not None
        assert item.value == 1
    del blocking
    gc.collect()


@misuse("uses a `BlockingOperator` in a process that was forked", "`RuntimeError`")
def test_fork_of_a_blocking_operator(capfd: Any) -> None:
    with BlockingOperator(operator_of()) as operator:
        read, write = os.pipe()
        child = os.fork()
        if child == 0:
            signal.alarm(5)
            try:
                operator.write(1)
            except RuntimeError as error:
                os.write(write, str(error).encode())
            os._exit(0)
        os.close(write)
        os.waitpid(child, 0)
        assert b"forked" in os.read(read, 100)
        os.close(read)


@misuse("writes to a join in another thread", "taken in the loop's turn, or the error is raised")
def test_join_written_elsewhere() -> None:
    async def main() -> list[Any]:
        join = Join(wait=5.0, output_len=2)
        left, right = join.aligned("left"), join.aligned("right")
        raised: list[BaseException | None] = []

        def camera() -> None:
            raised.extend(elsewhere(partial(left.write, it, Lineage("rig", it))) for it in range(3))
            raised.append(elsewhere(left.close))
            raised.append(elsewhere(lambda: left.write(3, Lineage("rig", 3))))

        async with join:
            for seq in range(3):
                right.write(seq, Lineage("rig", seq))
            thread = threading.Thread(target=camera)
            thread.start()
            while thread.is_alive():
                await asyncio.sleep(0.001)
            assert [type(it) for it in raised] == [type(None)] * 2 + [Full, type(None), Closed]
            return [(await anext(join)).set for _ in range(2)]

    assert asyncio.run(main()) == [{"left": it, "right": it} for it in range(2)]


@misuse("writes to a join in another thread while the loop is held up", "`Full`; it is not taken")
def test_join_whose_loop_is_held_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fuseline._join.HANDOVER", 0.02)

    async def main() -> None:
        join = Join()
        left = join.aligned("left")
        async with join:
            error = elsewhere(lambda: left.write(1, Lineage("rig", 1)))
            assert isinstance(error, Full)
            await asyncio.sleep(0.05)
            left.write(2, Lineage("rig", 1))
            joined = await join.read()
            assert joined is not None
            assert joined.set == {"left": 2}

    logging.getLogger("asyncio").setLevel(logging.ERROR)
    asyncio.run(main())
