"""Policies that always have an action: `fuseline.robot`, with remotes that harm them."""

from __future__ import annotations

import random
import threading
from collections import Counter
from pathlib import Path
from typing import Any

import fuseline
import pytest
from fuseline import ConfigError, StampedValue, _remote
from fuseline._chunks import ArrivedChunk, ChunkPlan
from fuseline._remote import RemoteThread
from fuseline.robot import Always, Chunk, Hold, fade

HELD = {"of": -1}


class HostileServer:
    """Connections whose replies are quick, slow, lost or failures, by a seed."""

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
    """Ends with its close, as a socket does."""

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
            # D2: a late reply never acts for a later tick.
            assert policy.item.source.name == "local" or action == {"of": t}
    verdict = fuseline.check(trace)
    assert verdict.conforms and verdict.judged == 10_000
    assert sources["remote"] > 0 and sources["local"] > 0, sources
    assert len(server.connections) > 1, "no call was ended"


def test_a_chunk_is_used_while_it_is_young_and_its_actions_are_for_their_ticks(
    tmp_path: Path,
) -> None:
    trace = tmp_path / "run.jsonl"
    chunk = Chunk(every=5, max_age=12, within=0.02)
    server = HostileServer(2, chunk=20)
    policy = Always(server.connect, Hold(HELD), deadline=0.5, chunk=chunk, trace=trace)
    with policy:
        for t in range(2_000):
            action = policy.infer({"t": t})
            item = policy.item
            assert item is not None and item.source is not None
            if item.source.name == "remote":
                assert action["for"] == t and item.of == action["of"]
                assert t - action["of"] <= 12
    assert fuseline.check(trace).conforms


def test_a_server_that_never_answers_costs_no_tick() -> None:
    server = HostileServer(3, never=True)
    with Always(server.connect, Hold(HELD), deadline=0.001, linger=0.001) as policy:
        assert [policy.infer({"t": t}) for t in range(300)] == [HELD] * 300


def test_a_policy_whose_calls_failed_is_called_again_and_its_last_action_is_held_meanwhile(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """D2, D7: as before after more ended connections than threads may hang."""

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
    assert planned == [StampedValue(3.0, 0), StampedValue(6.0, 0), StampedValue(9.0, 2)]


def test_a_policy_on_board_acts_where_the_server_does_not() -> None:
    class OnBoard:
        def infer(self, obs: int) -> int:
            return -obs

    def refused() -> Any:
        raise ConnectionRefusedError

    with Always(refused, OnBoard(), period=0.01) as policy:
        assert [policy.infer(t) for t in range(5)] == [0, -1, -2, -3, -4]


@pytest.mark.parametrize(
    "options", [{}, {"period": 0.1, "chunk": Chunk(0, 1)}, {"period": 0.1, "chunk": Chunk(1, -1)}]
)
def test_what_makes_no_policy_is_refused(options: dict[str, Any]) -> None:
    with pytest.raises(ConfigError):
        Always(HostileServer(0).connect, Hold(0), **options)
