"""Tests misuse of threads, lifetimes, loops and values. See test_misuse.py."""

from __future__ import annotations

import asyncio
import logging
from typing import Any

import fuseline
import pytest
from conftest import Run
from fuseline import (
    BlockingOperator,
    Call,
    Closed,
    Cloud,
    ConfigError,
    Ending,
    Full,
    Fusion,
    Join,
    Local,
    Operator,
    StampedValue,
)
from fuseline.robot import Always, Hold
from fuseline.testing import VirtualLoop
from misuse import Counts, ask, echo, elsewhere, misuse, operator_of, played, refused


class Idle:
    """Answers 0 to everything, as a remote policy."""

    def infer(self, observation: Any) -> float:
        return 0.0

    def close(self) -> None:
        pass


# Threads and lifetimes.


@misuse("writes in another thread", "`RuntimeError`: `write_threadsafe`")
def test_write_elsewhere() -> None:
    async def main() -> BaseException | None:
        async with operator_of() as operator:
            return elsewhere(lambda: operator.write(1))

    assert "write_threadsafe" in str(asyncio.run(main()))


@misuse("stops or closes in another thread", "`RuntimeError`: `call_soon_threadsafe`")
def test_stop_elsewhere() -> None:
    async def main() -> list[BaseException | None]:
        async with operator_of() as operator:
            return [elsewhere(operator.stop), elsewhere(operator.close)]

    assert all("call_soon_threadsafe" in str(error) for error in asyncio.run(main()))


@misuse("writes from another thread while the loop is held up", "`Full` beyond the window; counted")
def test_too_many_on_their_way() -> None:
    async def main() -> Counts:
        async with operator_of(window=2) as operator:
            written = [elsewhere(lambda: operator.write_threadsafe(1)) for _ in range(3)]
            assert [type(error) for error in written] == [type(None), type(None), Full]
            operator.stop()
            return operator.counts

    assert asyncio.run(main())["operator", "message", "not taken"] == 1


