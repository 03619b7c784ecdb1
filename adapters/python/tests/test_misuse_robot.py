"""Tests misuse of remote policies and control loops. See test_misuse.py."""

from __future__ import annotations

import math
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy
import pytest
from fuseline import Call, ConfigError, Ending, Failure, _remote
from fuseline._failures import PolicyFailures, TickRate
from fuseline.robot import Always, Chunk, Hold, fade
from misuse import misuse, refused

NAN = float("nan")
CHUNK = Chunk(every=2, max_age=4, within=5.0)


def server(reply: Callable[[Any], Any]) -> Any:
    """Returns a class of connections whose replies `reply` makes."""

    class Server:
        def infer(self, observation: Any) -> Any:
            return reply(observation)

        def close(self) -> None:
            pass

    return Server


def refuses(*_: Any) -> Any:
    raise ConnectionRefusedError("401: unauthorized")


def ticks(policy: Always, until: Callable[[], bool], most: float = 5.0) -> list[Any]:
    """Returns the actions of ticks until `until` returns True."""
    end = time.monotonic() + most
    actions: list[Any] = []
    while not until() and time.monotonic() < end:
        actions.append(policy.infer(len(actions)))
        time.sleep(0.001)
    assert until(), policy.counts
    return actions


# Failures of the remote policy.


@pytest.mark.parametrize("chunk", [None, CHUNK])
@pytest.mark.parametrize(
    ("remote", "words"),
    [
        (refuses, "401: unauthorized"),
        (server(refuses), "401: unauthorized"),
        (lambda: object(), "has no infer()"),
        (server(lambda _: None), "add the return"),
        (server(lambda _: sys.exit("no licence")), "no licence"),
    ],
)
@misuse("gives a remote policy that always fails", "counted, logged, `on_failure`, in each item")
def test_remote_that_always_fails(
    chunk: Chunk | None, remote: Any, words: str, caplog: pytest.LogCaptureFixture, monkeypatch: Any
) -> None:
    monkeypatch.setattr(_remote, "PAUSE", 0.0)
    failures: list[Failure] = []
    with Always(
        remote, Hold([0.0]), deadline=5.0, chunk=chunk, on_failure=failures.append
    ) as policy:
        actions = ticks(policy, lambda: len(failures) >= 5)
        assert policy.item is not None
        assert words in policy.item.failures[0].why
        assert policy.counts["remote", "call", "failed"] >= 5
        assert policy.counts["remote", "failure", "accepted"] >= 3
        (reason,) = (it[2] for it in policy.counts if it[1] == "call failed because")
    assert set(map(str, actions)) == {"[0.0]"}
    assert words in reason
    assert words in failures[0].why
    assert str(failures[0].source) == "remote"
    assert "a call to the remote policy failed, 4 in a row" in caplog.text


@misuse("gives a remote policy whose chunks come too late", "counted, logged, in each item")
def test_chunk_that_is_too_late() -> None:
    go_on = threading.Event()
    chunk = Chunk(every=1, max_age=4, within=0.01)
    with Always(server(lambda _: go_on.wait(30)), Hold(0.0), deadline=5.0, chunk=chunk) as policy:
        ticks(policy, lambda: policy.counts["remote", "call", "failed"] >= 2)
        assert policy.item is not None
        assert policy.item.failures[0].why == "no chunk within 0.01 s"
        go_on.set()


@misuse("gives a callback of failures that raises", "logged; the ticks go on")
def test_callback_of_failures_that_raises(caplog: pytest.LogCaptureFixture) -> None:
    def on_failure(failure: Failure) -> None:
        raise KeyError(failure.why)

    with Always(refuses, Hold(0.0), deadline=5.0, on_failure=on_failure) as policy:
        assert [policy.infer(it) for it in range(3)] == [0.0] * 3
    assert "on_failure failed" in caplog.text


@misuse("gives a remote policy whose calls hang, and `close` does not end them", "calls go on")
def test_remote_that_hangs(monkeypatch: pytest.MonkeyPatch, caplog: Any) -> None:
    monkeypatch.setattr(_remote, "PAUSE", 0.001)
    monkeypatch.setattr(_remote, "HUNG_THREADS", 4)
    go_on = threading.Event()
    calls: list[int] = []

    def reply(observation: Any) -> Any:
        calls.append(observation)
        if len(calls) <= 8:
            go_on.wait(60)
        return 1.0

    remote = server(reply)
    with Always(remote, Hold(0.0), deadline=0.002, linger=0.002) as policy:
        ticks(policy, lambda: policy.counts["remote", "call", "answered"] > 0)
        assert policy.counts["remote", "call", "failed"] >= 8
        go_on.set()
    assert "threads hang in calls to the remote policy" in caplog.text


