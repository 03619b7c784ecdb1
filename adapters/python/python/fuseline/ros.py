"""Joins topics in a node of rclpy, like `message_filters`, with a bounded wait.

A set is given when each topic has a message in it, or when its wait is over. It names the topics
that are missing, so a sensor that died blocks nothing. Dropped messages are reported. It runs on
rclpy's executor, without an asyncio loop.

    subscribers = {name: message_filters.Subscriber(node, Image, f"/{name}") for name in cameras}
    synchronizer = TimeSynchronizer(node, subscribers, wait=0.02)
    synchronizer.registerCallback(lambda joined: detect(joined.set, joined.missing))
    synchronizer.on_drop(lambda drop: node.get_logger().warn(f"{drop.input}: {drop.why.value}"))
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

from fuseline._counts import Counts
from fuseline._errors import ConfigError
from fuseline._fuseline import Aligner, nanoseconds
from fuseline._item import Lineage, fields_of
from fuseline._join import INPUT_OUTCOMES, JoinCause, JoinDrop, JoinDropReason, Joined
from fuseline._wiring import check_count, check_function

if TYPE_CHECKING:
    from fuseline._judge import Duration

__all__ = ["Subscriber", "TimeSynchronizer", "stamp_of"]


class Subscriber(Protocol):
    """Describes the part of `message_filters.Subscriber` that is used here."""

    def registerCallback(self, callback: Callable[..., Any], *arguments: Any) -> Any:  # noqa: N802
        """Registers a function that is called with each message."""


class TimeSynchronizer:
    """Collects the messages of several topics that have the same stamp in a set.

    Args:
        node: The rclpy node, whose timer ends a wait. Waits use the monotonic clock, so a step of
            the wall clock does not change them. Stamps are only compared with each other (D13).
        subscribers: The subscribers by name. Their messages have a header.
        wait: The time that a set waits after its first message.
        window: The number of sets that may wait. If another one begins, the oldest is given
            incomplete.
        key: Returns the key that the messages of one set share: their stamp by default.
        clock: Returns whole nanoseconds that never go back.
        timer: Calls a function once after the given seconds, and returns a function that cancels
            the call; a steady timer of the node by default.

    >>> class Subscriber:  # stands for message_filters.Subscriber
    ...     def registerCallback(self, callback):
    ...         self.receive = callback
    >>> left, right = Subscriber(), Subscriber()
    >>> synchronizer = TimeSynchronizer(
    ...     None,  # the node, which is used only for its timer
    ...     {"left": left, "right": right},
    ...     wait=0.02,
    ...     key=lambda message: message["stamp"],
    ...     timer=lambda seconds, function: lambda: None,
    ... )
    >>> synchronizer.registerCallback(lambda joined: print(joined.set, joined.missing))
    >>> left.receive({"stamp": 7, "data": "a van"})
    >>> right.receive({"stamp": 7, "data": "a bicycle"})
    {'left': {'stamp': 7, 'data': 'a van'}, 'right': {'stamp': 7, 'data': 'a bicycle'}} []
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
        #: The counts of sets, by cause, of missing topics, and of dropped messages.
        self.counts: Counts[tuple[str, str]] = Counts(
            known=[
                *(("set", it.value) for it in JoinCause),
                *((name, outcome) for name in subscribers for outcome in INPUT_OUTCOMES),
            ]
        )
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
        """Registers a function that is called with each set."""
        check_function(callback, "a callback")
        self._callbacks.append(callback)

    def on_drop(self, on_drop: Callable[[JoinDrop], Any]) -> None:
        """Registers a function that gets each dropped message: late, repeated or without a key."""
        check_function(on_drop, "on_drop")
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
        while (joined := self._aligner.next_set(self._clock())) is not None:
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
        """Calls the callbacks without the lock, because they may call this object."""
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
