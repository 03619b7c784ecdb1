"""Tests that `fuseline.robot` always has an action, whatever the remote policies do."""

from __future__ import annotations

import asyncio
import random
import threading
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fuseline
import pytest
from conftest import Run
from fuseline import Call, ConfigError, StampedValue, _remote
from fuseline._chunks import ArrivedChunk, ChunkPlan, _split, actions_of
from fuseline._remote import RemoteThread
from fuseline.robot import Always, Chunk, Hold, fade
from fuseline.testing import VirtualLoop

HELD = {"of": -1}


class HostileServer:
    """Makes connections whose replies are quick, slow, lost or failures, by a seed."""

    def __init__(self, seed: int, chunk: int | None = None, *, never: bool = False) -> None:
        self.random = random.Random(seed)
        self.chunk, self.never = chunk, never
        self.connections: list[HostileConnection] = []

    def connect(self) -> HostileConnection:
        if self.connections and self.random.random() < 0.2:
            raise ConnectionRefusedError("it is being started again")
        self.connections.append(HostileConnection(self))
        return self.connections[-1]


class HostileConnection:
    """Ends its call when it is closed, as a socket does."""

    def __init__(self, server: HostileServer) -> None:
        self.server = server
        self.closed = threading.Event()
        self.calls = 0

    def infer(self, observation: dict[str, int]) -> Any:
        self.calls += 1
        assert self.calls == 1, "two calls at once"
        try:
            kind = self.server.random.random()
            wait = 60.0 if kind < 0.002 or self.server.never else 0.004 if kind < 0.1 else 0.0
            if self.closed.wait(wait) or kind > 0.995:
                raise ConnectionError("the connection ended")
        finally:
            self.calls -= 1
        of = observation["t"]
        if self.server.chunk is None:
            return {"of": of}
        return [{"of": of, "for": of + k} for k in range(self.server.chunk)]

    def close(self) -> None:
        self.closed.set()


def test_each_tick_has_an_action_and_none_is_of_another(tmp_path: Path) -> None:
    trace = tmp_path / "run.jsonl"
    server = HostileServer(1)
    sources: Counter[str] = Counter()
    policy = Always(server.connect, Hold(HELD), deadline=0.002, linger=0.02, trace=trace)
    with policy:
        for t in range(10_000):
            action = policy.infer({"t": t})
            assert policy.item is not None and policy.item.source is not None
            sources[policy.item.source.name] += 1
            # A late reply never acts for a later tick (D2).
            assert policy.item.source.name == "local" or action == {"of": t}
    verdict = fuseline.check(trace)
    assert not verdict.violations and verdict.judged == 10_000
    assert sources["remote"] > 0 and sources["local"] > 0, sources
    assert len(server.connections) > 1, "no call was ended"


def test_a_chunk_is_used_while_it_is_young_and_its_actions_are_for_their_ticks(
    tmp_path: Path,
) -> None:
    trace = tmp_path / "run.jsonl"
    chunk = Chunk(every=5, max_age=12, within=0.02)
    server = HostileServer(2, chunk=20)
    policy = Always(server.connect, Hold(HELD), deadline=0.5, chunk=chunk, trace=trace)
    sent = 0
    with policy:
        for t in range(2_000):
            action = policy.infer({"t": t})
            item = policy.item
            assert item is not None and item.source is not None
            if item.source.name == "remote":
                assert action["for"] == t and item.of == action["of"]
                assert t - action["of"] <= 12
                sent += 1
    assert not fuseline.check(trace).violations
    emits = [it for it in fuseline.Trace(trace).lines if it.ev == "emit" and it.p == 1]
    assert sent > 0 and [it.meant_for for it in emits] == [it.t for it in emits]