@misuse("closes a connection in a way that waits", "no tick waits for it")
def test_close_that_waits() -> None:
    go_on = threading.Event()

    class Server:
        def infer(self, observation: Any) -> Any:
            go_on.wait(12)

        def close(self) -> None:
            go_on.wait(12)

    with Always(Server, Hold(0.0), deadline=0.002, linger=0.002) as policy:
        begin = time.monotonic()
        ticks(policy, lambda: policy.counts["remote", "call", "failed"] >= 2)
        assert time.monotonic() - begin < 10.0
        go_on.set()


# Actions.


@dataclass
class Command:
    joints: Any
    name: str = ""


BAD_ACTIONS: list[tuple[Any, Any, str]] = [
    ([0.0, 0.0], [NAN, 0.0], "not finite"),
    ([0.0, 0.0], [0.0, -math.inf], "not finite"),
    ([0.0, 0.0], [0.0], "has the shape (1,), and on board it has (2,)"),
    ([0.0, 0.0], [[0.0, 0.0]], "give chunk="),
    ([0.0, 0.0], 0.0, "has the shape (), and on board it has (2,)"),
    ([0.0, 0.0], "error: CUDA out of memory", "CUDA out of memory"),
    ([0.0, 0.0], [0.0, "1"], "parts of different forms"),
    ([0.0, 0.0], [[0.0], [0.0, 1.0]], "parts of different forms"),
    ([0.0, 0.0], {"actions": [0.0, 0.0]}, "on board it is numbers of the shape (2,)"),
    ([0.0, 0.0], numpy.array([0.0, NAN]), "not finite"),
    ([0.0, 0.0], numpy.zeros((1, 2)), "give chunk="),
    ([0.0, 0.0], numpy.array(["0", "1"]), "give numbers"),
    (numpy.zeros(2), numpy.zeros(2, dtype=object), "give numbers"),
    ({"arm": [0.0], "grip": 0.0}, {"arm": [0.0]}, "has no 'grip'"),
    ({"arm": [0.0]}, {"arm": [NAN]}, "['arm'][0] is nan"),
    ({"arm": [0.0]}, {"error": "no model"}, "no model"),
    ({"arm": [0.0]}, [0.0], "it has arm"),
    (Command([0.0]), Command([NAN]), "not finite"),
    (Command([0.0]), Command([0.0, 0.0]), "has the shape (2,)"),
    (True, 1.0, "on board it is bool"),
    ([0.0, 0.0], numpy.array([True, False]), "on board it is numbers of the shape (2,)"),
    ([0.0, 0.0], [True, False], "on board it is numbers of the shape (2,)"),
    ({"grip": [1.0]}, {"grip": numpy.array([True])}, "['grip'] is ndarray"),
    (numpy.array([True, True]), [1.0, 0.0], "on board it is bools of the shape (2,)"),
    (numpy.array([True, True]), [True], "has the shape (1,), and on board it has (2,)"),
]


@pytest.mark.parametrize("chunked", [False, True])
@pytest.mark.parametrize(("held", "action", "words"), BAD_ACTIONS)
@misuse("replies with what is no action", "a failure of the remote policy; nothing moves by it")
def test_reply_that_is_no_action(chunked: bool, held: Any, action: Any, words: str) -> None:
    failures: list[Failure] = []
    reply = [action] * 3 if chunked else action
    with Always(
        server(lambda _: reply),
        Hold(held),
        deadline=5.0,
        chunk=CHUNK if chunked else None,
        on_failure=failures.append,
    ) as policy:
        actions = ticks(policy, lambda: bool(failures))
        assert {repr(it) for it in actions} == {repr(held)}
        assert str(policy.item and policy.item.source) == "local"
    assert words in failures[0].why


GOOD_ACTIONS: list[tuple[Any, Any]] = [
    ([0.0, 0.0], [1, 2.5]),
    ([0.0, 0.0], numpy.array([1.0, 2.0])),
    ((0.0, 0.0), numpy.array([1, 2], dtype="int8")),
    ({"arm": [0.0]}, {"arm": [1.0], "timing": {"ms": 3.0}, "name": "west", "more": None}),
    ("stop", "go"),
    (Command([0.0]), Command([1.0])),
    (0, 1.5),
    (numpy.array([[True], [False]]), [[False], [True]]),
]


