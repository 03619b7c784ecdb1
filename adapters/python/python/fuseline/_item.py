"""What goes into calls and what leaves an operator."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Generic, Literal, NamedTuple, TypeAlias, TypeVar

from fuseline._words import OpenRefusal, ns

V = TypeVar("V")


class Ending(Enum):
    """How a message left."""

    #: The best available result was sent (F7, P3).
    FORWARDED = "forwarded"
    #: No result came and none will (F6).
    MISSED = "missed"
    #: The message was not taken on, and nothing was computed for it (F1).
    REFUSED = "refused"


class Trigger(Enum):
    """What made a result go."""

    #: F3: it arrived, and nothing better was still to come.
    ARRIVAL = "arrival"
    #: F4: it was held, and what it waited for failed.
    FAILURE = "failure"
    #: F5: it was held, and a timer fired.
    TIMER = "timer"


@dataclass(frozen=True)
class Source:
    """Local or a cloud."""

    #: 0 is local; clouds have 1 to 65535, the greater wins.
    priority: int
    #: ``local``, or the cloud's name.
    name: str

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True)
class Failure:
    """A source that sent no result for a message, and why."""

    #: The source.
    source: Source
    #: The reason in words, at most 200 bytes.
    why: str


@dataclass(frozen=True, slots=True)
class Call:
    """One call to a cloud, as its handle sees it."""

    #: The message's timestamp.
    timestamp: int
    #: The seconds that are left: without what was spent in the queue, with the time to linger.
    deadline: float


class CurrentDeadline(NamedTuple):
    """A cloud's deadline, and what chose it."""

    #: The deadline.
    deadline: ns
    #: ``offered`` without a policy, else the policy's reason in a word; of a guard its case:
    #: ``local-stops``, ``cloud-alone`` or ``unsure``.
    why: str


@dataclass(slots=True)
class Item(Generic[V]):
    """What became of one message. Every message written leads to exactly one item.

    Instants are nanoseconds of the operator's clock, which starts with it.
    """

    #: The message's timestamp: its place among the messages, from 0.
    timestamp: int
    #: When the message was taken in.
    opened: int
    #: When its ending was decided.
    decided: int
    #: How it left.
    ending: Ending
    #: The result, if it was forwarded.
    value: V | None = None
    #: Whose result it is, if it was forwarded.
    source: Source | None = None
    #: When the result arrived; earlier than the decision if it was held.
    arrived: int | None = None
    #: What made the result go, if it was forwarded.
    trigger: Trigger | None = None
    #: Why the message was refused, if it was.
    refusal: OpenRefusal | None = None
    #: The sources whose failure was accepted by then (F4).
    failures: list[Failure] = field(default_factory=list)

    @property
    def took(self) -> float:
        """The seconds from taking the message in to the decision."""
        return (self.decided - self.opened) / 1e9


#: What the engine wants done: an item sent; a call or computation begun, by its priority and
#: timestamp, with the instant until which it may take and its request; a call ended.
Effect: TypeAlias = (
    tuple[Literal["output"], Item[Any]]
    | tuple[Literal["start"], int, int, int | None, Any]
    | tuple[Literal["abort"], int, int]
)
