"""Defines the arguments of calls, and the items that an operator sends."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeAlias, TypeVar

from fuseline._errors import TimeError, as_text
from fuseline._fuseline import nanoseconds
from fuseline._validation import OpenRefusal, ns

if TYPE_CHECKING:
    from fuseline._judge import Duration

V = TypeVar("V")

#: The number of nanoseconds by which a capture may be ahead of the operator's clock.
CAPTURE_SLACK = 1_000_000_000

#: A lineage as the extension takes it.
_Fields: TypeAlias = "tuple[str | None, int | None, int | None, Any, list[str]]"


class Ending(Enum):
    """Says how a message was answered. Preliminary and final occur only under progressive."""

    #: The best result so far was sent; a better one may follow (F9).
    PRELIMINARY = "preliminary"
    #: The best available result was sent (F7, P3).
    FORWARDED = "forwarded"
    #: No better result came, so the result that was sent before is the last (F9).
    FINAL = "final"
    #: No result came and none will (F6).
    MISSED = "missed"
    #: The message was not accepted, and nothing was computed for it (F1).
    REFUSED = "refused"


class Trigger(Enum):
    """Says what caused a result to be sent."""

    #: It arrived and was sent at once (F3, F9).
    ARRIVAL = "arrival"
    #: It was held, and the source that it waited for failed (F4).
    FAILURE = "failure"
    #: It was held, and a timer fired (F5).
    TIMER = "timer"


@dataclass(frozen=True)
class Source:
    """Names local or a cloud."""

    #: 0 is local; clouds have 1 to 65535, the greater wins.
    priority: int
    #: ``local``, or the cloud's name.
    name: str

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True)
class Failure:
    """Names a source that sent no result for a message, and says why."""

    #: The source.
    source: Source
    #: The reason in words, at most 200 bytes.
    why: str


@dataclass(frozen=True, slots=True)
class Lineage:
    """Names the origin of a message. Operators pass it on from the sensor to the last output.

    >>> import time
    >>> Lineage("camera/front", 41, captured=time.monotonic_ns(), within=0.5).seq
    41
    """

    #: The sensor's stream.
    origin: str | None = None
    #: The message's timestamp in that stream; None without an origin.
    seq: int | None = None
    #: The instant of the capture in nanoseconds of the operators' clock: ``time.monotonic_ns()``,
    #: unless they were given another clock.
    captured: int | None = None
    #: The time after the capture at which the last operator's output is due. Each operator's
    #: deadlines end with it (E3), and traces have it, so that it can be judged (J2). If the capture
    #: is unknown, each operator counts from the message's acceptance.
    within: Duration | None = None
    #: The inputs of joins on the way from which nothing came.
    missing: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if isinstance(self.missing, (str, bytes)):
            raise TypeError(f"missing is {self.missing!r}; give a tuple of names")
        for name in (self.origin, *self.missing):
            if name is not None and (not isinstance(name, str) or name != as_text(name)):
                raise TypeError(f"an origin of {name!r}; give the stream's name as text")
        if self.seq is not None:
            _check_number(self.seq, "a seq", "give the message's number in its stream, an int")
            if self.origin is None:
                raise ValueError(
                    "a seq is given without an origin; name the stream that it counts in"
                )
        if self.captured is not None:
            _check_number(self.captured, "captured at", "give nanoseconds, as monotonic_ns()")
        if self.within is not None:
            object.__setattr__(self, "within", nanoseconds(self.within))

    @classmethod
    def _of(cls, fields: _Fields) -> Lineage:
        """Makes a lineage from the fields that `fields_of` returned."""
        origin, seq, captured, within, missing = fields
        return cls(origin, seq, captured, None if within is None else ns(within), tuple(missing))


def _check_number(number: Any, what: str, remedy: str) -> None:
    if isinstance(number, bool) or not hasattr(number, "__index__"):
        raise TypeError(f"{what} {number!r}; {remedy}")
    if not 0 <= number < 2**64:
        raise TimeError(f"{what} {number!r}, which is not from 0 to 2**64 - 1; {remedy}")


def check_capture(captured: int, now: int) -> None:
    """Refuses a capture that lies in the future of the operators' clock.

    Raises:
        TimeError: if it lies more than a second in the future. It was then read from another clock,
            and every age would be 0.
    """
    if captured > now + CAPTURE_SLACK:
        raise TimeError(
            f"captured lies {(captured - now) / 1e9:.3f} s in the future, so it was read from "
            "another clock than the operator's: give time.monotonic_ns(), or give the operator "
            "the clock of the stamps"
        )


def fields_of(lineage: Lineage | None) -> _Fields | None:
    """Returns a lineage as the extension takes it."""
    if lineage is None:
        return None
    own = lineage.origin, lineage.seq, lineage.captured, lineage.within
    return *own, list(lineage.missing)


@dataclass(frozen=True, slots=True)
class StampedValue(Generic[V]):
    """Holds a value, the message it was computed from (D2), and the message it is for (D18).

    A response handler may return it. A value counts as a failure if it was computed from a message
    that the cloud's ``max_age`` does not allow. So does a value that is meant for another message.
    """

    #: The value.
    value: V
    #: The timestamp of the message that the value was computed from, as the reply says; if there
    #: are several, the oldest. Never copy it from the call.
    of: int | None
    #: The timestamp of the message that the value is meant for, as the reply says; for a chunk of
    #: actions, the action's tick.
    meant_for: int | None = None

    def __post_init__(self) -> None:
        for word, t in (("of", self.of), ("for", self.meant_for)):
            if t is not None and (isinstance(t, bool) or not hasattr(t, "__index__")):
                remedy = "give the timestamp in the reply, an int, or None"
                raise TypeError(f"a value {word} {t!r}; {remedy}")


@dataclass(frozen=True, slots=True, init=False)
class Call:
    """Describes one call to the handle that makes it."""

    #: The message's timestamp.
    timestamp: int
    #: The seconds that are left: the deadline, less the time in the queue, plus the time to linger.
    deadline: float
    #: The lineage of the message, if it was written with one.
    lineage: Lineage | None = None
    #: The seconds from the capture to the start of the call, if they are known.
    age: float | None = None

    def __init__(
        self,
        timestamp: int,
        deadline: float,
        lineage: Lineage | None = None,
        age: float | None = None,
    ) -> None:
        # This is twice as fast as the method that `dataclass` generates for a frozen class, and
        # each call needs one.
        _set_timestamp(self, timestamp)
        _set_deadline(self, deadline)
        _set_lineage(self, lineage)
        _set_age(self, age)


_set_timestamp, _set_deadline, _set_lineage, _set_age = (
    Call.__dict__[name].__set__ for name in ("timestamp", "deadline", "lineage", "age")
)


class CurrentDeadline(NamedTuple):
    """Holds a cloud's deadline and the reason for it."""

    #: The deadline, counted from the request.
    deadline: ns
    #: ``offered`` without a policy, and otherwise the policy's reason. For a guard it is the case:
    #: ``local-stops``, ``cloud-alone`` or ``unsure``.
    why: str