@pytest.mark.parametrize(("held", "action"), GOOD_ACTIONS)
def test_takes_an_action_of_the_form_on_board(held: Any, action: Any) -> None:
    with Always(server(lambda _: action), Hold(held), deadline=5.0) as policy:
        assert repr(policy.infer(0)) == repr(action)
    chunk = Chunk(every=1, max_age=99, within=5.0)
    with Always(server(lambda _: [action] * 9), Hold(held), deadline=5.0, chunk=chunk) as policy:
        ticks(policy, lambda: str(policy.item and policy.item.source) == "remote")


@pytest.mark.parametrize(
    ("held", "action", "kinds"),
    [
        ([0.5, 0.5], numpy.array([1.0, 2.0]), ("actions", "ndarray", "list")),
        (numpy.zeros(2), [1.0, 2.0], ("actions", "list", "ndarray")),
        ({"arm": (0.5,)}, {"arm": [1.0]}, ("actions['arm']", "list", "tuple")),
    ],
)
@misuse("replies with a list where an action on board has an array", "logged once")
def test_list_for_an_array(
    held: Any, action: Any, kinds: tuple[str, str, str], caplog: pytest.LogCaptureFixture
) -> None:
    with Always(server(lambda _: action), Hold(held), deadline=5.0) as policy:
        for tick in range(3):
            assert repr(policy.infer(tick)) == repr(action)
    where, own, other = kinds
    (said,) = [it for it in caplog.messages if "arithmetic" in it]
    assert said.startswith(f"{where} of the remote policy are of the type {own}, and on board")
    assert f"of the type {other}:" in said


@pytest.mark.parametrize("reply", ["abc", b"abc", "", [], 7.0, {"error": "x"}, object()])
@misuse("replies with what is no chunk", "a failure of the remote policy")
def test_reply_that_is_no_chunk(reply: Any) -> None:
    failures: list[Failure] = []
    with Always(
        server(lambda _: reply), Hold([0.0]), deadline=5.0, chunk=CHUNK, on_failure=failures.append
    ) as policy:
        assert set(map(str, ticks(policy, lambda: bool(failures)))) == {"[0.0]"}


@misuse("gives a policy on board that replies in another form than the server", "a failure")
def test_form_of_a_policy_on_board() -> None:
    failures: list[Failure] = []

    def reply(observation: Any) -> list[float]:
        time.sleep(0.01)
        return [0.0] * 8

    with Always(
        server(reply),
        lambda _: [0.0] * 7,
        deadline=5.0,
        on_failure=failures.append,
    ) as policy:
        assert {len(it) for it in ticks(policy, lambda: bool(failures))} <= {7, 8}
        assert "has the shape (8,), and on board it has (7,)" in failures[0].why
        assert len(policy.infer(0)) == 7


def test_a_number_that_is_held_stands_for_any_action() -> None:
    replies: list[Any] = [(1.0, 2.0), (3.0,), "text"]
    failures: list[Failure] = []
    with Always(
        server(lambda tick: replies[min(tick, 2)]),
        Hold(0),
        deadline=5.0,
        on_failure=failures.append,
    ) as policy:
        assert [policy.infer(it) for it in range(2)] == [(1.0, 2.0), (1.0, 2.0)]
        ticks(policy, lambda: len(failures) > 1)
    assert "has the shape (1,), and on board it has (2,)" in failures[0].why


@misuse("gives a blend that makes what is no action", "a failure of the remote policy")
def test_blend_that_makes_no_action() -> None:
    def blend(*_: Any) -> Any:
        return [NAN]

    chunk = Chunk(every=1, max_age=99, within=5.0, blend=blend)
    failures: list[Failure] = []
    with Always(
        server(lambda _: [[1.0]] * 9),
        Hold([0.0]),
        deadline=5.0,
        chunk=chunk,
        on_failure=failures.append,
    ) as policy:
        assert set(map(str, ticks(policy, lambda: bool(failures)))) == {"[0.0]"}
    assert "the blended action" in failures[0].why


def test_fade_keeps_what_is_not_a_number() -> None:
    assert math.isnan(fade(2, max_jump=0.05)(None, [NAN], 5, [0.0])[0])


