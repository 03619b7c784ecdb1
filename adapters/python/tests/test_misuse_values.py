"""Tests misuse of values, messages, lineages and names. See test_misuse.py."""

from __future__ import annotations

import array
import asyncio
import functools
import time
from collections import deque
from collections.abc import AsyncIterator, Iterator
from concurrent.futures import Future
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, cast

import numpy
import pytest
from conftest import Run
from fuseline import (
    BlockingOperator,
    Call,
    CarriedState,
    Closed,
    ConfigError,
    Ending,
    Items,
    Join,
    Latency,
    Lineage,
    Local,
    Operator,
    StampedValue,
    TimeError,
    check,
)
from fuseline.deadline import Accuracy, Constant, Expected, Guard, Situation
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

# No value, or none yet.


@pytest.mark.parametrize("wrapped", [False, True])
@misuse("forgets the `return` of a handle", "a failure, with the remedy; logged once")
def test_handle_without_return(run: Run[Any], caplog: Any, wrapped: bool) -> None:
    async def handle(request: Any, call: Call) -> Any:
        request.upper()

    def respond(response: Any) -> Any:
        return StampedValue(response, None) if wrapped else response

    items, counts = played(run, lambda it, _: it.use_cloud(handle, ask, respond, 1), of="ab")
    assert [item.value for item in items] == ["a on board", "b on board"]
    assert counts["cloud-1", "failure", "accepted"] == 2
    assert "add the return" in items[0].failures[0].why
    assert len(wiring_errors(caplog)) == 1


@misuse("forgets the `return` of an async response handler", "a failure, with the remedy")
def test_response_handler_without_return(run: Run[Any]) -> None:
    async def respond(response: Any) -> Any:
        response.upper()

    (item,), _ = played(run, lambda it, _: it.use_cloud(echo, ask, respond, 1))
    assert (item.value, item.latency) == ("a on board", 0.0)


@pytest.mark.parametrize("threads", [False, True])
@misuse("forgets the `return` of local", "a failure, with the remedy; the message is missed")
def test_local_without_return(run: Run[Any], threads: bool) -> None:
    async def task(message: Any, t: int) -> Any:
        message.upper()

    def plain(message: Any, t: int) -> Any:
        message.upper()

    local: Any = Local.threads(plain, deadline=None) if threads else task
    (item,), counts = played(run, lambda *_: None, local=local)
    assert (item.ending, counts["local", "failure", "accepted"]) == (Ending.MISSED, 1)


@misuse("forgets the `return` of what reads a state", "counted and logged; the state stays")
def test_state_without_return(run: Run[Any], caplog: Any) -> None:
    state, forgets = CarriedState(["a van"]), cast("Any", lambda value: None)
    _, counts = played(run, lambda it, _: it.use_state(state, forgets))
    assert state.current() == ["a van"]
    assert counts["operator", "handler", "failed"] == 1
    assert "add the return" in caplog.text


def yields(message: Any, t: int) -> Iterator[Any]:
    yield message


async def yields_async(message: Any, t: int) -> AsyncIterator[Any]:
    yield message


@pytest.mark.parametrize("function", [yields, yields_async, functools.partial(yields)])
@misuse("gives local that yields", "`ConfigError`")
def test_generator_for_local(function: Any) -> None:
    refused("yields", lambda: operator_of(function))


@pytest.mark.parametrize("function", [yields, yields_async])
@misuse("gives a message handler that yields", "`ConfigError`")
def test_generator_for_a_message_handler(function: Any) -> None:
    cloud_refused("yields", echo, function, str, 1)


@pytest.mark.parametrize("function", [yields, yields_async])
@misuse("returns a generator from local", "a failure, with the remedy")
def test_generator_from_local(run: Run[Any], function: Any) -> None:
    async def local(message: Any, t: int) -> Any:
        return function(message, t)

    (item,), _ = played(run, lambda *_: None, local=local)
    assert item.ending is Ending.MISSED
    assert "do not yield" in item.failures[0].why


@pytest.mark.parametrize("where", ["handle", "response"])
@misuse("returns a generator from a cloud", "a failure, with the remedy")
def test_generator_from_a_cloud(run: Run[Any], where: str) -> None:
    async def handle(request: Any, call: Call) -> Any:
        return (it for it in request) if where == "handle" else request

    def respond(response: Any) -> Any:
        return (it for it in response)

    (item,), _ = played(run, lambda it, _: it.use_cloud(handle, ask, respond, 1))
    assert item.value == "a on board"
    assert "do not yield" in item.failures[0].why


