"""Joins for nodes of rclpy: as `message_filters`, with a bound on waiting and drops reported.

A set is given when each topic is there or its wait is over, with the topics that are missing: a
sensor that died holds nothing up. It runs on rclpy's executor, without an asyncio loop.

    subscribers = {name: message_filters.Subscriber(node, Image, f"/{name}") for name in cameras}
    synchronizer = TimeSynchronizer(node, subscribers, wait=0.02)
    synchronizer.registerCallback(lambda joined: detect(joined.set, joined.missing))
    synchronizer.on_drop(lambda drop: node.get_logger().warn(f"{drop.input}: {drop.why.value}"))
"""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

from fuseline._errors import ConfigError
from fuseline._fuseline import Aligner, nanoseconds
from fuseline._item import Lineage, fields_of
from fuseline._join import JoinCause, JoinDrop, JoinDropReason, Joined
from fuseline._wiring import check_count, check_function

if TYPE_CHECKING:
    from fuseline._judge import Duration

__all__ = ["Subscriber", "TimeSynchronizer", "stamp_of"]


class Subscriber(Protocol):
    """What `message_filters.Subscriber` is here."""

    def registerCallback(self, callback: Callable[..., Any], *arguments: Any) -> Any:  # noqa: N802
        """Calls a function with each message."""


class TimeSynchronizer:
    """Gives the messages of several topics that have one stamp together.

    Args:
        node: The rclpy node, whose timer ends a wait. Instants are the monotonic clock's, so that
            a wall clock that steps moves none; stamps are compared alone (D13).
        subscribers: By name, of messages with a header.
        wait: How long a set waits after its first message.
        window: How many sets may wait; for one more the oldest is given as it is.
        key: What messages of one set have in common: by default their stamp.
        clock: Reads whole nanoseconds that never go back.
        timer: Has a function called once after so many seconds, and returns what cancels that; by
            default a steady timer of the node's.
    """

    def __init__(
        self,
        node: Any,
        subscribers: Mapping[str, Subscriber],
        *,
        wait: Duration,
        window: int = 16,
        key: Callable[[Any], int | None] | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
        timer: Callable[[float, Callable[[], None]], Callable[[], None]] | None = None,
    ) -> None:
        if not subscribers:
            raise ConfigError("a synchronizer of no topics; give at least one subscriber")
        check_count(window, 1, "a window")
        check_function(key or stamp_of, "a key")
        #: What was given and why, what was missing in it, and what was dropped.
        self.counts: Counter[tuple[str, str]] = Counter()
        self._key, self._clock = key or stamp_of, clock
        self._timer = timer or partial(_steady_timer, node)
        self._names = list(subscribers)
        self._aligner = Aligner(self._names, nanoseconds(wait), window, clock())
        self._callbacks: list[Callable[[Joined], Any]] = []
        self._on_drop: Callable[[JoinDrop], Any] | None = None
        self._cancel: Callable[[], None] | None = None
        # Executors may have several threads.
        self._lock = threading.Lock()
        for index, subscriber in enumerate(subscribers.values()):
            subscriber.registerCallback(partial(self._add, index))

    def registerCallback(self, callback: Callable[[Joined], Any]) -> None:  # noqa: N802
        """Calls a function with each set."""
        check_function(callback, "a callback")
        self._callbacks.append(callback)

    def on_drop(self, on_drop: Callable[[JoinDrop], Any]) -> None:
        """Calls a function with each message that is dropped: late, twice or without a key."""
        check_function(on_drop, "what is called on drops")
        self._on_drop = on_drop

    def _add(self, index: int, message: Any) -> None:
        key = self._key(message)
        name = self._names[index]
        with self._lock:
            now = self._clock()
            lineage = fields_of(Lineage(name, key, now))
            why = self._aligner.arrive(now, index, key, lineage, (message,), True)
            if why is not None:
                self.counts[name, f"dropped {why}"] += 1
            given = self._take()
        self._give(given)
        if why is not None and self._on_drop is not None:
            self._on_drop(JoinDrop(name, key, JoinDropReason(why)))

    def _tick(self) -> None:
        with self._lock:
            self._aligner.tick(self._clock())
            given = self._take()
        self._give(given)

    def _take(self) -> list[Joined]:
        given = []
        while (joined := self._aligner.next_set()) is not None:
            key, messages, missing, cause, _ = joined
            self.counts["set", cause] += 1
            for name in missing:
                self.counts[name, "missing"] += 1
            given.append(Joined(key, messages, missing, JoinCause(cause), None))
        if self._cancel is not None:
            self._cancel()
        due = self._aligner.next_due
        self._cancel = None
        if due is not None:
            self._cancel = self._timer(max(due - self._clock(), 0) / 1e9, self._tick)
        return given

    def _give(self, given: list[Joined]) -> None:
        """Callbacks may take long, and come back."""
        for joined in given:
            for callback in self._callbacks:
                callback(joined)


def stamp_of(message: Any) -> int:
    """Returns the nanoseconds of a message's stamp."""
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _steady_timer(node: Any, seconds: float, fire: Callable[[], None]) -> Callable[[], None]:
    from rclpy.clock import Clock, ClockType  # type: ignore[import-not-found]

    clock = Clock(clock_type=ClockType.STEADY_TIME)
    timer = node.create_timer(max(seconds, 1e-6), fire, clock=clock)

    def cancel() -> None:
        timer.cancel()
        node.destroy_timer(timer)

    return cancel
