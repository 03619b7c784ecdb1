"""What goes into calls and what leaves an operator."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Generic, Literal, NamedTuple, TypeAlias, TypeVar

from fuseline._words import OpenRefusal, ns

V = TypeVar("V")


class Ending(Enum):
    """How a message was answered; preliminary and final under progressive alone."""

    #: The best result so far was sent; a better one may follow (F9).
    PRELIMINARY = "preliminary"
    #: The best available result was sent (F7, P3).
    FORWARDED = "forwarded"
    #: No better result came than the one that was sent before, which is the last (F9).
    FINAL = "final"
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

    Under progressive it leads to one or more, each better than the one before, of which exactly one
    is the ``last``. They come in the order of decisions: keep the item of the greatest
    ``(timestamp, source.priority)``, or else an old message's replaces a newer one's.

    Instants are nanoseconds of the operator's clock, which starts with it.
    """

    #: The message's timestamp: its place among the messages, from 0.
    timestamp: int
    #: When the message was taken in.
    opened: int
    #: When it was decided.
    decided: int
    #: How it left.
    ending: Ending
    #: The result, if one is sent with it.
    value: V | None = None
    #: Whose result it is; of a final one, whose was sent before.
    source: Source | None = None
    #: When the result arrived; earlier than the decision if it was held.
    arrived: int | None = None
    #: What made the result go, if it was forwarded.
    trigger: Trigger | None = None
    #: Why the message was refused, if it was.
    refusal: OpenRefusal | None = None
    #: The sources whose failure was accepted by then (F4).
    failures: list[Failure] = field(default_factory=list)
    #: How many items of its message were made before it: 0, unless the rule is progressive.
    revision: int = 0

    @property
    def last(self) -> bool:
        """Whether no other item of its message follows."""
        return self.ending is not Ending.PRELIMINARY

    def _takes_the_place_of(self, earlier: Item[V]) -> None:
        """Nobody was given the earlier item of its message: a final one has its value."""
        if self.ending is Ending.FINAL:
            self.ending = Ending.FORWARDED
            self.value, self.arrived, self.trigger = earlier.value, earlier.arrived, earlier.trigger

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
