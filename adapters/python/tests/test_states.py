"""Tests operators, joins, threads and connections before, during and after their work."""

from __future__ import annotations

import asyncio
import gc
import pickle
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import grpc
import pytest
from conftest import Run
from fuseline import (
    Call,
    CarriedState,
    Closed,
    ConfigError,
    Full,
    Join,
    Lineage,
    Local,
    Operator,
    ReadError,
    check,
)
from fuseline._loop import each
from fuseline.grpc import _plain
from fuseline.testing import VirtualLoop
from misuse import elsewhere
from operator_support import after, ask, local_after

NOT_STARTED = "the operator has not started; use it with `async with`"


def test_an_operator_before_its_start_and_in_another_thread() -> None:
    operator: Operator[int, Any] = Operator(local_after(0), name="lane")
    operator.use_cloud(after(0), ask(0.1), str, 1, name="west")
    assert (operator.counts, operator.deadlines, operator.recording_error) == ({}, {}, None)
    assert operator.greatest_lag == 0.0
    assert repr(operator) == "<Operator 'lane' clouds=['west'] not started, 0 messages>"
    operator.stop()

    async def early() -> None:
        await operator.read()

    calls: list[Callable[[], Any]] = [
        lambda: operator.write(1),
        lambda: operator.write_threadsafe(1),
        lambda: operator.feed([1]),
        lambda: asyncio.run(early()),
    ]
    for call in calls:
        with pytest.raises(ConfigError, match=NOT_STARTED):
            call()

    async def main() -> None:
        async with operator:
            assert repr(operator) == "<Operator 'lane' clouds=['west'] running, 0 messages>"
            for method, call in (("feed", calls[2]), ("close", operator.close)):
                error = elsewhere(call)
                assert isinstance(error, RuntimeError)
                where, _, remedy = str(error).partition("; ")
                assert where == f"{method} was called in another thread than the operator's loop"
                assert remedy == (
                    f"let its loop do it: loop.call_soon_threadsafe(operator.{method})"
                )
            with pytest.raises(ConfigError, match="a side request was registered after the start"):
                operator.use_side_request(after(0), ask(0.1), print)
            assert operator.write(1) == 0
            assert repr(operator) == "<Operator 'lane' clouds=['west'] running, 1 messages>"

    asyncio.run(main())
    with pytest.raises(Closed, match="the operator's loop has ended"):
        operator.write_threadsafe(2)
    assert operator.counts["lane", "message", "not taken"] == 1
    # Lost messages must not fill the window, so this writes more than it holds.
    for _ in range(20):
        with pytest.raises(Closed):
            operator.write_threadsafe(2)


def test_an_operator_that_is_closed_before_its_start_takes_nothing() -> None:
    async def main() -> None:
        operator = Operator(local_after(0))
        operator.close()
        async with operator:
            with pytest.raises(Closed, match="takes no more messages"):
                operator.write(1)
        assert await operator.read() is None

    asyncio.run(main())


def test_between_two_plain_messages_others_have_a_turn() -> None:
    async def main() -> list[int]:
        turns = [0]

        async def other() -> None:
            while True:
                turns[0] += 1
                await asyncio.sleep(0)

        task = asyncio.create_task(other())
        seen = [turns[0] async for _ in each("abc")]
        task.cancel()
        return seen

    assert asyncio.run(main()) == [0, 1, 2]


def test_an_error_in_a_trace_goes_from_process_to_process() -> None:
    with pytest.raises(ReadError) as raised:
        check(b"{}", name="run.jsonl")
    copied = pickle.loads(pickle.dumps(raised.value))
    assert str(copied) == str(raised.value)
    assert (copied.file, copied.line, copied.column) == ("run.jsonl", 1, 3)


def test_a_feed_that_is_closed_meanwhile_ends_quietly(run: Run[Any]) -> None:
    async def main(loop: VirtualLoop) -> list[Any]:
        async def camera() -> Any:
            for n in range(9):
                yield n
                await asyncio.sleep(1)

        local = Local.task(local_after(2.0), at_once=3, deadline=5.0)
        async with Operator(local, clock=loop.time_ns) as operator:
            operator.feed(camera())
            loop.call_later(2.5, operator.close)
            return [item.timestamp async for item in operator]

    # The fourth message comes while the third is open.
    assert run(main) == [0, 1, 2]