@pytest.mark.parametrize("jump", [0.0, -1.0, NAN, math.inf, "1", True])
@misuse("gives a `max_jump` that is none", "`ConfigError`")
def test_odd_max_jump(jump: Any) -> None:
    refused("max_jump", lambda: fade(2, max_jump=jump))


# The policy on board.


@misuse("gives a policy on board that is slower than the deadline", "the last action; reported")
def test_slow_policy_on_board() -> None:
    slow = threading.Event()
    failures: list[Failure] = []

    def on_board(observation: int) -> float:
        if observation > 0:
            slow.wait(60)
        return 7.0

    with Always(refuses, on_board, deadline=0.2, on_failure=failures.append) as policy:
        assert policy.infer(0) == 7.0
        begin = time.monotonic()
        assert policy.infer(1) == 7.0
        assert time.monotonic() - begin < 5.0
        assert policy.item is not None
        assert (policy.item.ending, policy.item.substitute) == (Ending.MISSED, 7.0)
        assert policy.counts["policy", "message", "missed"] == 1
        slow.set()
    assert "no action on board within 0.2 s" in [it.why for it in failures]


@pytest.mark.parametrize(
    ("on_board", "words"),
    [
        (lambda _: time.sleep(1.0), "on board took longer than 0.01 s"),
        (lambda _: None, "add the return"),
        (lambda _: [NAN], "not finite"),
        (lambda _: sys.exit("not calibrated"), "not calibrated"),
        (lambda _: (it for it in "ab"), "do not yield"),
    ],
)
@misuse("gives a policy on board without an action at the first tick", "`RuntimeError`: why")
def test_no_action_on_board(on_board: Any, words: str) -> None:
    # On a busy host the other policies may also take longer than 10 ms.
    deadline = 0.01 if "longer" in words else 5.0
    with (
        Always(refuses, on_board, deadline=deadline) as policy,
        pytest.raises(RuntimeError, match=r"no action for tick 0: missed; .*") as raised,
    ):
        policy.infer(0)
    assert words in str(raised.value)


class Module:
    """Computes something else when it is called, as a PyTorch module does."""

    def __call__(self, observation: Any) -> str:
        return "forward"

    def infer(self, observation: Any) -> str:
        return "infer"


@misuse("gives a policy on board that can also be called", "its `infer` acts")
def test_policy_that_can_be_called() -> None:
    with Always(refuses, Module(), deadline=5.0) as policy:
        assert policy.infer(0) == "infer"


# The loop.