@misuse("ignores that a message from another thread was not taken", "counted and logged")
def test_ignored_future(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> Counts:
        async with operator_of(output_len=1) as operator:
            for number in range(3):
                operator.write_threadsafe(1)
                while operator.counts["operator", "message", "not taken"] < number:
                    await asyncio.sleep(0)
                while not operator._output.items:
                    await asyncio.sleep(0)
            operator.stop()
            return operator.counts

    assert asyncio.run(main())["operator", "message", "not taken"] == 2
    assert "not taken" in caplog.text


@misuse("writes before the start", "`ConfigError`")
def test_write_before_the_start() -> None:
    refused("has not started", lambda: operator_of().write(1))


@misuse("writes after `close`", "`Closed`")
def test_write_after_close() -> None:
    async def main() -> None:
        async with operator_of() as operator:
            operator.close()
            with pytest.raises(Closed):
                operator.write(1)

    asyncio.run(main())


@misuse("starts an operator twice", "`ConfigError`")
def test_started_twice() -> None:
    async def main() -> None:
        async with operator_of() as operator:
            with pytest.raises(ConfigError, match="started before"):
                await operator.start()

    asyncio.run(main())


@misuse("registers a cloud after the start", "`ConfigError`")
def test_cloud_after_the_start() -> None:
    async def main() -> None:
        async with operator_of() as operator:
            refused("register it before", lambda: operator.use_cloud(echo, ask, str, 1))

    asyncio.run(main())


@misuse("writes to an operator in one of its own handlers", "the handler fails; counted")
def test_write_in_a_handler(run: Run[Any], caplog: pytest.LogCaptureFixture) -> None:
    def prepare(operator: Operator[Any, Any], _: VirtualLoop) -> None:
        operator.use_cloud(echo, lambda m, t: operator.write(m), str, 1)  # type: ignore[arg-type, return-value]

    _, counts = played(run, prepare)
    assert counts["cloud-1", "handler", "failed"] == 1
    assert "must not write to its own operator" in caplog.text


@misuse("waits for a `BlockingOperator` in one of its handlers", "`RuntimeError`")
def test_wait_for_oneself() -> None:
    raised: list[str] = []

    def wanted(message: Any, t: int) -> Any:
        try:
            front.write(message)
        except RuntimeError as error:
            raised.append(str(error))

    inner = operator_of()
    inner.use_cloud(echo, wanted, str, 1)
    with BlockingOperator(inner) as front:
        front.write(1)
        front.read()
    assert "must not wait for its own" in raised[0]


@misuse("uses a `BlockingOperator` after its end", "`ConfigError`")
def test_front_after_its_end() -> None:
    with BlockingOperator(operator_of()) as front:
        pass
    refused("does not run", lambda: front.write(1))


# Blocked loops.


def blocked(run: Run[Any], who: str) -> Counts:
    def prepare(operator: Operator[Any, Any], loop: VirtualLoop) -> None:
        def block(name: str) -> None:
            loop.block(0.4 if name == who else 0.0)

        async def handle(request: Any, call: Call) -> Any:
            block("handle")
            return request

        def wanted(message: Any, t: int) -> Any:
            block("message handler")
            return message, 10.0

        operator.use_cloud(handle, wanted, str, 1)

    return played(run, prepare)[1]


@misuse("encodes for 400 ms in the handle", "counted as `held up the loop`, and logged")
def test_handle_that_blocks(run: Run[Any], caplog: pytest.LogCaptureFixture) -> None:
    assert blocked(run, "handle")["cloud-1", "handler", "held up the loop"] == 1
    assert "held up the event loop" in caplog.text


@misuse("blocks in the message handler", "counted as `held up the loop`, and logged")
def test_message_handler_that_blocks(run: Run[Any], caplog: pytest.LogCaptureFixture) -> None:
    assert blocked(run, "message handler")["cloud-1", "handler", "held up the loop"] == 1
    assert "held up the event loop" in caplog.text


@misuse("blocks the loop beside the operator", "the late timer is counted and logged")
def test_somebody_who_blocks(run: Run[Any], caplog: pytest.LogCaptureFixture) -> None:
    async def slow(message: Any, t: int) -> Any:
        await asyncio.sleep(3600)

    async def main(loop: VirtualLoop) -> Counts:
        operator = operator_of(Local.task(slow, deadline=0.1), clock=loop.time_ns)
        async with operator:
            operator.write("a")
            loop.block(0.5)
            await operator.read()
            return operator.counts

    assert run(main)["operator", "timer", "late"] == 1
    assert "a timer was served late" in caplog.text


@misuse("computes on board what never ends", "missed at its deadline; counted as lost, and logged")
def test_local_that_hangs(run: Run[Any], caplog: pytest.LogCaptureFixture) -> None:
    async def hangs(message: Any, t: int) -> Any:
        await asyncio.sleep(3600)

    (item,), counts = played(run, lambda *_: None, local=hangs)
    assert item.ending is Ending.MISSED
    assert counts["local", "request", "lost"] == 1
    assert "it occupies its worker until it ends" in caplog.text


# Values lost.


@misuse("does not read the items", "`Full`")
def test_items_that_nobody_reads() -> None:
    async def main() -> None:
        async with operator_of(output_len=1) as operator:
            operator.write(1)
            while not operator._output.items:
                await asyncio.sleep(0)
            with pytest.raises(Full):
                operator.write(2)

    asyncio.run(main())


@misuse("writes more than the window holds", "an item that is refused `full`")
def test_more_than_the_window(run: Run[Any]) -> None:
    async def main(loop: VirtualLoop) -> list[Ending]:
        operator = operator_of(window=1, clock=loop.time_ns)
        async with operator:
            operator.write(1)
            operator.write(2)
            operator.close()
            return [item.ending async for item in operator]

    assert run(main) == [Ending.REFUSED, Ending.FORWARDED]


@misuse("feeds faster than the operator computes", "the feed waits for room in the window")
def test_feed_that_is_too_fast(run: Run[Any]) -> None:
    async def slow(message: Any, t: int) -> Any:
        await asyncio.sleep(0.01)
        return message

    async def main(loop: VirtualLoop) -> list[Ending]:
        operator = operator_of(slow, clock=loop.time_ns)
        async with operator:
            operator.feed(range(100))
            return [item.ending async for item in operator]

    assert run(main) == [Ending.FORWARDED] * 100


@misuse("answers with a value of another message", "a failure with the reason (D2)")
def test_value_of_another_message(run: Run[Any]) -> None:
    stamped: Any = lambda value: StampedValue(value, 7)  # noqa: E731
    (item,), _ = played(run, lambda it, _: it.use_cloud(echo, ask, stamped, 1))
    assert "message 7" in item.failures[0].why


@misuse("feeds from a source that fails", "its exception is raised at the end of the block")
def test_feed_that_fails() -> None:
    def frames() -> Any:
        yield 1
        raise OSError("the camera is gone")

    async def main() -> None:
        async with operator_of() as operator:
            operator.feed(frames())
            async for _ in operator:
                pass

    refused("the camera is gone", lambda: asyncio.run(main()), OSError)


@misuse("opens the machine's timestamps out of order", "refused `order`")
def test_timestamps_out_of_order() -> None:
    fusion = Fusion([Cloud(1)])
    fusion.open(0, 2)
    assert fusion.open(1, 1)[1] == fuseline.Refused(fuseline.OpenRefusal.ORDER)


@misuse("gives the machine a result twice", "dropped, with the reason")
def test_result_twice() -> None:
    fusion = Fusion([Cloud(1)])
    fusion.open(0, 1)
    fusion.offer(0, 1, 1, 0.5)
    fusion.result(1, 1, 1)
    assert fusion.result(2, 1, 1)[1] == fuseline.Dropped(fuseline.DropReason.SUPERSEDED)


logging.getLogger("asyncio").setLevel(logging.ERROR)


@misuse("asks for a count by a misspelt key", "`KeyError`, with the nearest")
def test_misspelt_count(run: Run[Any]) -> None:
    async def main(loop: VirtualLoop) -> None:
        operator = operator_of(clock=loop.time_ns)
        operator.use_cloud(echo, ask, str, 1, name="west")
        operator.use_side_request(echo, ask, lambda _: None, name="plan")
        async with operator:
            operator.write("a")
            assert await operator.read() is not None
            counts = operator.counts
        known = [
            ("west", "result", "forwarded"),
            ("west", "result", "dropped late"),
            ("west", "failed because", "the moon"),
            ("operator", "message", "refused full"),
            ("operator", "message", "not taken"),
            ("plan", "side request", "expired"),
        ]
        assert [counts[key] for key in known] == [1, 0, 0, 0, 0, 0]
        for key in [("west", "result", "forwareded"), ("weste", "result", "forwarded")]:
            with pytest.raises(KeyError, match=r"nearest is \('west', 'result', 'forwarded'\)"):
                counts[key]
        join = Join()
        join.aligned("left")
        assert join.counts["left", "message", "dropped late"] == 0
        with pytest.raises(KeyError, match="'dropped late'"):
            join.counts["left", "message", "late"]

    run(main)
    with Always(Idle, Hold(0.0), period=2.0) as policy:
        assert policy.counts["remote", "call", "failed"] == 0
        with pytest.raises(KeyError, match="'call', 'failed'"):
            policy.counts["remote", "call", "failures"]
