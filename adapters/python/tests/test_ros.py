"""Tests the join for nodes of rclpy, with stand-ins for ROS's subscribers and timer."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from fuseline import JoinCause, JoinDrop, JoinDropReason, Joined
from fuseline._counts import Counts
from fuseline.ros import TimeSynchronizer

MS = 1_000_000


class Topic:
    """Is a subscriber that gets its messages from the test."""

    def __init__(self) -> None:
        self.publish: Callable[[Any], None] = lambda _: None

    def registerCallback(self, callback: Callable[..., Any], *arguments: Any) -> None:  # noqa: N802
        self.publish = callback


class Timers:
    """Is a clock with at most one timer."""

    now = 0
    due: int | None = None
    fire: Callable[[], None] | None = None

    def __call__(self, seconds: float, fire: Callable[[], None]) -> Callable[[], None]:
        assert self.due is None, "two timers at once"
        self.due, self.fire = self.now + round(seconds * 1e9), fire
        return self.cancel

    def cancel(self) -> None:
        self.due = None

    def until(self, ms: int) -> None:
        while self.due is not None and self.due <= ms * MS and self.fire is not None:
            self.now = self.due
            self.fire()
        self.now = ms * MS


def image(seconds: int, text: str) -> Any:
    stamp = SimpleNamespace(sec=seconds, nanosec=5)
    return SimpleNamespace(header=SimpleNamespace(stamp=stamp), text=text)


def test_a_set_waits_no_longer_than_it_may_and_each_drop_is_reported() -> None:
    """A set waits no longer than its bound, and each drop is reported (E5, E6)."""
    timers, left, right = Timers(), Topic(), Topic()
    given: list[tuple[int, Joined]] = []
    drops: list[JoinDrop] = []
    joined = TimeSynchronizer(
        None,
        {"left": left, "right": right},
        wait=0.02,
        clock=lambda: timers.now,
        timer=timers,
    )
    joined.registerCallback(lambda it: given.append((timers.now // MS, it)))
    joined.on_drop(drops.append)
    left.publish(image(7, "west"))
    timers.until(5)
    right.publish(image(7, "east"))
    left.publish(image(8, "alone"))
    timers.until(60)
    right.publish(image(8, "late"))
    assert [(at, it.missing, it.cause) for at, it in given] == [
        (5, [], JoinCause.COMPLETE),
        (25, ["right"], JoinCause.DUE),
    ]
    assert {name: it.text for name, it in given[0][1].set.items()} == {
        "left": "west",
        "right": "east",
    }
    assert drops == [JoinDrop("right", 8_000_000_005, JoinDropReason.LATE)]
    assert joined.counts == {
        ("set", "complete"): 1,
        ("set", "due"): 1,
        ("right", "missing"): 1,
        ("right", "dropped late"): 1,
    }
    assert timers.due is None


def test_a_callback_may_publish_what_is_joined_next() -> None:
    timers, only = Timers(), Topic()
    seen: list[int] = []
    joined = TimeSynchronizer(
        None, {"only": only}, wait=1.0, clock=lambda: timers.now, timer=timers, key=lambda it: it
    )

    def again(it: Joined) -> None:
        seen.append(it.key)
        if it.key < 3:
            only.publish(it.key + 1)

    joined.registerCallback(again)
    only.publish(1)
    assert seen == [1, 2, 3]


class GuardedCounts(Counts[tuple[str, str]]):
    """Checks that counts change only while their synchronizer's lock is held."""

    def __init__(self, lock: threading.Lock) -> None:
        self._held = lock
        super().__init__()

    def __setitem__(self, key: tuple[str, str], count: int) -> None:
        assert self._held.locked(), f"{key} is counted outside the lock"
        super().__setitem__(key, count)


def test_an_executor_with_several_threads_loses_no_count_and_no_timer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Counts change under the lock, and a node's timer is destroyed with its set."""
    clocks = SimpleNamespace(Clock=SimpleNamespace, ClockType=SimpleNamespace(STEADY_TIME="steady"))
    monkeypatch.setitem(sys.modules, "rclpy.clock", clocks)
    set_timers: list[SimpleNamespace] = []
    after: list[float] = []

    class Node:
        def create_timer(self, seconds: float, fire: Callable[[], None], clock: Any) -> Any:
            assert clock.clock_type == "steady"
            after.append(seconds)
            set_timers.append(SimpleNamespace(fire=fire, cancel=lambda: ended.append("cancel")))
            return set_timers[-1]

        def destroy_timer(self, timer: SimpleNamespace) -> None:
            set_timers.remove(timer)
            ended.append("destroy")

    ended: list[str] = []
    now, left, right = [0], Topic(), Topic()
    joined = TimeSynchronizer(
        Node(), {"left": left, "right": right}, wait=0.02, clock=lambda: now[0]
    )
    joined.counts = GuardedCounts(joined._lock)
    given: list[Joined] = []
    joined.registerCallback(given.append)
    left.publish(image(1, "west"))
    now[0] = 15 * MS
    left.publish(image(2, "west"))  # the timer is of the first one still
    right.publish(image(1, "east"))
    now[0] = 35 * MS
    (timer,) = set_timers
    timer.fire()
    right.publish(image(2, "late"))
    left.publish(image(2, "late again"))
    assert [it.missing for it in given] == [[], ["right"]]
    assert (joined.counts["right", "dropped late"], joined.counts["left", "dropped late"]) == (1, 1)
    assert after == pytest.approx([0.02, 0.005, 0.02])
    assert not set_timers and ended == ["cancel", "destroy"] * 3