def test_who_waits_for_room_learns_at_once_that_the_operator_is_closed(run: Run[Any]) -> None:
    async def main(loop: VirtualLoop) -> float:
        local = Local.task(local_after(30.0), deadline=50.0)
        async with Operator(local, window=1, clock=loop.time_ns) as operator:
            begin = loop.time()
            loop.call_later(1.0, operator.close)
            with pytest.raises(Closed):
                await operator.write_all([1, 2, 3])
            return loop.time() - begin

    assert run(main) == pytest.approx(1.0)


def test_what_an_aborted_call_raises_is_nobodys_concern(run: Run[Any]) -> None:
    """Exceptions of an aborted call are ignored (D6, D7)."""

    async def handle(message: Any, call: Call) -> Any:
        try:
            await asyncio.sleep(60)
        except asyncio.CancelledError:
            raise OSError("it could not be closed") from None

    async def main(loop: VirtualLoop) -> Any:
        operator = Operator(local_after(0), clock=loop.time_ns)
        operator.use_cloud(handle, ask(0.1), str, 1, name="west")
        async with operator:
            operator.write(1)
            item = await operator.read()
            await asyncio.sleep(1)
            gc.collect()
        assert item is not None and not item.failures
        return operator.counts["west", "failure", "accepted"]

    # The loop's own handler gets no error, which the fixture checks.
    assert run(main) == 0