@misuse("gives a substitute's handler that returns a coroutine", "no substitute; counted, logged")
def test_async_substitute(run: Run[Any], caplog: Any) -> None:
    async def stop(item: Any) -> Any:
        return "stop"

    async def fails(message: Any, t: int) -> Any:
        raise ValueError

    (item,), counts = played(run, lambda it, _: it.use_substitute(lambda m: stop(m)), local=fails)
    assert (item.value, item.substitute) == (None, None)
    assert counts["operator", "handler", "failed"] == 1
    assert "make it a plain function" in caplog.text


def decorated(function: Any) -> Any:
    @functools.wraps(function)
    def call(*of: Any) -> Any:
        return function(*of)

    return call


@misuse("gives a handle in a plain decorator", "taken: it returns what the handle returns")
def test_decorated_handle(run: Run[Any]) -> None:
    (item,), _ = played(run, lambda it, _: it.use_cloud(decorated(echo), ask, str, 1))
    assert item.value == "a"


# Messages that change.


@dataclass
class Frame:
    image: Any
    stamp: int = 0


BUFFERS = [
    ([0], lambda it, k: it.__setitem__(0, k)),
    (bytearray(1), lambda it, k: it.__setitem__(0, k)),
    (array.array("i", [0]), lambda it, k: it.__setitem__(0, k)),
    (numpy.zeros(1), lambda it, k: it.__setitem__(0, k)),
    ({"state": [0]}, lambda it, k: it["state"].__setitem__(0, k)),
    (([0],), lambda it, k: it[0].__setitem__(0, k)),
    (deque([[0]]), lambda it, k: it[0].__setitem__(0, k)),
    (memoryview(bytearray(8)).cast("i"), lambda it, k: it.__setitem__(0, k)),
    (Frame(numpy.zeros(1)), lambda it, k: it.image.__setitem__(0, k)),
    (Frame(0), lambda it, k: setattr(it, "image", k)),
    (SimpleNamespace(image=[0]), lambda it, k: it.image.__setitem__(0, k)),
]


def first_of(message: Any) -> int:
    """Returns the first number in a buffer."""
    while not isinstance(message, (int, float, numpy.generic)):
        if isinstance(message, (Frame, SimpleNamespace)):
            message = message.image
        else:
            message = message["state"] if isinstance(message, dict) else message[0]
    return int(message)


@pytest.mark.parametrize(("buffer", "change"), BUFFERS)
@misuse("changes a message after it was written", "each output is of its message as it was")
def test_message_that_changes(run: Run[Any], buffer: Any, change: Any) -> None:
    async def local(message: Any, t: int) -> int:
        await asyncio.sleep(0.01)
        return first_of(message)

    async def main(loop: VirtualLoop) -> list[Any]:
        operator: Operator[Any, int] = operator_of(local, clock=loop.time_ns)
        async with operator:
            for number in range(3):
                change(buffer, number)
                operator.write(buffer)
            operator.close()
            return [item.value async for item in operator]

    assert run(main) == [0, 1, 2]


@misuse("changes a message after it was written to a join", "the set has it as it was")
def test_joined_message_that_changes(run: Run[Any]) -> None:
    async def main(loop: VirtualLoop) -> Any:
        join = Join(wait=0.1, clock=loop.time_ns)
        left, right = join.aligned("left"), join.aligned("right")
        pose = join.latest("pose", 1.0)
        buffer = [7]
        async with join:
            pose.write(buffer)
            left.write(buffer, Lineage("rig", 1))
            buffer[0] = 8
            right.write(buffer, Lineage("rig", 1))
            buffer[0] = 9
            joined = await join.read()
            return None if joined is None else joined.set

    assert run(main) == {"left": [7], "right": [8], "pose": [7]}


def test_copies_keep_what_is_shared_and_cyclic(run: Run[Any]) -> None:
    event, part = asyncio.Event(), [1]
    message: list[Any] = [event, part, part]
    message.append(message)

    async def main(loop: VirtualLoop) -> Any:
        async with operator_of(clock=loop.time_ns, carry_messages=True) as operator:
            operator.write(message)
            item = await operator.read()
            return None if item is None else item.message

    copied = run(main)
    assert copied is not message
    assert copied[3] is copied
    assert copied[0] is event
    assert copied[1] is copied[2]
    assert copied[1] is not part