def test_a_spliced_chunk_does_not_act(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A spliced chunk does not act (D18)."""
    action = ArrivedChunk.action

    def spliced(chunk: ArrivedChunk, t: int, max_age: int) -> Any:
        return action(chunk, t if t < 9 else t + 3, max_age)

    monkeypatch.setattr(ArrivedChunk, "action", spliced)
    trace = tmp_path / "run.jsonl"
    chunk = Chunk(every=5, max_age=9_999, within=60.0)
    server = HostileServer(2, chunk=10_000)
    with Always(server.connect, Hold(HELD), deadline=0.5, chunk=chunk, trace=trace) as policy:
        for t in range(10_000):
            policy.infer({"t": t})
            assert policy.item is not None and policy.item.source is not None
            assert t < 9 or policy.item.source.name == "local"
            if f"the value is meant for message {t + 3}" in [it.why for it in policy.item.failures]:
                break
        else:
            pytest.fail("no chunk came")
    assert not fuseline.check(trace).violations


def test_a_server_that_never_answers_costs_no_tick() -> None:
    server = HostileServer(3, never=True)
    with Always(server.connect, Hold(HELD), deadline=0.001, linger=0.001) as policy:
        assert [policy.infer({"t": t}) for t in range(300)] == [HELD] * 300


def test_a_policy_whose_calls_failed_is_called_again_and_its_last_action_is_held_meanwhile(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Calls go on after more ended connections than the bound on hung threads (D2, D7)."""

    class RestartingServer:
        def infer(self, tick: int) -> int:
            if tick % 2:
                raise ConnectionError("it is being started again")
            return tick

        def close(self) -> None:
            pass

    monkeypatch.setattr(_remote, "PAUSE", 0.0)
    ticks = range(6 * _remote.HUNG_THREADS)
    with Always(RestartingServer, Hold(-1), deadline=5.0) as policy:
        assert [policy.infer(tick) for tick in ticks] == [tick - tick % 2 for tick in ticks]


@pytest.mark.parametrize("chunk", [None, Chunk(every=1, max_age=1, within=60.0)])
@pytest.mark.parametrize("never", [True, False])
def test_a_policy_that_is_closed_ends_its_connection_and_its_threads(
    chunk: Chunk | None, never: bool
) -> None:
    """A policy that is closed ends its connection and its threads (D8)."""
    threads = threading.active_count()
    server = HostileServer(4, chunk=2, never=never)
    with Always(server.connect, Hold(HELD), deadline=0.001, linger=60.0, chunk=chunk) as policy:
        # The connection is either in a call that hangs, or waits for the next call.
        while not server.connections or server.connections[-1].closed.is_set():
            policy.infer({"t": 0})
        assert threading.active_count() > threads
    for thread in threading.enumerate():
        if thread.name.startswith("fuseline-"):
            thread.join(30)
            assert not thread.is_alive()
    assert all(it.closed.is_set() for it in server.connections)
    assert threading.active_count() <= threads


class DeafServer:
    """Has calls that continue although their connection was closed."""

    def __init__(self) -> None:
        self.connections: list[DeafServer] = []
        self.ends = threading.Event()
        self.is_closed = False

    def connect(self) -> DeafServer:
        self.connections.append(DeafServer())
        return self.connections[-1]

    def infer(self, observation: Any) -> Any:
        self.ends.wait(60)
        return observation

    def close(self) -> None:
        self.is_closed = True


def test_a_chunk_under_way_is_given_up_at_the_end_though_its_call_hangs() -> None:
    """The chunk under way is given up at the end, even if its call hangs (D6)."""
    server = DeafServer()
    chunk = Chunk(every=1, max_age=1, within=60.0)
    with Always(server.connect, Hold("held"), deadline=0.01, chunk=chunk) as policy:
        while not server.connections:
            policy.infer(0)
        assert policy._plan is not None
        request = policy._plan._request
        assert request is not None and not request.done()
    assert request.cancelled()
    server.connections[0].ends.set()


def test_calls_go_on_after_calls_that_hang(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Calls come later the more threads hang, and normally once those have ended (D7, D8)."""
    now = [0.0]
    monkeypatch.setattr(_remote, "monotonic", lambda: now[0])
    server, errors = DeafServer(), list[Any]()
    most = _remote.HUNG_THREADS

    async def main() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda _, context: errors.append(context))
        remote = RemoteThread(server.connect)
        for n in range(most + 4):
            # The clock advances to the instant until which the next call waits.
            now[0] = remote._ended + _remote.PAUSE * 2 ** max(n - most, 0)
            assert remote.is_ready()
            call = asyncio.ensure_future(remote.infer(n, Call(n, 1.0)))
            while len(server.connections) <= n or remote._connection is None:
                await asyncio.sleep(0.001)
            call.cancel()
            await asyncio.wait([call])
            assert not remote.is_ready(), "just after a connection ended"
        assert f"{most} threads hang" in caplog.text
        for connection in server.connections:
            connection.ends.set()
        while any(it.name == "fuseline-remote" for it in threading.enumerate()):
            await asyncio.sleep(0.001)
        now[0] = remote._ended + _remote.PAUSE
        assert remote.is_ready()
        call = asyncio.ensure_future(remote.infer("again", Call(99, 1.0)))
        while len(server.connections) <= most + 4:
            await asyncio.sleep(0.001)
        server.connections[-1].ends.set()
        assert await call == "again"
        assert remote.is_ready(), "for a connection that is there"
        remote.close()
        assert not remote.is_ready(), "just after a connection ended"
        while any(it.name.startswith("fuseline-remote") for it in threading.enumerate()):
            await asyncio.sleep(0.001)

    asyncio.run(main())
    assert all(it.is_closed for it in server.connections)
    assert not errors, "a reply came for a call that was given up"


def test_a_policy_that_was_closed_while_it_connected_is_closed_once_it_is_there() -> None:
    connecting, go_on = threading.Event(), threading.Event()
    server = DeafServer()

    def connect() -> DeafServer:
        connecting.set()
        go_on.wait(60)
        return server.connect()

    async def main() -> None:
        remote = RemoteThread(connect)
        call = asyncio.ensure_future(remote.infer(0, Call(0, 1.0)))
        await asyncio.to_thread(connecting.wait, 60)
        call.cancel()
        await asyncio.wait([call])
        (thread,) = (it for it in threading.enumerate() if it.name == "fuseline-remote")
        go_on.set()
        thread.join(30)
        assert not thread.is_alive(), "it called a server that nobody waits for"

    asyncio.run(main())
    assert [it.is_closed for it in server.connections] == [True]


class PlannedRemote:
    """Answers with chunks of three ticks when the test says so, or fails."""

    def __init__(self) -> None:
        self.requested: list[int] = []
        self.answers: dict[int, asyncio.Future[Any]] = {}
        self.ready = True

    def is_ready(self) -> bool:
        return self.ready

    async def infer(self, observation: int, call: Call) -> Any:
        self.requested.append(observation)
        self.answers[observation] = asyncio.get_running_loop().create_future()
        return await self.answers[observation]


async def settled() -> None:
    for _ in range(5):
        await asyncio.sleep(0)


def test_chunks_are_requested_in_time_and_again_after_each_kind_of_end(run: Run[Any]) -> None:
    """Chunks are requested in time, and again after each kind of end (D2, D7)."""

    async def main(loop: VirtualLoop) -> None:
        remote: Any = PlannedRemote()
        plan = ChunkPlan(remote, Chunk(every=4, max_age=5, within=1.0))

        async def tick(t: int) -> Any:
            plan.request(t, t)
            await settled()
            planned = plan.planned(t, None)
            return None if planned is None else (planned.value, planned.of)

        async def answer(t: int) -> None:
            remote.answers[t].set_result([f"{t} for {t + k}" for k in range(3)])
            await settled()

        assert await tick(0) is None and await tick(1) is None
        await answer(0)
        assert [await tick(t) for t in (1, 2, 3)] == [("0 for 1", 0), ("0 for 2", 0), None]
        assert remote.requested == [0], "not before every fourth tick"
        assert await tick(4) is None
        assert await tick(9) is None
        assert remote.requested == [0, 4], "none while one is under way"
        await answer(4)
        assert await tick(9) is None, "its actions were for ticks that have passed"
        assert remote.requested == [0, 4, 9]
        # After a request that fails or takes too long, the next tick makes another.
        remote.answers[9].set_exception(ConnectionError("broke"))
        await settled()
        assert await tick(9) is None and remote.requested == [0, 4, 9]
        assert await tick(10) is None and remote.requested == [0, 4, 9, 10]
        await asyncio.sleep(0.99)
        assert not remote.answers[10].done()
        await asyncio.sleep(0.02)
        assert remote.answers[10].cancelled()
        remote.ready = False
        assert await tick(11) is None and remote.requested[-1] == 10
        remote.ready = True
        await tick(12)
        assert remote.requested[-1] == 12
        # A chunk that was cleared never acts, even if it was under way.
        await answer(12)
        assert await tick(12) == ("12 for 12", 12)
        plan.clear()
        assert await tick(13) is None
        assert await tick(16) is None and remote.requested[-1] == 16
        plan.clear()
        await answer(16)
        assert await tick(17) is None
        assert await tick(20) is None and remote.requested[-1] == 20
        plan.close()
        await settled()
        assert remote.answers[20].cancelled()

    run(main)


def test_a_chunk_that_skips_nothing_begins_with_its_first_action(run: Run[Any]) -> None:
    async def main(loop: VirtualLoop) -> None:
        remote: Any = PlannedRemote()
        plan = ChunkPlan(remote, Chunk(every=1, max_age=4, skip="none"))
        plan.request(0, 0)
        await settled()
        plan.request(2, 2)
        remote.answers[0].set_result(["first", "second", "third"])
        await settled()
        planned = [plan.planned(t, None) for t in range(2, 6)]
        # The third action would be for tick 5, which is five ticks after its observation.
        assert planned == [None, StampedValue("first", 0, 3), StampedValue("second", 0, 4), None]
        plan.close()

    run(main)


def test_a_tick_without_an_action_says_so_and_a_new_episode_forgets_the_old_one() -> None:
    def on_board(observation: int) -> Any:
        raise KeyError("nothing seen")

    class ListingServer:
        def infer(self, tick: int) -> list[str]:
            return [f"{tick} for {tick + k}" for k in range(3)]

        def close(self) -> None:
            pass

    def refused() -> Any:
        raise ConnectionRefusedError

    with Always(refused, on_board, deadline=0.01) as policy:
        with pytest.raises(RuntimeError, match="no action for tick 0: missed"):
            policy.infer(0)
        assert policy.item is not None and policy.item.source is None
    chunk = Chunk(every=100, max_age=100, within=60.0)
    with Always(ListingServer, Hold("held"), deadline=5.0, chunk=chunk) as policy:
        while policy._plan is not None and not policy._plan._chunks:
            assert str(policy.infer(0)).startswith(("held", "0 for"))
        assert len(policy._plan._chunks if policy._plan else ()) == 1
        policy.reset()
        assert policy.infer(1) == policy._last
        assert policy.item is not None and str(policy.item.source) == "local"
    policy.close()
    with pytest.raises(ConfigError, match="does not run"):
        policy.infer(2)


def test_a_blend_that_changes_nothing_is_of_its_own_message() -> None:
    arrays = pytest.importorskip("numpy")
    forms: list[Callable[[float], Any]] = [
        lambda x: x,
        lambda x: [0.0, x],
        lambda x: {"a": 0.0, "b": x},
        lambda x: arrays.array([0.0, x]),
        lambda x: {"a": arrays.array([0.0, x]), "b": 1.0},
    ]
    for form in forms:
        for later, of in ((1.0, 1), (2.0, 0)):
            plan = ChunkPlan(RemoteThread(DeafServer().connect), Chunk(1, 9, blend=fade(2)))
            plan._chunks.extend([ArrivedChunk(0, 0, [form(1.0)] * 9)])
            plan._chunks.extend([ArrivedChunk(1, 1, [form(later)] * 9)])
            planned = plan.planned(1, None)
            assert planned is not None and planned.of == of, (form(0.0), later)
    far = fade(1, max_jump=0.5)(None, arrays.array([3.0, -3.0, 0.1]), 5, arrays.zeros(3))
    assert list(far) == [0.5, -0.5, 0.1]


@pytest.mark.parametrize(
    ("split", "reply"),
    [
        (lambda reply: reply["steps"][1:], {"steps": ["a header", 1.0, 2.0], "arm": [0, 0, 0]}),
        (list, (1.0, 2.0)),
        (tuple, [1.0, 2.0]),
    ],
)
def test_a_reply_may_be_split_by_a_function(run: Run[Any], split: Any, reply: Any) -> None:
    async def main(loop: VirtualLoop) -> None:
        remote: Any = PlannedRemote()
        chunk = Chunk(every=9, max_age=9, split=split)
        plan = ChunkPlan(remote, chunk)
        plan.request(0, 0)
        await settled()
        remote.answers[0].set_result(actions_of(reply, chunk, lambda *_: None))
        await settled()
        planned = [plan.planned(t, None) for t in range(3)]
        assert planned == [StampedValue(1.0, 0, 0), StampedValue(2.0, 0, 1), None]

    run(main)


def test_replies_are_split_by_what_they_are_made_of() -> None:
    assert _split([1, 2]) == [1, 2]
    reply = {"arm": [1, 2], "gripper": [7, 8], "server": "west"}
    assert _split(reply) == [
        {"arm": 1, "gripper": 7, "server": "west"},
        {"arm": 2, "gripper": 8, "server": "west"},
    ]
    assert _split({"actions": [[1], [2]], "state": [7, 8, 9]}) == [
        {"actions": [1], "state": [7, 8, 9]},
        {"actions": [2], "state": [7, 8, 9]},
    ]
    with pytest.raises(ConfigError, match="has no arrays"):
        _split({"server": "west"})
    with pytest.raises(ConfigError, match="arm 3, gripper 2; give the chunk a split="):
        _split({"arm": [1, 2, 3], "gripper": [7, 8]})
    arrays = pytest.importorskip("numpy")
    ticks = _split({"arm": arrays.arange(6).reshape(3, 2), "scale": arrays.float64(2)})
    assert [list(it["arm"]) for it in ticks] == [[0, 1], [2, 3], [4, 5]]


def test_actions_of_one_form_are_blended_number_by_number() -> None:
    blend = fade(2)
    earlier = {"arm": (0.0, 0.0), "is_open": True, "name": "a", "grip": 1.0}
    later = {"arm": (4.0, 8.0), "is_open": False, "name": "b", "grip": None, "new": 1.0}
    assert blend(earlier, later, 0, None) == {
        "arm": (2.0, 4.0), "is_open": False, "name": "b", "grip": None, "new": 1.0,
    }  # fmt: skip
    assert blend(earlier, later, 1, None) == blend(None, later, 0, None) == later


def test_no_action_jumps_further_than_stated() -> None:
    blend = fade(4, max_jump=0.5)
    last = {"joints": [0.0, 0.0]}
    for age in range(12):
        action = blend({"joints": [0.0, 0.0]}, {"joints": [3.0, -1.0]}, age, last)
        for before, after in zip(last["joints"], action["joints"], strict=True):
            assert abs(after - before) <= 0.5
        last = action
    assert last["joints"] == [3.0, -1.0]


def test_a_blend_is_of_the_oldest_message() -> None:
    chunk = Chunk(every=1, max_age=9, blend=fade(3))
    plan = ChunkPlan(RemoteThread(HostileServer(0).connect), chunk)
    plan._chunks.extend([ArrivedChunk(0, 0, [0.0] * 9), ArrivedChunk(2, 2, [9.0] * 9)])
    planned = [plan.planned(t, None) for t in range(2, 5)]
    assert planned == [StampedValue(3.0, 0, 2), StampedValue(6.0, 0, 3), StampedValue(9.0, 2, 4)]


@pytest.mark.parametrize(
    ("options", "deadline"), [({"period": 2.0}, 1.5), ({"period": 2.0, "deadline": 1.9}, 1.9)]
)
def test_a_deadline_is_three_quarters_of_the_period_unless_it_is_given(
    tmp_path: Path, options: dict[str, Any], deadline: float
) -> None:
    class NegatingServer:
        def infer(self, tick: int) -> int:
            return -tick

        def close(self) -> None:
            pass

    trace = tmp_path / "run.jsonl"
    with Always(NegatingServer, Hold(0), trace=trace, name="arm", **options) as policy:
        assert policy.infer(7) == -7
    run = fuseline.Trace(trace)
    assert run.header["operator"] == "arm"
    assert [it.deadline for it in run.lines if it.ev == "offer"] == [deadline * 1e9]


def test_a_tick_that_waits_when_the_operator_is_stopped_says_so() -> None:
    go_on = threading.Event()

    def on_board(observation: int) -> int:
        loop = policy._operator._loop
        assert loop is not None
        loop.call_soon_threadsafe(policy._operator.operator.stop)
        go_on.wait(30)
        return observation

    def refused() -> Any:
        raise ConnectionRefusedError

    with Always(refused, on_board, deadline=5.0) as policy:
        with pytest.raises(RuntimeError, match="the policy was closed"):
            policy.infer(1)
        go_on.set()


def test_a_policy_on_board_acts_where_the_server_does_not() -> None:
    class OnBoard:
        def infer(self, obs: int) -> int:
            return -obs

    def refused() -> Any:
        raise ConnectionRefusedError

    with Always(refused, OnBoard(), period=0.5) as policy:
        assert [policy.infer(t) for t in range(3)] == [0, -1, -2]
