"""What waits for one source, and what is under way there."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from fuseline._item import Call, Source
from fuseline.deadline import Policy

Q = TypeVar("Q")


@dataclass(slots=True)
class Flight(Generic[Q]):
    """A request: it waits, is under way, or lingers."""

    t: int
    #: When it was admitted.
    asked: int
    #: When it is due; none for local.
    due: int | None
    request: Q
    #: What runs it, once it is under way.
    task: Any = None
    #: Whether its result is no longer wanted, and its task was told so.
    is_aborted: bool = False


@dataclass(slots=True)
class Handlers:
    """What a cloud's requests are made of and go to."""

    handle: Callable[[Any, Call], Awaitable[Any]]
    message_handler: Callable[[Any, int], tuple[Any, Any] | None]
    response_handler: Callable[[Any], Any]


class Lane(Generic[Q]):
    """The queue to one source, and the calls or computations under way there."""

    __slots__ = (
        "_ends",
        "at_once",
        "flying",
        "handlers",
        "linger",
        "lingering",
        "p",
        "policy",
        "source",
        "waiting",
    )

    def __init__(self, source: Source, at_once: int) -> None:
        self.source = source
        self.p = source.priority
        self.at_once = at_once
        self.waiting: dict[int, Flight[Q]] = {}
        self.flying: dict[int, Flight[Q]] = {}
        self.lingering: dict[int, Flight[Q]] = {}
        self.linger = 0
        self.policy: Policy | None = None
        self.handlers: Handlers | None = None
        #: How many aborted calls have not ended yet.
        self._ends = 0

    @property
    def backlog(self) -> int:
        """D4, F2: the length of the queue, calls under way not counted."""
        return len(self.waiting)

    def next(self) -> Flight[Q] | None:
        """The next request of those that wait, if there is room to send it."""
        under_way = len(self.flying)
        # D8: a call that takes long to end, though it was aborted, keeps a place.
        if under_way >= self.at_once or under_way + self._ends >= 2 * self.at_once:
            return None
        t = next(iter(self.waiting))
        flight = self.flying[t] = self.waiting.pop(t)
        return flight

    def end(self, t: int) -> Flight[Q] | None:
        """The request has ended by itself, perhaps before it was sent."""
        return self.flying.pop(t, None) or self.lingering.pop(t, None) or self.waiting.pop(t, None)

    def close(self, t: int) -> Flight[Q] | None:
        """The result is no longer wanted; returns what is given up, if anything is.

        A call that may linger goes on. At most as many linger as may be under way; one more ends
        the oldest, or a dead cloud would gather more and more of them.
        """
        flight = self.flying.pop(t, None)
        if flight is None:
            return self.waiting.pop(t, None)
        if not self.linger:
            return flight
        oldest = None
        if len(self.lingering) >= self.at_once:
            oldest = self.lingering.pop(next(iter(self.lingering)))
        self.lingering[t] = flight
        return oldest

    def lapsed(self, now: int) -> list[Flight[Q]]:
        """The calls that have lingered long enough."""
        over = [it for it in self.lingering.values() if self._until(it) <= now]
        for flight in over:
            del self.lingering[flight.t]
        return over

    def next_lapse(self) -> int | None:
        """When the next call has lingered long enough."""
        return min(map(self._until, self.lingering.values()), default=None)

    def ages(self, now: int) -> list[int]:
        """The age of each unanswered request, the oldest first, with those that linger."""
        lots = (self.flying, self.lingering, self.waiting)
        return sorted((now - it.asked for lot in lots for it in lot.values()), reverse=True)

    def aborted(self) -> None:
        """A call was told to end."""
        self._ends += 1

    def ended(self) -> None:
        """A call that was told to end has ended."""
        self._ends -= 1

    def _until(self, flight: Flight[Q]) -> int:
        return (flight.due or 0) + self.linger