def test_shares_messages_if_told_so(run: Run[Any]) -> None:
    message = [1]

    async def main(loop: VirtualLoop) -> Any:
        operator: Operator[Any, Any] = operator_of(
            clock=loop.time_ns, carry_messages=True, copy_messages=False
        )
        async with operator:
            operator.write(message)
            item = await operator.read()
            return None if item is None else item.message

    assert run(main) is message


# Lineages and clocks.


@misuse("stamps a capture by the wall clock", "`TimeError`; the message is not taken")
def test_capture_by_the_wall_clock() -> None:
    async def main() -> None:
        async with operator_of() as operator:
            with pytest.raises(TimeError, match="another clock"):
                operator.write("a", Lineage("cam", 1, captured=time.time_ns()))
            assert operator.write("a", Lineage("cam", 1, captured=time.monotonic_ns())) == 0
            await operator.read()

    asyncio.run(main())


@misuse("stamps a capture of a join's message by the wall clock", "`TimeError`")
def test_joined_capture_by_the_wall_clock() -> None:
    async def main() -> None:
        join = Join()
        cam, pose = join.aligned("cam"), join.latest("pose", 1.0)
        async with join:
            for it in (cam, pose):
                with pytest.raises(TimeError, match="another clock"):
                    it.write("a", Lineage("cam", 1, captured=time.time_ns()))

    asyncio.run(main())


BAD_LINEAGES: list[tuple[dict[str, Any], type[Exception]]] = [
    ({"origin": "cam", "seq": -1}, TimeError),
    ({"origin": "cam", "seq": 2**64}, TimeError),
    ({"origin": "cam", "seq": "1"}, TypeError),
    ({"origin": "cam", "seq": 1.0}, TypeError),
    ({"origin": "cam", "seq": True}, TypeError),
    ({"origin": 7, "seq": 1}, TypeError),
    ({"origin": "c\udc80m"}, TypeError),
    ({"captured": -1}, TimeError),
    ({"missing": "left"}, TypeError),
    ({"missing": (7,)}, TypeError),
]


@pytest.mark.parametrize(("fields", "error"), BAD_LINEAGES)
@misuse("gives a lineage that cannot be", "refused where it is made, with the remedy")
def test_lineage_that_cannot_be(fields: dict[str, Any], error: type[Exception]) -> None:
    refused("give|from 0 to", lambda: Lineage(**fields), error)


@pytest.mark.parametrize("lineage", [("cam", 1), {"seq": 1}, "cam", 41])
@misuse("gives for a lineage what is none", "`ConfigError`; no timestamp is used up")
def test_no_lineage(lineage: Any) -> None:
    async def main() -> int:
        async with operator_of() as operator:
            with pytest.raises(ConfigError, match="a lineage is a Lineage"):
                operator.write("a", lineage)
            t = operator.write("a")
            await operator.read()
            return t

    assert asyncio.run(main()) == 0


@misuse("gives a clock that goes wrong later", "`write` raises; no timestamp is used up")
def test_clock_that_breaks() -> None:
    reads: list[Any] = [time.monotonic_ns() for _ in range(2)]

    def clock() -> int:
        now = reads.pop() if reads else time.monotonic_ns()
        if now is None:
            raise OSError("no clock")
        return int(now)

    async def main() -> int:
        async with operator_of(clock=clock) as operator:
            reads.append(None)
            with pytest.raises(OSError, match="no clock"):
                operator.write("a")
            t = operator.write("a")
            await operator.read()
            return t

    assert asyncio.run(main()) == 0


@pytest.mark.parametrize("clock", [time.time, time.monotonic, lambda: None, lambda: -1])
@misuse("gives a clock of seconds", "`ConfigError`: nanoseconds, `time.monotonic_ns`")
def test_clock_of_seconds(clock: Any) -> None:
    refused("monotonic_ns", lambda: operator_of(clock=clock))
    refused("monotonic_ns", lambda: Join(clock=clock))


@misuse("gives None for a speed", "`TypeError`: `math.nan`")
def test_no_speed() -> None:
    speed: Any = None
    refused("math.nan", lambda: Guard().judge(Situation(speed=speed)), TypeError)


# Streams of messages.


@pytest.mark.parametrize("messages", ["video.mp4", b"frame", {"image": 1}, 7, iter, None])
@misuse("feeds what is no stream of messages", "`ConfigError`, with the remedy")
def test_feed_of_no_stream(messages: Any) -> None:
    async def main() -> None:
        async with operator_of() as operator:
            with pytest.raises(ConfigError, match="messages"):
                operator.feed(messages)
            with pytest.raises(ConfigError, match="messages"):
                await operator.write_all(messages)

    asyncio.run(main())