@dataclass(slots=True)
class Item(Generic[V]):
    """Reports what became of one message. Every message written leads to exactly one item.

    Under progressive a message leads to one or more items. Each is better than the one before, and
    exactly one is the ``last``. Items come in the order of decisions, so an item of an old message
    may follow one of a newer message. Keep the item of the greatest ``(timestamp,
    source.priority)``.

    Instants are nanoseconds of the operator's clock, which starts with the operator.

    >>> item = Item(7, 0, 30_000_000, Ending.FORWARDED, "a plan", Source(1, "west"))
    >>> item.value, str(item.source), item.latency
    ('a plan', 'west', 0.03)
    """

    #: The message's timestamp: its place among the messages, from 0.
    timestamp: int
    #: The instant when the message was accepted.
    opened: int
    #: The instant of the decision.
    decided: int
    #: The way in which the message was answered.
    ending: Ending
    #: The result that is sent, or otherwise the `substitute`.
    value: V | None = None
    #: The source of the result; for a final item, the source of the result that was sent before.
    source: Source | None = None
    #: The instant when the result arrived; earlier than the decision if it was held.
    arrived: int | None = None
    #: The event that caused the result to be sent, if it was forwarded.
    trigger: Trigger | None = None
    #: The reason why the message was refused, if it was.
    refusal: OpenRefusal | None = None
    #: The sources whose failure was accepted by then (F4).
    failures: list[Failure] = field(default_factory=list)
    #: The number of earlier items of its message: 0, unless the rule is progressive.
    revision: int = 0
    #: The lineage with which the message was written.
    lineage: Lineage | None = None
    #: The seconds from the capture to the decision, if they are known. If the value is ``of`` an
    #: earlier message, that message's capture counts.
    age: float | None = None
    #: The timestamp of the message that the value was computed from, if its source named it: this
    #: message, or an earlier one that the cloud's ``max_age`` allows (D2).
    of: int | None = None
    #: The value that the operator's handler returned for a message that was missed or refused (E4).
    #: It does not change the ending, and its age is unknown (E7).
    substitute: V | None = None
    #: The message itself, if the operator was made with ``carry_messages``.
    message: Any = None

    @property
    def last(self) -> bool:
        """Returns True if no other item of its message follows."""
        return self.ending is not Ending.PRELIMINARY

    def _takes_the_place_of(self, earlier: Item[V]) -> None:
        """Takes over the value of an earlier item of its message that nobody has read."""
        if self.ending is Ending.FINAL:
            self.ending = Ending.FORWARDED
            self.value, self.arrived, self.trigger = earlier.value, earlier.arrived, earlier.trigger
            self.of = earlier.of
            if earlier.age is not None:
                self.age = earlier.age + (self.decided - earlier.decided) / 1e9

    @property
    def latency(self) -> float:
        """Returns the seconds from the message's acceptance to the decision."""
        return (self.decided - self.opened) / 1e9