def test_a_call_that_only_gives_others_a_turn_is_aborted_too(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """A call that only yields to others is aborted too (D6)."""
    ends: list[type[BaseException]] = []

    async def spins(message: Any, call: Call) -> Any:
        try:
            for _ in range(100_000):
                await asyncio.sleep(0)
        except BaseException as error:
            ends.append(type(error))
            raise

    async def main() -> None:
        operator = Operator(local_after(0))
        operator.use_cloud(spins, ask(0.01), str, 1)
        async with operator:
            operator.write(1)
            assert await operator.read() is not None
            operator.stop()

    asyncio.run(main())
    assert ends == [asyncio.CancelledError]
    assert "have not ended" not in caplog.text


def test_of_several_results_of_a_message_the_last_that_was_sent_has_the_state() -> None:
    """Among a message's results, the last one sent has the state (E10)."""
    state = CarriedState("none")
    steps: list[tuple[str, int, str, str]] = [
        ("computed", 1, "a", "a"),
        ("computed", 1, "b", "b"),
        ("sent", 1, "c", "c"),
        ("sent", 1, "d", "d"),
        ("computed", 1, "late", "d"),
        ("sent", 0, "old", "d"),
        ("computed", 2, "e", "e"),
        ("sent", 1, "old", "e"),
    ]
    for method, timestamp, given, current in steps:
        getattr(state, method)(timestamp, given)
        assert state.current() == current, given


def test_a_join_before_its_start_after_it_and_after_its_inputs(run: Run[Any]) -> None:
    async def main(loop: VirtualLoop) -> None:
        join = Join(clock=loop.time_ns, output_len=1)
        left, place = join.aligned("left"), join.latest("place", 1.0)
        for it in (left, place):
            with pytest.raises(ConfigError, match="the join has not started"):
                it.write(1)
        with pytest.raises(ConfigError, match="the join has not started"):
            await join.read()
        async with join:
            with pytest.raises(ConfigError, match="this join was started before"):
                await join.__aenter__()
            adds: list[Callable[[str], Any]] = [join.aligned, lambda name: join.latest(name, 1.0)]
            for add in adds:
                with pytest.raises(ConfigError, match="an input cannot be added after the start"):
                    add("right")
            left.write("a", Lineage("camera", 1))
            with pytest.raises(Full, match="1 sets wait to be read"):
                left.write("b", Lineage("camera", 2))
            joined = await join.read()
            assert joined is not None and (joined.set, joined.missing) == ({"left": "a"}, ["place"])
            place.close()
            with pytest.raises(Closed, match="the input place takes no more"):
                place.write(1)
            left.close()
            left.close()
            with pytest.raises(Closed, match="the input left takes no more"):
                left.write("c", Lineage("camera", 3))
            assert await join.read() is None

    run(main)


def test_a_side_request_without_time_is_refused_and_a_failure_reported(
    run: Run[Any], caplog: pytest.LogCaptureFixture
) -> None:
    """A side request without time is refused, and a failure is reported (D11)."""

    async def breaks(message: Any, call: Call) -> None:
        raise OSError("no\nroute")

    async def main(loop: VirtualLoop) -> Any:
        operator = Operator(local_after(0), clock=loop.time_ns)
        operator.use_side_request(breaks, lambda m, t: (m, 0.1 * t), print)
        async with operator:
            for n in range(2):
                operator.write(n)
                await operator.read()
            await asyncio.sleep(1)
        return {what: n for (who, _, what), n in operator.counts.items() if who == "side-1"}

    assert run(main) == {"refused": 1, "requested": 1, "failed": 1}
    assert "side-1: no answer will come: no route" in caplog.text


def test_a_side_call_is_given_the_time_that_its_turn_has_left(run: Run[Any]) -> None:
    """A side call gets the time that is left at its turn (D5)."""
    given: list[tuple[int, float]] = []

    async def handle(message: int, call: Call) -> None:
        given.append((message, round(call.deadline, 6)))
        await asyncio.sleep(0.03)

    async def main(loop: VirtualLoop) -> Any:
        operator = Operator(local_after(0), clock=loop.time_ns)
        operator.use_side_request(handle, ask(0.1), print, calls=1, name="plan")
        async with operator:
            for n in range(5):
                operator.write(n)
            await asyncio.sleep(1)
            operator.stop()
        return operator.counts["plan", "side request", "expired"]

    # The fourth call begins with 10 ms left and is ended. The fifth has no time left.
    assert run(main) == 2
    assert given == [(0, 0.1), (1, 0.07), (2, 0.04), (3, 0.01)]


@pytest.mark.parametrize("ends", [SystemExit, KeyboardInterrupt])
def test_what_ends_the_program_in_a_call_ends_it(ends: type[BaseException]) -> None:
    async def handle(message: Any, call: Call) -> Any:
        raise ends("on purpose")

    async def main() -> None:
        operator = Operator(local_after(0))
        operator.use_cloud(handle, ask(5.0), str, 1)
        async with operator:
            operator.write(1)
            await asyncio.sleep(60)

    with pytest.raises(ends, match="on purpose"):
        asyncio.run(main())


@pytest.mark.parametrize(
    ("code", "details", "words"),
    [
        ("UNAVAILABLE", "failed: Connection refused (111)", "connection refused"),
        ("DEADLINE_EXCEEDED", "connection refused", "connection refused"),
        ("DEADLINE_EXCEEDED", "Deadline Exceeded", "no answer in time"),
        ("UNAVAILABLE", "Socket closed", "the connection broke"),
        ("UNAVAILABLE", "Connection reset by peer", "the connection broke"),
        ("UNAVAILABLE", "GOAWAY received", "the connection broke"),
        ("UNAVAILABLE", "Broken pipe", "the connection broke"),
        ("UNAVAILABLE", "Ssl handshake failed: x", "no TLS connection: Ssl handshake failed: x"),
        ("UNAVAILABLE", "SSL_ERROR_SSL: y", "no TLS connection: SSL_ERROR_SSL: y"),
        ("UNAVAILABLE", "a Certificate of none", "no TLS connection: a Certificate of none"),
        ("INTERNAL", "it\n  broke " + "x" * 300, "it broke " + "x" * 191),
        ("RESOURCE_EXHAUSTED", None, "resource_exhausted"),
        ("INTERNAL", "", "internal"),
    ],
)
def test_why_a_call_failed_is_said_in_plain_words(
    code: str, details: str | None, words: str
) -> None:
    status = getattr(grpc.StatusCode, code)
    assert _plain(SimpleNamespace(details=lambda: details, code=lambda: status)) == words