# Names and policies.


@pytest.mark.parametrize("name", ["west", "operator", "local", "", 7, "w\udc80st", "side"])
@misuse("gives two sources one name", "`ConfigError`: counts could not tell them apart")
def test_one_name_twice(name: Any) -> None:
    operator = operator_of()
    operator.use_cloud(echo, ask, str, 1, name="west")
    operator.use_side_request(echo, ask, print, name="side")
    refused("name", lambda: operator.use_cloud(echo, ask, str, 2, name=name))
    if name != "side":
        refused("name", lambda: operator.use_side_request(echo, ask, print, name=name))
    operator.use_cloud(echo, ask, str, 2)
    refused("another name", lambda: operator.use_cloud(echo, ask, str, 3, name="cloud-2"))


def expected() -> Expected:
    return Expected(Accuracy(0.3, 0.5, 0.003), 0.01, 16)


@misuse("gives two clouds one policy that learns", "`ConfigError`: one for each")
def test_one_policy_twice() -> None:
    one = expected()
    operator = operator_of()
    operator.use_cloud(echo, ask, str, 1, policy=Constant(0.1).cap(one))
    refused("one for each", lambda: operator.use_cloud(echo, ask, str, 2, policy=one))
    refused(
        "one for each",
        lambda: operator.use_cloud(echo, ask, str, 2, policy=Guard().cap(one)),
    )
    constant = Constant(0.2)
    for priority in (3, 4):
        operator.use_cloud(echo, ask, str, priority, policy=constant.cap(expected()))


@misuse("gives two operators one `Local` with threads", "`ConfigError`: one for each")
def test_one_local_twice() -> None:
    local: Local[Any, Any] = Local.threads(lambda m, t: m)

    async def main() -> None:
        async with operator_of(local):
            with pytest.raises(ConfigError, match="one for each"):
                await operator_of(local).start()
        async with operator_of(local) as again:
            again.write(1)
            await again.read()

    asyncio.run(main())


@pytest.mark.parametrize("of", [{"limit": -1}, {"limit": 0}, {"limit": 2.0}, {"resume": -1}])
@misuse("gives a limit that is none", "`ConfigError`")
def test_odd_limit(of: dict[str, Any]) -> None:
    cloud_refused("it must be an int of at least", echo, ask, str, 1, **of)


@misuse("sets a substitute or a state after the start", "`ConfigError`")
def test_substitute_after_the_start() -> None:
    async def main() -> None:
        async with operator_of() as operator:
            refused("before", lambda: operator.use_substitute(lambda item: None))
            refused("before", lambda: operator.use_state(CarriedState(0), lambda value: 0))

    asyncio.run(main())


@misuse("sets two substitutes", "`ConfigError`")
def test_two_substitutes() -> None:
    operator = operator_of()
    operator.use_substitute(lambda item: None)
    refused(
        "the operator has a substitute already", lambda: operator.use_substitute(lambda item: None)
    )


def test_names_tasks_by_their_source(run: Run[Any]) -> None:
    names = []

    def name() -> str:
        task = asyncio.current_task()
        return "" if task is None else task.get_name()

    async def handle(request: Any, call: Call) -> Any:
        names.append(name())
        return request

    async def local(message: Any, t: int) -> Any:
        names.append(name())
        return await on_board(message, t)

    played(run, lambda it, _: it.use_cloud(handle, ask, str, 1, name="west"), local=local)
    assert sorted(names) == ["operator: local", "operator: west"]


@misuse("uses the buffer of local's result again", "each item has its own message's result")
def test_result_that_changes(run: Run[Any]) -> None:
    buffer: dict[str, Any] = {"boxes": numpy.zeros(1)}

    async def local(message: Any, t: int) -> Any:
        buffer["boxes"][0] = message
        return buffer

    async def slow(request: Any, call: Call) -> Any:
        await asyncio.sleep(5)

    async def main(loop: VirtualLoop) -> list[Any]:
        operator: Operator[Any, Any] = operator_of(local, clock=loop.time_ns)
        operator.use_cloud(slow, ask, str, 1)
        async with operator:
            for number in range(3):
                operator.write(number)
            operator.close()
            return [first_of(cast("Any", item.value)["boxes"]) async for item in operator]

    assert run(main) == [0, 1, 2]


