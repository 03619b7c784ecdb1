"""Defines the machine's arguments and its answers.

Each answer is a small immutable object, made to be matched:

>>> match Admitted(due=500):
...     case Admitted(due):
...         print("send it; its result is late from", due)
...     case Refused(why):
...         print("do not send:", why)
send it; its result is late from 500
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from operator import index
from typing import Generic, SupportsIndex, TypeVar

from fuseline._errors import TimeError


class _Word(str, Enum):
    """Is a word of a trace."""

    def __str__(self) -> str:
        return str(self.value)

    def __repr__(self) -> str:
        return f"{type(self).__name__}.{self.name}"


class Commit(_Word):
    """Says when a result is forwarded although a better one is pending (F6, F9)."""

    #: Forwards the best available result as soon as any cloud's timer fires.
    EAGER = "eager"
    #: Forwards the best available result once no better result can come.
    PATIENT = "patient"
    #: Forwards each result that is better than the ones before it at once. Better ones may follow.
    PROGRESSIVE = "progressive"


class OpenRefusal(_Word):
    """Says why an open was refused. The first reason that holds counts, in this order (F1)."""

    #: This timestamp or a later one was opened before.
    ORDER = "order"
    #: As many timestamps are open as the window allows.
    FULL = "full"
    #: Local's due instant is not after now.
    DEADLINE = "deadline"


class OfferRefusal(_Word):
    """Says why an offer was refused. The first reason that holds counts, in this order (F2)."""

    #: No such cloud is registered, or neither this timestamp nor a later one was ever opened.
    UNKNOWN = "unknown"
    #: The timestamp is not open.
    CLOSED = "closed"
    #: The cloud was already requested for this timestamp.
    DUPLICATE = "duplicate"
    #: A result that is held or, under progressive, was sent last outranks this cloud.
    OUTRANKED = "outranked"
    #: The due instant is not after now.
    DEADLINE = "deadline"
    #: The cloud's gate is shut: too many requests are queued.
    QUEUE = "queue"


class DropReason(_Word):
    """Says why a result or failure was dropped. The first reason that holds counts (F3, F4)."""

    #: No such source is registered, or neither this timestamp nor a later one was ever opened.
    UNKNOWN = "unknown"
    #: The timestamp is not open: it was retired or skipped. Under progressive this also means that
    #: the last output outranks the source.
    SUPERSEDED = "superseded"
    #: The source was not requested for this timestamp.
    UNSOLICITED = "unsolicited"
    #: The source's result is already held or, under progressive, was sent last.
    DUPLICATE = "duplicate"
    #: The request was closed by its timer or by a failure.
    LATE = "late"


@dataclass(frozen=True)
class Cloud:
    """Configures one cloud of a machine."""

    #: The priority, 1 to 65535, different for each cloud. The greater one wins.
    p: int
    #: The number of queued requests at which the gate shuts; at least 1 (F2g).
    limit: int = 31
    #: The number of queued requests at or below which the gate opens again; less than the limit, by
    #: default one less.
    resume: int | None = None
    #: The cloud's name, for people.
    name: str | None = None


W = TypeVar("W", OpenRefusal, OfferRefusal)


class ns(int):  # noqa: N801 - it stands where a unit stands
    """Holds a duration in whole nanoseconds, exact from 0 to 2**64 - 1.

    Arguments that are durations refuse a plain int, because it could be meant as seconds.
    Arithmetic on this type, such as halving it, returns a plain int.

    Raises:
        TypeError: if the number is not whole, such as ``ns(0.5)``.
        TimeError: if the number is out of that range, such as ``ns(-1)``.

    >>> from fuseline import nanoseconds
    >>> nanoseconds(0.5)
    ns(500000000)
    >>> nanoseconds(ns(7)) + 1
    8
    """

    __slots__ = ()

    def __new__(cls, nanoseconds: SupportsIndex, /) -> ns:
        """Makes a duration of whole nanoseconds."""
        if isinstance(nanoseconds, bool) or not hasattr(nanoseconds, "__index__"):
            raise TypeError(
                f"ns({nanoseconds!r}): nanoseconds are a whole number as an int; for seconds write "
                "fuseline.nanoseconds(0.5), or pass seconds as a float"
            )
        number = index(nanoseconds)
        if not 0 <= number < 2**64:
            raise TimeError(f"ns({number}): nanoseconds are from 0 to 2**64 - 1")
        return super().__new__(cls, number)

    def __repr__(self) -> str:
        return f"ns({int(self)})"

    __str__ = int.__repr__


@dataclass(frozen=True)
class Accepted:
    """Says that the timestamp is open and waits for local (F1)."""


@dataclass(frozen=True)
class Admitted:
    """Asks to send the request (F2)."""

    #: The due instant in nanoseconds; a result at this instant is late.
    due: int


@dataclass(frozen=True)
class Refused(Generic[W]):
    """Says that an open or an offer changed nothing. A refused offer may still change the gate."""

    #: The first reason that holds.
    why: W


@dataclass(frozen=True)
class Dropped:
    """Says that the result or failure changed nothing (F3, F4)."""

    #: The first reason that holds.
    why: DropReason


@dataclass(frozen=True)
class Held:
    """Asks to keep the result: it is available, but something pending outranks it (F3)."""


@dataclass(frozen=True)
class Waiting:
    """Says that the failure or the timers were accepted, and the timestamp stays open (F6)."""


@dataclass(frozen=True)
class Preliminary:
    """Asks to send a result downstream; better ones may follow (F9). Only under progressive."""

    #: The source of the result; 0 is local.
    by: int
    #: The pending clouds that the result outranks, in ascending order. Their calls may be aborted.
    cancelled: tuple[int, ...]


@dataclass(frozen=True)
class Final:
    """Says that the result sent last is the final one, and the timestamp is retired (F9)."""

    #: The source of the result; 0 is local.
    by: int


@dataclass(frozen=True)
class Forwarded:
    """Asks to send a result downstream; the timestamp is retired (F7)."""

    #: The source of the result; 0 is local.
    by: int
    #: The clouds still pending, in ascending order. Their calls may be aborted.
    cancelled: tuple[int, ...]


@dataclass(frozen=True)
class Missed:
    """Says that nothing came and nothing will; the timestamp is retired (F6)."""


#: The answer to an open.
Opening = Accepted | Refused[OpenRefusal]
#: The answer to an offer.
Admission = Admitted | Refused[OfferRefusal]
#: The answer to a result or a failure, and what became of timers that fired.
Outcome = Dropped | Held | Waiting | Preliminary | Forwarded | Final | Missed


@dataclass(frozen=True)
class Firing:
    """Says that timers of one timestamp fired at one due instant (F5)."""

    #: The timestamp.
    t: int
    #: The instant at which they were due, in nanoseconds.
    due: int
    #: The requests that they close, in ascending order; 0 is local's.
    timers: tuple[int, ...]
    #: Waiting, forwarded, final or missed.
    outcome: Waiting | Forwarded | Final | Missed
