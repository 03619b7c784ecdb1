"""One operator without its clock, its tasks and its files: what happened goes in, orders come out.

It carries out what the machine decides and decides nothing (D3).
"""

from __future__ import annotations

import logging
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Generic, TypeVar

from fuseline._fuseline import Fusion, nanoseconds
from fuseline._item import Ending, Failure, Item, Trigger
from fuseline._lane import Flight, Lane
from fuseline._words import (
    Admitted,
    Dropped,
    Firing,
    Forwarded,
    Held,
    Missed,
    Outcome,
    Refused,
    ns,
)
from fuseline.deadline import End, Situation

M = TypeVar("M")
V = TypeVar("V")

#: How many characters of a reason are kept.
WORDS = 200

_log = logging.getLogger("fuseline")


@dataclass(slots=True)
class Story(Generic[V]):
    """What is kept of an open message."""

    opened: int
    #: The best result held, its source and when it arrived (P3).
    held: tuple[Lane[Any], int, V] | None = None
    failures: list[Failure] = field(default_factory=list)


class Order(Enum):
    """What is to be done with a request."""

    #: Begin the call, or local's computation.
    START = 1
    #: End the call: its result is of no use any more. Never local's (F7).
    ABORT = 2


class Engine(Generic[M, V]):
    """The machine, the values it holds, the queues to its sources, and its counts.

    After each input, carry out `orders`, in their order, and empty them.
    """

    def __init__(
        self,
        name: str,
        fusion: Fusion,
        local: Lane[Any],
        clouds: list[Lane[Any]],
        deadline: int | None,
        waiting: int,
        skip_answered: bool,
    ) -> None:
        self.name = name
        self.fusion = fusion
        self.local = local
        self.clouds = clouds
        self._all = (local, *clouds)
        self.lanes = {lane.p: lane for lane in self._all}
        self.orders: deque[tuple[Order, Lane[Any], Flight[Any]] | Item[V]] = deque()
        self.counts: Counter[tuple[str, str, str]] = Counter()
        self.stories: dict[int, Story[V]] = {}
        self.situation = Situation()
        self._deadline = deadline
        self._waiting = waiting
        self._skip_answered = skip_answered
        self._lingers = any(lane.linger for lane in clouds)

    def open(self, now: int, t: int, message: M) -> None:
        """F1: a message came, and is offered to each cloud (F2)."""
        if self._lingers:
            self._lapse(now)
        fired, opening = self.fusion.open(now, t, self._deadline)
        if fired:
            self._fired(now, fired)
        counts, name = self.counts, self.name
        counts[name, "message", "came"] += 1
        if isinstance(opening, Refused):
            _log.warning("%s: message %d refused: %s", name, t, opening.why)
            counts[name, "message", f"refused {opening.why}"] += 1
            self.orders.append(Item(t, now, now, Ending.REFUSED, refusal=opening.why))
            self.send()
            return
        self.stories[t] = Story(now)
        self.local.waiting[t] = Flight(t, now, None, message)
        self.send()
        for lane in self.clouds:
            self._offer(now, t, lane, message)
        self.send()
        if len(self.local.waiting) > self._waiting:
            self.fail(now, t, self.local, "too many computations wait")

    def result(self, now: int, t: int, lane: Lane[Any], value: V) -> None:
        """F3: a source's result came."""
        if self._lingers:
            self._lapse(now)
        self._ended(now, t, lane, End.ANSWERED)
        fired, outcome = self.fusion.result(now, t, lane.p)
        if fired:
            self._fired(now, fired)
        name = lane.source.name
        if isinstance(outcome, Dropped):
            self.counts[name, "result", f"dropped {outcome.why}"] += 1
        else:
            is_held = isinstance(outcome, Held)
            self.counts[name, "result", "held" if is_held else "forwarded"] += 1
            story = self.stories[t]
            if story.held is None or story.held[0].p < lane.p:
                story.held = (lane, now, value)
            if not is_held:
                self._settle(now, t, Trigger.ARRIVAL, outcome)
        self.send()

    def fail(self, now: int, t: int, lane: Lane[Any], why: str) -> None:
        """F4: a source will send no result."""
        if self._lingers:
            self._lapse(now)
        name, why = lane.source.name, why[:WORDS]
        _log.warning("%s: no result of %s will come for message %d: %s", self.name, name, t, why)
        self._ended(now, t, lane, End.FAILED)
        fired, outcome = self.fusion.fail(now, t, lane.p)
        if fired:
            self._fired(now, fired)
        if isinstance(outcome, Dropped):
            self.counts[name, "failure", f"dropped {outcome.why}"] += 1
        else:
            self.counts[name, "failure", "accepted"] += 1
            self.stories[t].failures.append(Failure(lane.source, why))
            self._settle(now, t, Trigger.FAILURE, outcome)
        self.send()

    def tick(self, now: int) -> None:
        """F0: time went by."""
        if self._lingers:
            self._lapse(now)
        self._fired(now, self.fusion.tick(now))
        self.send()

    def next_due(self) -> int | None:
        """When a timer is due, or a call has lingered long enough. Tick then."""
        due = self.fusion.next_due
        if self._lingers:
            lapses = [at for lane in self.clouds if (at := lane.next_lapse()) is not None]
            return min([due, *lapses] if due is not None else lapses, default=None)
        return due

    def send(self) -> None:
        """Start what waits while there is room; once all that is due was served."""
        for lane in self._all:
            while lane.waiting:
                flight = lane.next()
                if flight is None:
                    break
                self.orders.append((Order.START, lane, flight))

    def _offer(self, now: int, t: int, lane: Lane[Any], message: M) -> None:
        assert lane.handlers is not None
        try:
            wanted = lane.handlers.message_handler(message, t)
            if wanted is None:
                return
            request, deadline = wanted
            limit = nanoseconds(deadline)
        except Exception:
            _log.exception("%s: the message handler of %s failed", self.name, lane.source)
            return
        backlog = len(lane.waiting)
        if lane.policy is not None:
            chosen = self._chosen(now, t, lane, limit, backlog)
            if chosen is None:
                return
            limit = chosen
        fired, admission = self.fusion.offer(now, t, lane.p, limit, backlog)
        if fired:
            self._fired(now, fired)
        if isinstance(admission, Admitted):
            self.counts[lane.source.name, "request", "admitted"] += 1
            lane.waiting[t] = Flight(t, now, admission.due, request)
        else:
            self.counts[lane.source.name, "request", f"refused {admission.why}"] += 1

    def _chosen(self, now: int, t: int, lane: Lane[Any], cap: ns, backlog: int) -> ns | None:
        """The deadline that the policy chooses, at most the cap; None if it fails."""
        assert lane.policy is not None
        # T6: it is asked about what is admitted alone, or it would count probes never sent.
        if cap == 0 or self.fusion.foresee(t, lane.p, backlog) is not None:
            return cap
        known = self.situation
        try:
            situation = Situation(known.speed, known.reveal, lane.ages(now))
            return ns(min(cap, lane.policy.decide(situation, cap).deadline))
        except Exception:
            _log.exception("%s: the policy of %s failed: nothing is asked", self.name, lane.source)
            return None

    def _fired(self, now: int, fired: tuple[Firing, ...]) -> None:
        """F5: timers fired."""
        for firing in fired:
            for p in firing.timers:
                lane = self.lanes[p]
                self.counts[lane.source.name, "timer", "fired"] += 1
                self._close(now, firing.t, lane)
            self._settle(now, firing.t, Trigger.TIMER, firing.outcome)

    def _settle(self, now: int, t: int, trigger: Trigger, outcome: Outcome) -> None:
        """F6, F7: the message is answered, missed, or waits."""
        if isinstance(outcome, Forwarded):
            self._retire(now, t, trigger)
            for p in outcome.cancelled:
                lane = self.lanes[p]
                self.counts[lane.source.name, "request", "cancelled"] += 1
                self._close(now, t, lane)
        elif isinstance(outcome, Missed):
            self._retire(now, t, trigger)

    def _retire(self, now: int, t: int, trigger: Trigger) -> None:
        """D1: sends the best available result, if any; the only way out of what was opened."""
        if self._skip_answered:
            self.local.waiting.pop(t, None)
        story = self.stories.pop(t)
        item: Item[V]
        if story.held is None:
            _log.warning("%s: message %d missed", self.name, t)
            self.counts[self.name, "message", "missed"] += 1
            item = Item(t, story.opened, now, Ending.MISSED, failures=story.failures)
        else:
            lane, arrived, value = story.held
            source = lane.source
            self.counts[source.name, "output", trigger.value] += 1
            item = Item(
                t,
                story.opened,
                now,
                Ending.FORWARDED,
                value,
                source,
                arrived,
                trigger,
                failures=story.failures,
            )
        self.orders.append(item)

    def _close(self, now: int, t: int, lane: Lane[Any]) -> None:
        """The request's result is no longer wanted. F7: local is never aborted."""
        if lane is self.local:
            return
        given_up = lane.close(t)
        if given_up is not None:
            self._give_up(now, lane, given_up)

    def _lapse(self, now: int) -> None:
        """End the calls that have lingered long enough."""
        for lane in self.clouds:
            for flight in lane.lapsed(now):
                self._give_up(now, lane, flight)

    def _give_up(self, now: int, lane: Lane[Any], flight: Flight[Any]) -> None:
        if flight.task is not None:
            self.orders.append((Order.ABORT, lane, flight))
        self._tell(lane, End.CENSORED, now - flight.asked)

    def _ended(self, now: int, t: int, lane: Lane[Any], end: End) -> None:
        """A request has ended by itself, perhaps before it was sent."""
        flight = lane.end(t)
        if flight is not None and lane.policy is not None:
            self._tell(lane, end, now - flight.asked)

    def _tell(self, lane: Lane[Any], end: End, age: int) -> None:
        if lane.policy is None:
            return
        try:
            lane.policy.ended(end, ns(age))
        except Exception:
            _log.exception("%s: the policy of %s failed", self.name, lane.source)


def words(error: BaseException) -> str:
    """An exception in a few words."""
    said = " ".join(str(error).split())
    return (said or type(error).__name__)[:WORDS]


#: What is asked of an operator's clock: whole nanoseconds that never go back.
Clock = Callable[[], int]