async def gathered(request: Any, call: Call) -> Any:
    async def fails() -> Any:
        raise ConnectionError("reset by peer")

    return (await asyncio.gather(fails(), return_exceptions=True))[0]


async def cancelled(request: Any, call: Call) -> Any:
    return asyncio.CancelledError("by the library")


@pytest.mark.parametrize(
    ("handle", "words"), [(gathered, "reset by peer"), (cancelled, "by the library")]
)
@misuse("returns an exception instead of raising it", "a failure, with what it says")
def test_exception_for_a_result(run: Run[Any], handle: Any, words: str) -> None:
    (item,), _ = played(run, lambda it, _: it.use_cloud(handle, ask, lambda r: r, 1))
    assert item.value == "a on board"
    assert words in item.failures[0].why


@misuse("returns a concurrent future for a result", "a failure, with the remedy")
def test_concurrent_future_for_a_result(run: Run[Any]) -> None:
    async def handle(request: Any, call: Call) -> Any:
        return Future()

    (item,), _ = played(run, lambda it, _: it.use_cloud(handle, ask, lambda r: r, 1))
    assert item.value == "a on board"
    assert "asyncio.wrap_future" in item.failures[0].why


@misuse("writes a coroutine for a message", "`ConfigError`: await it")
def test_coroutine_for_a_message() -> None:
    async def main() -> None:
        async with operator_of() as operator:
            with pytest.raises(ConfigError, match="await it"):
                operator.write(asyncio.sleep(0))
            with pytest.raises(ConfigError, match="feed it"):
                operator.write(it for it in "ab")

    asyncio.run(main())


@misuse("uses an operator with `with`, or a `BlockingOperator` with `async with`", "`ConfigError`")
def test_other_kind_of_block() -> None:
    async def main() -> None:
        async with BlockingOperator(operator_of()):
            pass

    refused("async with", operator_of().__enter__)
    refused("use `with`", lambda: asyncio.run(main()))


@misuse("uses an operator in a second loop", "`Closed` or `RuntimeError`; no message is taken")
def test_second_loop() -> None:
    operator: Operator[Any, Any] = operator_of()

    async def later() -> None:
        for method in (lambda: operator.write(2), operator.close):
            with pytest.raises((Closed, RuntimeError), match="loop"):
                method()

    asyncio.run(operator.start())
    asyncio.run(later())
    assert operator.counts == {}


@misuse("writes to a join without a lineage", "dropped; counted, and logged with the remedy")
def test_join_without_lineage(run: Run[Any], caplog: Any) -> None:
    async def main(loop: VirtualLoop) -> int:
        join = Join(clock=loop.time_ns)
        left = join.aligned("left")
        async with join:
            for number in range(5):
                left.write(number)
        return join.counts["left", "message", "dropped no key"]

    assert run(main) == 5
    assert "4 messages of left have no key" in caplog.text


@misuse("gives `Items` a list", "`ConfigError`")
def test_items_of_a_list() -> None:
    refused("an async iterable", lambda: Items([1, 2]))  # type: ignore[arg-type]


@misuse("gives a side request an async response handler", "it is awaited")
def test_async_side_response(run: Run[Any]) -> None:
    taken = []

    async def respond(answer: Any) -> None:
        await asyncio.sleep(0.001)
        taken.append(answer)

    async def handle(request: Any, call: Call) -> Any:
        await asyncio.sleep(0.01)
        return request

    def prepare(operator: Operator[Any, Any], _: VirtualLoop) -> None:
        operator.use_side_request(echo, ask, respond)  # type: ignore[arg-type]
        operator.use_cloud(handle, ask, str, 1)

    _, counts = played(run, prepare)
    assert taken == ["a"]
    assert counts["side-1", "side request", "answered"] == 1


@pytest.mark.parametrize("commit", ["Eager", None, True, 0])
@misuse("gives a commit rule that is none", "`ConfigError`, with the words")
def test_odd_commit(commit: Any) -> None:
    refused("it must be eager, patient or progressive", lambda: operator_of(commit=commit))


@misuse("gives a percentile that is none", "`ConfigError`")
def test_odd_percentile() -> None:
    for percent in (0, 101, -1, 300):
        refused("from 1 to 100", lambda percent=percent: Latency.measured(percent, 0.1))  # type: ignore[misc]


@misuse("gives a trace's text for its path", "`ValueError`: its bytes")
def test_text_of_a_trace() -> None:
    refused("give its bytes", lambda: check('{"fuseline":1,"window":16,"clouds":[]}\n'), ValueError)