@pytest.mark.parametrize("chunk", [None, CHUNK])
@misuse("calls `infer` in several threads", "each has its own tick's action")
def test_infer_in_several_threads(chunk: Chunk | None) -> None:
    wrong: list[Any] = []

    def loop(policy: Always, number: int) -> None:
        for tick in range(200):
            action = policy.infer([number, tick])
            if chunk is None and action not in ([number, tick], [-1, -1]):
                wrong.append(action)

    def reply(observation: Any) -> Any:
        return observation if chunk is None else [observation] * 4

    with Always(server(reply), Hold([-1, -1]), deadline=5.0, chunk=chunk) as policy:
        threads = [threading.Thread(target=loop, args=(policy, it), daemon=True) for it in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(20)
            assert not thread.is_alive()
        assert policy.counts["policy", "message", "accepted"] == 600
    assert not wrong


@pytest.mark.parametrize(
    ("of", "words"),
    [
        ({"period": 30.0}, "for 30 Hz give 1 / 30"),
        ({"period": 0.0}, "a period of 0.0 s"),
        ({"period": 0.1, "deadline": 0.2}, "above the period"),
        ({"deadline": 0.0}, "a deadline of 0"),
        ({"period": 0.1, "on_failure": 7}, "on_failure must be a function"),
        ({"period": 0.1, "chunk": Chunk(1, 4, within=0.0)}, "within is 0 s"),
        ({"period": 0.1, "chunk": Chunk(1, 4, blend=0.5)}, "a blend must be a function"),  # type: ignore[arg-type]
        ({"period": 0.1, "chunk": Chunk(1, 4, split="actions")}, "a split must be a function"),  # type: ignore[arg-type]
    ],
)
@misuse("gives a rate for a period, or a deadline above it", "`ConfigError`, with the remedy")
def test_odd_period(of: dict[str, Any], words: str) -> None:
    refused(words, lambda: Always(refuses, Hold(0.0), **of))


@pytest.mark.parametrize("of", [{"period": 30}, {"deadline": 1}, {"deadline": 0.1, "linger": 5}])
@misuse("gives a period as an `int`", "`TypeError`, as of any duration")
def test_int_for_a_period(of: dict[str, Any]) -> None:
    refused("for seconds", lambda: Always(refuses, Hold(0.0), **of), TypeError)


async def connects() -> Any:
    return Module()


@pytest.mark.parametrize("remote", [Module(), None, "ws://west", connects])
@misuse("gives a remote policy for the function that connects", "`ConfigError`, with the remedy")
def test_policy_for_a_function(remote: Any) -> None:
    refused("connects", lambda: Always(remote, Hold(0.0), deadline=0.1))


@pytest.mark.parametrize("first", [None, [NAN], {"arm": math.inf}])
@misuse("holds what is no action", "`ConfigError`")
def test_hold_of_no_action(first: Any) -> None:
    refused("give the first action", lambda: Hold(first))


def test_a_remote_policy_learns_its_tick_and_deadline() -> None:
    calls: list[Call] = []

    class Server:
        def infer(self, observation: Any, call: Call) -> Any:
            calls.append(call)
            return [0.0] if len(calls) == 1 else [[0.0]] * 9

        def close(self) -> None:
            pass

    with Always(Server, Hold([0.0]), deadline=0.5, linger=4.0) as policy:
        policy.infer(7)
    with Always(Server, Hold([0.0]), deadline=0.5, chunk=Chunk(1, 9, within=3.0)) as policy:
        ticks(policy, lambda: policy.counts["remote", "call", "answered"] > 0)
    assert [it.timestamp for it in calls[:2]] == [0, 0]
    assert 0.0 < calls[0].deadline <= 0.5
    assert 1.0 < calls[1].deadline <= 3.0


@misuse("changes an action in place, or uses its buffer again", "what is held is what was sent")
def test_action_that_changes() -> None:
    buffer = [0.0]

    def on_board(observation: int) -> list[float]:
        buffer[0] += 1.0
        return buffer

    with Always(refuses, on_board, deadline=5.0) as policy:
        actions = [policy.infer(it) for it in range(3)]
    assert actions == [[1.0], [2.0], [3.0]]
    with Always(refuses, Hold([0.0]), deadline=5.0) as policy:
        action = policy.infer(0)
        action[0] = 99.0
        assert policy.infer(1) == [0.0]
    with Always(server(lambda _: on_board(0)), Hold([0.0]), deadline=5.0) as policy:
        first = policy.infer(0)
        policy.infer(1)
        assert first == [4.0]


@pytest.mark.parametrize(
    ("chunk", "words"),
    [
        (10, "give Chunk(every"),
        (Chunk(every=10, max_age=2), "a max_age of 2 ticks is less than the 10"),
        (Chunk(every=1, max_age=4, blend=fade), "as in fade(5)"),  # type: ignore[arg-type]
    ],
)
@misuse("gives a chunk that is none", "`ConfigError`, with the remedy")
def test_odd_chunk(chunk: Any, words: str) -> None:
    with pytest.raises(ConfigError) as raised:
        Always(refuses, Hold([0.0]), period=0.1, chunk=chunk)
    assert words in str(raised.value)


@misuse("holds a policy", "`ConfigError`: `on_board` itself")
def test_hold_of_a_policy() -> None:
    refused("without Hold", lambda: Hold(Module()))


@misuse("gives a server that takes longer than the deadline", "one call at a time; it is answered")
def test_server_that_is_slow() -> None:
    connections: list[Any] = []

    class Server:
        def __init__(self) -> None:
            connections.append(self)

        def infer(self, observation: Any) -> Any:
            time.sleep(0.1)
            return [0.0]

        def close(self) -> None:
            pass

    with Always(Server, Hold([0.0]), deadline=0.005, linger=5.0) as policy:
        ticks(policy, lambda: policy.counts["remote", "call", "answered"] >= 3)
        assert policy.counts["remote", "call", "failed"] == 0
    assert len(connections) == 1


@misuse("gives a server whose chunks come when they are too old", "a failure, with the ages")
def test_chunk_that_is_too_old() -> None:
    failures: list[Failure] = []

    def reply(observation: Any) -> Any:
        time.sleep(0.1)
        return [[0.0]] * 50

    chunk = Chunk(every=1, max_age=2, within=5.0)
    with Always(
        server(reply), Hold([0.0]), deadline=5.0, chunk=chunk, on_failure=failures.append
    ) as policy:
        ticks(policy, lambda: bool(failures))
    assert "none of its 50 actions may be sent any more (max_age=2)" in failures[0].why


@misuse("calls `infer` in the policy on board, or on a failure", "`RuntimeError`, as a failure")
def test_infer_within_infer(caplog: pytest.LogCaptureFixture) -> None:
    failures: list[Failure] = []

    def on_failure(failure: Failure) -> None:
        failures.append(failure)
        policy.infer(0)

    with (
        Always(refuses, lambda o: policy.infer(o), deadline=5.0, on_failure=on_failure) as policy,
        pytest.raises(RuntimeError, match="infer was called in the policy on board"),
    ):
        policy.infer(0)
    assert "on_failure failed" in caplog.text


@misuse("gives a class for a policy on board", "`ConfigError`")
def test_class_for_a_policy_on_board() -> None:
    refused("give an instance", lambda: Always(refuses, Module, deadline=0.1))  # type: ignore[arg-type]


@misuse("gives a policy on board whose actions change their form", "a failure; the last action")
def test_on_board_of_another_form() -> None:
    failures: list[Failure] = []
    with Always(
        server(refuses), lambda n: [0.0] * (2 + n % 2), deadline=5.0, on_failure=failures.append
    ) as policy:
        assert [len(policy.infer(n)) for n in (0, 1, 2)] == [2, 2, 2]
    whys = [it.why for it in failures if it.source.priority == 0]
    assert len(whys) == 1 and "the action on board now has the shape (3,)" in whys[0], whys


@misuse("requests chunks less often than they have actions", "logged once, with the remedy")
def test_chunks_that_are_too_short(caplog: pytest.LogCaptureFixture) -> None:
    chunk = Chunk(every=5, max_age=9, within=5.0)
    with Always(server(lambda _: [[0.5]] * 3), Hold([0.0]), deadline=5.0, chunk=chunk) as policy:
        ticks(policy, lambda: policy.counts["remote", "call", "answered"] > 2)
    logged = [
        it.getMessage() for it in caplog.records if "a chunk has 3 actions" in it.getMessage()
    ]
    assert len(logged) == 1 and "every 5 ticks" in logged[0], logged


@misuse("stands still for longer than a chunk's actions may be old", "they are not sent; logged")
def test_stall_longer_than_a_chunk(caplog: pytest.LogCaptureFixture) -> None:
    chunk = Chunk(every=20, max_age=40, within=5.0)
    answers = server(lambda _: [[0.5]] * 40)
    with Always(answers, Hold([0.0]), period=2.0, deadline=2.0, chunk=chunk) as policy:
        ticks(policy, lambda: policy.infer([0.0]) == [0.5])
        assert policy._rate is not None and policy._plan is not None
        # This plays a previous tick that was `periods` ago.
        for periods, is_old in ((41, False), (41.5, True)):
            now = time.monotonic()
            policy._rate._before = now
            policy._plan.check_gap(policy._rate.tick(now + periods * 2.0))
            assert (not policy._plan._chunks) == is_old
    said = [it.getMessage() for it in caplog.records if "are not sent" in it.getMessage()]
    assert len(said) == 1 and "max_age is 40 ticks" in said[0], said


@misuse("calls `infer` at another rate than the period says", "logged once, with both")
def test_rate_of_another_period(caplog: pytest.LogCaptureFixture) -> None:
    for mean, is_reported in ((0.009, True), (0.041, True), (0.011, False), (0.039, False)):
        caplog.clear()
        rate = TickRate(0.02, "policy")
        for tick in range(200):
            rate.tick(7.0 + tick * mean)
        said = [it.getMessage() for it in caplog.records]
        assert len(said) == is_reported, (mean, said)
    with Always(server(refuses), Hold(0.0), period=2.0) as policy:
        caplog.clear()
        for _ in range(60):
            policy.infer(0)
    assert any("the period is 2 s" in it.getMessage() for it in caplog.records)


def test_new_reason_is_named_after_eight() -> None:
    failures = PolicyFailures("policy", None)
    for kind in [*range(8), 0]:
        failures.ended(f"reason {kind}")
    failures.ended("certificate expired")
    counted = {key[2]: count for key, count in failures.counts.items() if "because" in key[1]}
    assert counted["certificate expired"] == 1 and counted["reason 0"] == 2
    assert "reason 1" not in counted and counted["other reasons"] == 1
    assert sum(counted.values()) == failures.counts["remote", "call", "failed"] == 10
