"""Cases of misuse: each is refused with the remedy, or reported; none ends in silence."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections import Counter
from collections.abc import Callable
from datetime import timedelta
from typing import Any

import fuseline
import pytest
from conftest import Run, VirtualLoop
from fuseline import (
    BlockingOperator,
    Call,
    Closed,
    Cloud,
    ConfigError,
    DeadlineError,
    Ending,
    Full,
    Fusion,
    Item,
    Lineage,
    Local,
    Operator,
    StampedValue,
    TimeError,
    ns,
)
from fuseline.deadline import Guard, Parameters, Situation
from misuse import misuse

MS = 0.001
Counts = Counter[tuple[str, str, str]]


async def echo(request: Any, call: Call) -> Any:
    return request


async def on_board(message: Any, t: int) -> Any:
    return f"{message} on board"


def ask(message: Any, t: int) -> Any:
    return message, 0.1


def operator_of(local: Any = on_board, **of: Any) -> Operator[Any, Any]:
    return Operator(local, **of)


def refused(message: str, make: Callable[[], Any], kind: type[Exception] = ConfigError) -> None:
    with pytest.raises(kind, match=message):
        make()


def cloud_refused(message: str, *of: Any, **options: Any) -> None:
    refused(message, lambda: operator_of().use_cloud(*of, **options))


def played(
    run: Run[Any], prepare: Callable[[Operator[Any, Any], VirtualLoop], None], **of: Any
) -> tuple[list[Item[Any]], Counts]:
    """One message, with what was prepared."""

    async def main(loop: VirtualLoop) -> tuple[list[Item[Any]], Counts]:
        operator = operator_of(clock=loop.nanos, **of)
        prepare(operator, loop)
        async with operator:
            operator.feed(["a"])
            return [item async for item in operator], operator.counts

    return run(main)  # type: ignore[no-any-return]


def elsewhere(work: Callable[[], Any]) -> BaseException | None:
    """What it raises in another thread."""
    raised: list[BaseException] = []

    def run() -> None:
        try:
            work()
        except BaseException as error:
            raised.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    return raised[0] if raised else None


# Units and signs.


@misuse("gives an `int` for a duration", "`TypeError`: `20.0` for seconds or `ns(20)`")
def test_int_for_a_duration() -> None:
    refused(
        r"write 20\.0 for seconds, or ns\(20\)",
        lambda: Local.task(on_board, deadline=20),
        TypeError,
    )


@misuse("gives `ns` of a fraction", "`TypeError`")
def test_fraction_of_a_nanosecond() -> None:
    refused("whole number", lambda: ns(0.5), TypeError)  # type: ignore[arg-type]


@misuse("gives `ns` below 0", "`TimeError`")
def test_ns_below_0() -> None:
    refused("from 0 to", lambda: ns(-1), TimeError)


@misuse("gives local a deadline below 0, as what is left of a budget", "`TimeError`")
def test_local_deadline_below_0() -> None:
    refused("0 or more", lambda: Local.task(on_board, deadline=0.1 - 0.12), TimeError)


@misuse("gives local a deadline of 0", "`ConfigError`")
def test_local_deadline_of_0() -> None:
    refused("would be refused", lambda: Local.task(on_board, deadline=0.0))


@misuse("gives local a `timedelta` below 0", "`TimeError`")
def test_timedelta_below_0() -> None:
    refused("0 or more", lambda: Local.task(on_board, deadline=timedelta(seconds=-1)), TimeError)


@misuse("offers a deadline below 0", "no request; counted as `handler`, `failed`, and logged")
def test_offered_deadline_below_0(run: Run[Any], caplog: pytest.LogCaptureFixture) -> None:
    _, counts = played(run, lambda it, _: it.use_cloud(echo, lambda m, t: (m, -0.02), str, 1))
    assert counts["cloud-1", "handler", "failed"] == 1
    assert "0 or more" in caplog.text


@misuse("offers a plain `int` of milliseconds", "no request; counted and logged")
def test_offered_int(run: Run[Any], caplog: pytest.LogCaptureFixture) -> None:
    _, counts = played(run, lambda it, _: it.use_cloud(echo, lambda m, t: (m, 100), str, 1))
    assert counts["cloud-1", "handler", "failed"] == 1
    assert "write 100.0 for seconds" in caplog.text


@misuse("gives milliseconds for a figure in seconds", "`DeadlineError`, with the range")
def test_milliseconds_for_seconds() -> None:
    refused("from 0.000001 to 60 s", lambda: Guard(Parameters(local_response=301.7)), DeadlineError)


@misuse("gives a duration for a speed", "`TypeError`")
def test_duration_for_a_speed() -> None:
    refused("m/s", lambda: Guard().judge(Situation(speed=ns(11))), TypeError)


@misuse("gives the instant of capture in seconds", "`TypeError`: nanoseconds")
def test_capture_in_seconds() -> None:
    refused("give nanoseconds", lambda: Lineage("cam", 1, captured=1.5), TypeError)  # type: ignore[arg-type]


@misuse("reads the machine's clock in seconds", "`TypeError`")
def test_clock_in_seconds() -> None:
    refused("nanoseconds", lambda: Fusion([Cloud(1)]).open(0.5, 1), TypeError)  # type: ignore[arg-type]


# Shapes.


@misuse("gives a handle that is not async", "`ConfigError`: `async def`, `asyncio.to_thread`")
def test_plain_handle() -> None:
    def handle(request: Any, call: Call) -> Any:
        return request

    cloud_refused("is not async", handle, ask, str, 1)


@misuse("gives a handle that yields", "`ConfigError`")
def test_generator_for_a_handle() -> None:
    async def handle(request: Any, call: Call) -> Any:
        yield request

    cloud_refused("yields nothing", handle, ask, str, 1)


@misuse(
    "gives a lambda for a handle that returns a value", "a failure of each message, with the reason"
)
def test_lambda_that_returns_a_value(run: Run[Any]) -> None:
    handle: Any = lambda request, call: "x"  # noqa: E731
    (item,), counts = played(run, lambda it, _: it.use_cloud(handle, ask, str, 1))
    assert "await" in item.failures[0].why
    assert counts["cloud-1", "failure", "accepted"] == 1


@misuse("gives a class for a handle", "`ConfigError`: an instance")
def test_class_for_a_handle() -> None:
    cloud_refused("give an instance", Call, ask, str, 1)


@misuse("gives a handle that cannot be called", "`ConfigError`")
def test_handle_that_cannot_be_called() -> None:
    cloud_refused("is a function", "west:50051", ask, str, 1)


@misuse("gives an async message handler", "`ConfigError`")
def test_async_message_handler() -> None:
    cloud_refused("not an async def", echo, echo, str, 1)


@misuse("gives a response handler that cannot be called", "`ConfigError`")
def test_response_handler_that_cannot_be_called() -> None:
    cloud_refused("a response handler", echo, ask, None, 1)


@misuse("gives a class for a policy", "`ConfigError`: an instance")
def test_class_for_a_policy() -> None:
    cloud_refused("give an instance", echo, ask, str, 1, policy=Guard)


@misuse("gives a policy without `ended`", "`ConfigError`")
def test_half_a_policy() -> None:
    class HalfPolicy:
        def decide(self, situation: Any, cap: Any) -> Any: ...

    cloud_refused("both methods", echo, ask, str, 1, policy=HalfPolicy())


@misuse("gives a class for local", "`ConfigError`: an instance")
def test_class_for_local() -> None:
    refused("give an instance", lambda: operator_of(Call))


@misuse("gives local a function that is not async for tasks", "`ConfigError`: `Local.threads`")
def test_plain_local_for_tasks() -> None:
    refused("Local.threads", lambda: Local.task(ask))


@misuse("gives two clouds one priority", "`ConfigError`")
def test_one_priority_twice() -> None:
    operator = operator_of()
    operator.use_cloud(echo, ask, str, 1)
    refused("two clouds", lambda: operator.use_cloud(echo, ask, str, 1))


@misuse("gives a priority of `True`, `1.0` or `'1'`", "`ConfigError`")
@pytest.mark.parametrize("priority", [True, 1.0, "1"])
def test_odd_priority(priority: Any) -> None:
    cloud_refused("an int from 1 to 65535", echo, ask, str, priority)


@misuse("gives a cloud the priority 0, which is local's", "`ConfigError`")
def test_priority_of_local() -> None:
    cloud_refused("local has 0", echo, ask, str, 0)


@misuse("gives 0 calls at once", "`ConfigError`")
def test_no_calls() -> None:
    cloud_refused("calls at once", echo, ask, str, 1, calls=0)


@misuse("gives a gate that never opens again", "`ConfigError` at the start")
def test_gate_that_never_opens() -> None:
    async def main() -> None:
        operator = operator_of()
        operator.use_cloud(echo, ask, str, 1, limit=2, resume=2)
        with pytest.raises(ConfigError, match="resume below its limit"):
            await operator.start()

    asyncio.run(main())


@misuse("returns from the message handler what is no pair", "no request; counted and logged")
def test_no_pair(run: Run[Any], caplog: pytest.LogCaptureFixture) -> None:
    _, counts = played(run, lambda it, _: it.use_cloud(echo, lambda m, t: 7, str, 1))  # type: ignore[arg-type, return-value]
    assert counts["cloud-1", "handler", "failed"] == 1
    assert "the message handler of cloud-1 failed" in caplog.text


@misuse("uses a policy that raises", "no request; counted as `policy`, `failed`, and logged")
def test_policy_that_raises(run: Run[Any], caplog: pytest.LogCaptureFixture) -> None:
    def policy(situation: Any, cap: Any) -> Any:
        raise OSError("no map")

    _, counts = played(run, lambda it, _: it.use_cloud(echo, ask, str, 1, policy=policy))
    assert counts["cloud-1", "policy", "failed"] == 1
    assert "no map" in caplog.text


@misuse("uses a handler of situations that raises", "nothing is known; counted and logged")
def test_situation_that_raises(run: Run[Any], caplog: pytest.LogCaptureFixture) -> None:
    def situation(message: Any, t: int) -> Any:
        raise OSError("no speed")

    _, counts = played(run, lambda it, _: it.use_situation(situation))
    assert counts["operator", "handler", "failed"] == 1
    assert "no speed" in caplog.text


@misuse("lets a lower cloud's timer be earlier under eager", "a warning at the first message (A4)")
def test_eager_that_gives_a_chance_away(run: Run[Any], caplog: pytest.LogCaptureFixture) -> None:
    def prepare(operator: Operator[Any, Any], _: VirtualLoop) -> None:
        operator.use_cloud(echo, ask, str, 1)
        operator.use_cloud(echo, lambda m, t: (m, 0.2), str, 2)

    played(run, prepare)
    assert "A4" in caplog.text


@misuse("uses a guard under progressive", "`ConfigError` at the start, with the remedy")
def test_guard_under_progressive() -> None:
    async def main() -> None:
        operator = operator_of(commit="progressive")
        operator.use_cloud(echo, ask, str, 1, policy=Guard())
        with pytest.raises(ConfigError, match="another policy"):
            await operator.start()

    asyncio.run(main())


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
            for _ in range(3):
                operator.write_threadsafe(1)
                await asyncio.sleep(0.02)
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
            with pytest.raises(ConfigError, match="started once"):
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
            loop._leaping.leapt += 0.4 if name == who else 0.0

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
        operator = operator_of(Local.task(slow, deadline=0.1), clock=loop.nanos)
        async with operator:
            operator.write("a")
            loop._leaping.leapt += 0.5
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
    assert "keeps its place" in caplog.text


# Values lost.


@misuse("does not read the items", "`Full`")
def test_items_that_nobody_reads() -> None:
    async def main() -> None:
        async with operator_of(output_len=1) as operator:
            operator.write(1)
            await asyncio.sleep(0.01)
            with pytest.raises(Full):
                operator.write(2)

    asyncio.run(main())


@misuse("writes more than the window holds", "an item that is refused `full`")
def test_more_than_the_window(run: Run[Any]) -> None:
    async def main(loop: VirtualLoop) -> list[Ending]:
        operator = operator_of(window=1, clock=loop.nanos)
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

    async def main(loop: VirtualLoop) -> list[Ending]:
        operator = operator_of(slow, clock=loop.nanos)
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
