"""Tests misuse of arguments. Each case is refused with the remedy, or reported."""

from __future__ import annotations

import asyncio
import logging
from datetime import timedelta
from typing import Any

import numpy
import pytest
from conftest import Run
from fuseline import (
    Call,
    Cloud,
    ConfigError,
    DeadlineError,
    Ending,
    Fusion,
    Item,
    Lineage,
    Local,
    Operator,
    TimeError,
    nanoseconds,
    ns,
)
from fuseline.deadline import Guard, Parameters, Situation
from fuseline.testing import VirtualLoop
from misuse import (
    ask,
    cloud_refused,
    echo,
    misuse,
    on_board,
    operator_of,
    played,
    refused,
    wiring_errors,
)

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


@misuse("gives a duration as NumPy's `float32`", "taken as seconds, as any float; below 0 refused")
def test_float32_for_a_duration() -> None:
    assert nanoseconds(numpy.float32(0.25)) == 250_000_000
    refused("0 or more", lambda: nanoseconds(numpy.float32(-0.25)), TimeError)


@misuse("gives a duration as one of NumPy's whole numbers", "`TypeError`, as of an `int`")
def test_numpy_int_for_a_duration() -> None:
    refused("seconds as a float", lambda: nanoseconds(numpy.int64(20)), TypeError)


@misuse("offers milliseconds as seconds", "refused `deadline` above `greatest_deadline`; counted")
def test_milliseconds_for_a_deadline(run: Run[Any]) -> None:
    (item,), counts = played(run, lambda it, _: it.use_cloud(echo, lambda m, t: (m, 400.0), str, 1))
    assert counts["cloud-1", "request", "refused deadline"] == 1
    assert item.value == "a on board"


@misuse("gives local milliseconds as seconds", "`ConfigError`")
def test_milliseconds_for_local() -> None:
    local = Local.task(on_board, deadline=400.0)
    refused("above the greatest", lambda: operator_of(local))


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
    "gives a lambda for a handle that returns a value",
    "a failure of each message, with the remedy; counted, and logged as an error at the first",
)
def test_lambda_that_returns_a_value(run: Run[Any], caplog: pytest.LogCaptureFixture) -> None:
    handle: Any = lambda request, call: "x"  # noqa: E731
    (item, _), counts = played(run, lambda it, _: it.use_cloud(handle, ask, str, 1), of="ab")
    assert "make it an async def" in item.failures[0].why
    assert counts["cloud-1", "failure", "accepted"] == 2
    assert counts["cloud-1", "handler", "failed"] == 2
    assert wiring_errors(caplog) == [
        "operator: cloud-1: the handle returned str, which cannot be awaited: make it an async def"
    ]


@misuse("forgets to await in a handle", "a failure of each message, with the remedy, as above")
def test_handle_that_does_not_await(run: Run[Any], caplog: pytest.LogCaptureFixture) -> None:
    async def handle(request: Any, call: Call) -> Any:
        return echo(request, call)

    (item,), counts = played(run, lambda it, _: it.use_cloud(handle, ask, str, 1))
    assert "an awaitable instead of a value: await it" in item.failures[0].why
    assert counts["cloud-1", "handler", "failed"] == 1
    assert len(wiring_errors(caplog)) == 1


@misuse("forgets to await in a response handler", "a failure of each message, as above")
def test_response_handler_that_does_not_await(
    run: Run[Any], caplog: pytest.LogCaptureFixture
) -> None:
    async def answer(response: Any) -> Any:
        return on_board(response, 0)

    (item,), _ = played(run, lambda it, _: it.use_cloud(echo, ask, answer, 1))
    assert "the response handler returned an awaitable" in item.failures[0].why
    assert len(wiring_errors(caplog)) == 1


@misuse("gives a lambda for local that calls an `async def`", "a failure of each message, as above")
def test_lambda_for_an_async_local(run: Run[Any], caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> list[Item[Any]]:
        async with operator_of(lambda message, t: on_board(message, t)) as operator:
            operator.feed(["a"])
            return [item async for item in operator]

    (item,) = asyncio.run(main())
    assert item.ending is Ending.MISSED
    assert "give an async def" in item.failures[0].why
    assert len(wiring_errors(caplog)) == 1


@misuse("gives a lambda that encodes by an `async def`", "a failure of each message, as above")
def test_lambda_that_encodes_async(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> list[Item[Any]]:
        operator = operator_of()
        encode: Any = lambda message: on_board(message, 0)  # noqa: E731
        operator.use_cloud(echo, ask, str, 1, encode=encode)
        async with operator:
            operator.feed(["a"])
            return [item async for item in operator]

    (item,) = asyncio.run(main())
    assert "make it a plain function" in item.failures[0].why
    assert len(wiring_errors(caplog)) == 1


@misuse("gives a class for a handle", "`ConfigError`: an instance")
def test_class_for_a_handle() -> None:
    cloud_refused("give an instance", Call, ask, str, 1)


@misuse("gives a handle that cannot be called", "`ConfigError`")
def test_handle_that_cannot_be_called() -> None:
    cloud_refused("must be a function", "west:50051", ask, str, 1)


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


logging.getLogger("asyncio").setLevel(logging.ERROR)
