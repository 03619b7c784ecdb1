"""Chooses deadlines: which one is safe, and which one is worth it.

A policy chooses the deadline of each request to one cloud, at most the message handler's, and
learns how each call ended. Keep one policy for each cloud, and pass it to `Operator.use_cloud`:

>>> guard = Guard(Parameters(deceleration=(7.0, 8.0)))
>>> expected = Expected(Impact(guard.parameters), local_response=0.3017, probe_every=16)
>>> policy = guard.cap(expected)  # as long as is worth it, and no longer than is safe
>>> policy.decide(Situation(speed=(17.5, 18.0)), cap=2.0).reason  # the first measures the cloud
Reason.PROBE

`SPEC.md`, section 9, has the conditions, and the book's chapter *Deadlines that are safe*
(`docs/book/src/verified/deadlines.md`) the proofs. Arguments that are durations are a timedelta,
seconds as a float, or nanoseconds as `fuseline.ns`; a plain int is refused. Results that are
durations are `ns`. Other figures are numbers in m, m/s and m/s². An implausible figure, such as
milliseconds given as seconds, is refused, and the error states its range.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Literal, NamedTuple, Protocol, TypeAlias

from fuseline import _fuseline
from fuseline._judge import Duration
from fuseline._validation import ns

#: A number, or its least and its greatest value if it is not known exactly.
Figure: TypeAlias = float | tuple[float, float]
#: A duration, or the shortest and the longest one if it is not known exactly.
Time: TypeAlias = Duration | tuple[Duration, Duration]

__all__ = [
    "Accuracy",
    "Assessment",
    "BoxDetector",
    "Case",
    "Chosen",
    "Constant",
    "End",
    "Expected",
    "Figure",
    "Guard",
    "Hazard",
    "Impact",
    "Loss",
    "Observation",
    "Observations",
    "Parameters",
    "Policy",
    "Reason",
    "Situation",
    "Step",
    "Streaming",
    "Time",
    "Whose",
]


class _Word(Enum):
    def __repr__(self) -> str:
        return f"{type(self).__name__}.{self.name}"


class End(_Word):
    """Says how a call ended."""

    #: Its result came, in time or late.
    ANSWERED = "answered"
    #: It failed: no result will come.
    FAILED = "failed"
    #: It was given up before its result came.
    CENSORED = "censored"


class Reason(_Word):
    """Names the reason for a deadline."""

    #: The deadline is constant.
    CONSTANT = "constant"
    #: The guard allows no longer deadline.
    GUARD = "guard"
    #: This deadline has the least mean loss, by what was observed.
    EXPECTED = "expected"
    #: This message waits as long as allowed, to observe how late results are.
    PROBE = "probe"
    #: The cap is shorter than the deadline that the policy would choose.
    CAP = "cap"


class Case(_Word):
    """Names the case of the guard that holds."""

    #: Local alone certainly stops, with time to spare.
    LOCAL_STOPS = 1
    #: Local alone certainly does not stop, and the cloud still might.
    CLOUD_ALONE = 2
    #: Neither is certain, so no output may be later than local alone.
    UNSURE = 3


@dataclass(frozen=True, slots=True)
class Situation:
    """Describes the vehicle's situation at the time of a decision."""

    #: The vehicle's speed from this message's capture until it could brake for it, in m/s. If it is
    #: not a speed from 0 to 150 m/s, the situation counts as unknown, and a guard takes no risk.
    speed: Figure = math.nan
    #: The distance to the nearest place where something may come into sight, in metres; None if it
    #: is unknown.
    reveal: float | None = None
    #: The age of each call under way, the oldest first.
    under_way: Sequence[Duration] = ()


@dataclass(frozen=True, slots=True)
class Chosen:
    """Holds a deadline and the reason for it."""

    #: The deadline of the next request.
    deadline: ns
    #: The reason for the deadline.
    reason: Reason
    #: The guard's case, if the reason is the guard.
    case: Case | None = None
    #: The mean loss of a message, if the reason is the loss.
    loss: float | None = None


class Policy(Protocol):
    """Chooses the deadlines of one cloud's requests. Write your own, or use one of this module."""

    def decide(self, situation: Situation, cap: Duration) -> Chosen:
        """Returns the deadline of the request that is about to be made, at most ``cap``."""

    def ended(self, end: End, age: Duration) -> None:
        """Notes that a call ended, with its age: the time since its message was accepted."""


@dataclass(frozen=True)
class Hazard:
    """Describes a class of hazards, such as standing motorcycles."""

    #: The distance from which local begins to report the hazard, in metres.
    range_local: Figure = 39.0
    #: The distance from which the cloud begins to report the hazard, in metres; no less than
    #: local's.
    range_cloud: Figure = 57.0
    #: The weight of this class among all classes. Only losses use it.
    weight: float = 1.0


@dataclass(frozen=True)
class Parameters:
    """Describes the vehicle, its sources and the hazards; the paper's traffic jam by default."""

    #: The deceleration of full braking, in m/s².
    deceleration: Figure = 7.5
    #: The time from the decision to brake until the brakes act.
    brake_delay: Time = 0.1
    #: The number of frames in a row that must report an obstacle before the vehicle brakes.
    frames: int = 3
    #: The time between two frames that local processes.
    period_local: Time = 1.0 / 30.0
    #: The time between two frames that the cloud processes.
    period_cloud: Time = 1.0 / 30.0
    #: The time from a frame's capture until local's result.
    local_response: Time = 0.3017
    #: The greatest delay of an output after capture + deadline.
    lateness: Duration = 0.005
    #: The distance to keep from an obstacle where local alone stops anyway, in metres.
    margin: float = 2.0
    #: The classes of hazards on the road, one to eight.
    hazards: tuple[Hazard, ...] = (Hazard(),)


#: The source of an output: the computation on board, or the cloud whose deadline is chosen.
Whose: TypeAlias = Literal["local", "cloud"]
#: The loss of an output, in any unit. Less is better. A deadline whose loss is NaN is not chosen
#: for that loss.
Loss: TypeAlias = Callable[[Situation, Whose, ns], float]


class _Priced:
    def __call__(self, situation: Situation, source: Whose, response: Duration) -> float:
        """Returns the loss of an output of a source, ``response`` after its message's capture."""
        return _fuseline.loss(self, situation, source, response)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Impact(_Priced):
    """Prices an output by the squared speed at impact with an obstacle at rest, in m²/s².

    >>> Impact(Parameters())(Situation(speed=22.0), "local", 0.3017)
    64.56...
    """

    vehicle: Parameters


@dataclass(frozen=True)
class Accuracy(_Priced):
    """Prices an output by its loss of accuracy to the better source and by each ms of waiting.

    >>> Accuracy(local=0.3, cloud=0.5, price_per_ms=0.001)(Situation(), "cloud", 0.02)
    0.02
    """

    #: Local's accuracy, such as its AP.
    local: float
    #: The cloud's accuracy.
    cloud: float
    #: The price of a millisecond, in the unit of accuracy.
    price_per_ms: float


@dataclass(frozen=True)
class BoxDetector:
    """Describes how well a detector of boxes does on single frames."""

    #: The detector's accuracy if a box must overlap by half, such as its AP50.
    accuracy: float
    #: The mean overlap of its right boxes (IoU), 0.5 to 1.
    overlap: float


@dataclass(frozen=True)
class _StreamLoss(_Priced):
    local: BoxDetector
    cloud: BoxDetector
    period: Duration


@dataclass(frozen=True)
class Assessment:
    """Holds the guard's assessment of a situation."""

    #: The time after capture until which local's results certainly suffice to stop, in seconds.
    budget_local: float
    #: The time after capture until which the cloud's results may suffice to stop, in seconds.
    budget_cloud: float
    #: The case of the guard that holds.
    case: Case
    #: The longest deadline that is safe.
    deadline: ns


@dataclass(frozen=True, slots=True)
class Observation:
    """Counts the calls that were observed until the same age."""

    #: The age at which they were answered, or until which they were observed.
    response: ns
    #: True if the results came at that age. Otherwise they had not come by then.
    is_answered: bool
    #: The number of calls.
    count: int


class Step(NamedTuple):
    """Holds one step of the estimate: a response that was observed."""

    #: The response: the age at which results came.
    response: ns
    #: The share of calls answered exactly then.
    mass: float
    #: The share of calls not answered by then.
    survival: float


class _Capping:
    def cap(self, policy: Policy) -> Policy:
        """Returns a policy that chooses the other policy's deadline under this policy's cap."""
        return Capped(self, policy)  # type: ignore[arg-type]


class Constant(_Capping):
    """Chooses the same deadline for every message. It knows nothing of safety.

    >>> Constant(0.5).decide(Situation(), cap=0.2)
    Chosen(deadline=ns(200000000), reason=Reason.CAP, case=None, loss=None)
    """

    def __init__(self, deadline: Duration) -> None:
        self._deadline = _fuseline.nanoseconds(deadline)

    def __repr__(self) -> str:
        return f"Constant({self.deadline!r})"

    @property
    def deadline(self) -> ns:
        """Returns the deadline, which never changes."""
        return self._deadline

    def decide(self, situation: Situation, cap: Duration) -> Chosen:  # noqa: ARG002
        """Returns the deadline, or the cap if that is shorter."""
        cap = _fuseline.nanoseconds(cap)
        if self.deadline <= cap:
            return Chosen(self.deadline, Reason.CONSTANT)
        return Chosen(cap, Reason.CAP)

    def ended(self, end: End, age: Duration) -> None:
        """Learns nothing."""


class Guard(_Capping):
    """Chooses the longest deadline with which fusion never hits what local alone would not (T2).

    Any shorter deadline keeps that guarantee, so it also holds for every policy that the guard
    caps.

    Raises:
        DeadlineError: for the first figure that is not plausible (T7).

    >>> Guard().judge(Situation(speed=11.0)).deadline / 1e9
    2.4253...
    """

    def __init__(self, parameters: Parameters | None = None) -> None:
        #: The parameters that it was made of.
        self.parameters = parameters or Parameters()
        self._guard = _fuseline.Guard(self.parameters)

    def __reduce__(self) -> tuple[type[Guard], tuple[Parameters]]:
        return Guard, (self.parameters,)

    def __repr__(self) -> str:
        return f"Guard({self.parameters!r})"

    def judge(self, situation: Situation) -> Assessment:
        """Returns the longest deadline that is safe now, and why."""
        local, cloud, case, deadline = self._guard.judge(situation)
        return Assessment(local, cloud, Case(case), ns(deadline))

    def decide(self, situation: Situation, cap: Duration) -> Chosen:
        """Returns the longest deadline that is safe, or the cap if that is shorter."""
        return _chosen(self._guard.decide(situation, cap))

    def ended(self, end: End, age: Duration) -> None:
        """Learns nothing."""


class Expected(_Capping):
    """Chooses the deadline of least mean loss, by how the last 64 calls ended (T3).

    This policy knows nothing of safety: let a `Guard` cap it. One message in ``probe_every`` waits
    as long as the cap allows, beginning with the first (T6). Give None if calls linger, because
    their true ends are then known. An operator refuses None without a ``linger``: the policy would
    never again wait for a cloud that was gone. A pickled copy keeps the observations, and forgets
    the quickest calls first.

    Args:
        loss: The loss of an output: `Impact`, `Accuracy`, or a function of the situation, the
            source ("local" or "cloud") and the response. ``decide`` raises the function's
            exceptions.
        local_response: The time that local takes.
        probe_every: 1 to 64, or None.

    Raises:
        DeadlineError: for a figure that makes no sense.
    """

    def __init__(
        self,
        loss: Loss,
        local_response: Time,
        probe_every: int | None = 16,
    ) -> None:
        self._expected = _fuseline.Expected(loss, local_response, probe_every)
        self._made_of = loss, local_response, probe_every

    def __reduce__(self) -> tuple[Any, ...]:
        return Expected, self._made_of, self.observations()

    def __setstate__(self, observations: list[Observation]) -> None:
        for end, age in _ends(observations):
            self.ended(end, age)

    @property
    def probe_every(self) -> int | None:
        """Returns the number of messages that contain one probe, or None."""
        return self._made_of[2]

    def decide(self, situation: Situation, cap: Duration) -> Chosen:
        """Returns the deadline of least mean loss, at most the cap."""
        return _chosen(self._expected.decide(situation, cap))

    def ended(self, end: End, age: Duration) -> None:
        """Remembers how a call ended, and forgets the one 64 calls ago."""
        self._expected.ended(end.value, age)

    def observations(self) -> list[Observation]:
        """Returns the observed calls, ordered by response, answered ones before given up ones."""
        return _observed(self._expected.observations())


class Streaming(Expected):
    """Chooses the deadline of least mean loss in a stream whose newest output is in force.

    An output loses accuracy as the world moves until the next output. The policy estimates that
    from the last 64 speeds of boxes that `moved` got. While no speed is known, nothing moves. Under
    progressive, waiting costs nothing, so give no speeds. `fuseline_deadline::StreamLoss` has the
    derivation.

    Args:
        local: The quality of the alternative: the computation on board, or, under patient, a cloud
            of a lower priority.
        cloud: The quality of the cloud.
        period: The time between two frames.
        local_response: The time that the alternative takes.
        probe_every: 1 to 64, or None.

    Raises:
        DeadlineError: for a figure that makes no sense.

    >>> detectors = BoxDetector(70.0, 0.7), BoxDetector(95.0, 0.85)
    >>> policy = Streaming(*detectors, period=0.14, local_response=0.015, probe_every=None)
    >>> policy.ended(End.ANSWERED, 0.3)
    >>> policy.decide(Situation(), cap=0.5).deadline  # nothing moves: it is worth the wait
    ns(300000001)
    >>> policy.moved([2.0, 1.5])
    >>> policy.decide(Situation(), cap=0.5).deadline
    ns(15000000)
    """

    def __init__(
        self,
        local: BoxDetector,
        cloud: BoxDetector,
        period: Duration,
        local_response: Time,
        probe_every: int | None = 16,
    ) -> None:
        super().__init__(_StreamLoss(local, cloud, period), local_response, probe_every)
        self._detectors = local, cloud, period
        self._speeds = deque[float](maxlen=64)

    def __reduce__(self) -> tuple[Any, ...]:
        _, local_response, probe_every = self._made_of
        made_of = (*self._detectors, local_response, probe_every)
        return Streaming, made_of, (self.observations(), list(self._speeds))

    def __setstate__(self, state: Any) -> None:
        observations, speeds = state
        super().__setstate__(observations)
        self.moved(speeds)

    def moved(self, speeds: Iterable[float]) -> None:
        """Notes how fast the boxes of an output moved, as a tracker measures it.

        A speed is in sizes of the box per second: ``|vx| / width + |vy| / height``. A number that
        is not a speed is ignored.
        """
        speeds = list(speeds)
        self._expected.moved(speeds)
        self._speeds.extend(speeds)


class Observations:
    """Remembers the ends of the last 64 calls of one cloud.

    >>> seen = Observations()
    >>> seen.add(End.ANSWERED, 0.02)
    >>> seen.add(End.CENSORED, 0.05)  # given up: it was seen until then and no longer (T5)
    >>> seen.survival()
    [Step(response=ns(20000000), mass=0.5, survival=0.5)]
    """

    def __init__(self) -> None:
        self._observations = _fuseline.Observations()

    def __reduce__(self) -> tuple[Any, ...]:
        return Observations, (), self.sorted()

    def __setstate__(self, observations: list[Observation]) -> None:
        for end, age in _ends(observations):
            self.add(end, age)

    def add(self, end: End, age: Duration) -> None:
        """Remembers how a call ended, and forgets the one 64 calls ago."""
        self._observations.add(end.value, age)

    def sorted(self) -> list[Observation]:
        """Returns the calls, ordered by response, with answered calls before those given up."""
        return _observed(self._observations.sorted())

    def survival(self, under_way: Sequence[Duration] = ()) -> list[Step]:
        """Returns the estimate of Kaplan and Meier, with a step for each distinct response.

        Args:
            under_way: The ages of the calls under way, the oldest first.
        """
        return [Step(ns(it), *more) for it, *more in self._observations.survival(under_way)]


class Capped(_Capping):
    """Chooses a policy's deadline under the cap of another policy. Made by ``cap``."""

    def __init__(self, cap: Policy, policy: Policy) -> None:
        self._cap, self._policy = cap, policy

    def decide(self, situation: Situation, cap: Duration) -> Chosen:
        """Returns the policy's deadline, at most the deadline that the cap chooses."""
        limit = self._cap.decide(situation, cap)
        chosen = self._policy.decide(situation, limit.deadline)
        return limit if chosen.reason is Reason.CAP else chosen

    def ended(self, end: End, age: Duration) -> None:
        """Passes the end of the call to both policies."""
        self._cap.ended(end, age)
        self._policy.ended(end, age)


class Called(_Capping):
    """Makes a policy of a plain function of situation and cap. It learns nothing."""

    def __init__(self, function: Callable[[Situation, ns], Duration]) -> None:
        self._function = function

    def decide(self, situation: Situation, cap: Duration) -> Chosen:
        """Returns the function's deadline, or the cap if that is shorter."""
        cap = _fuseline.nanoseconds(cap)
        return Constant(self._function(situation, cap)).decide(situation, cap)

    def ended(self, end: End, age: Duration) -> None:
        """Learns nothing."""


def policy_of(policy: Policy | Callable[[Situation, ns], Duration]) -> Policy:
    """Returns a policy as it is, or makes one of a plain function."""
    return Called(policy) if not hasattr(policy, "decide") else policy  # type: ignore[return-value]


def learners(policy: Policy) -> list[Policy]:
    """Returns the parts of a policy that learn how calls ended."""
    if isinstance(policy, Capped):
        return [*learners(policy._cap), *learners(policy._policy)]
    return [] if type(policy) in (Constant, Guard, Called) else [policy]


def compiled(policy: Policy) -> Any:
    """Returns the compiled part of this module's own policies, or any other policy as it is."""
    # A class that is derived from one of these may have methods of its own.
    if type(policy) is Constant:
        return policy.deadline
    if type(policy) is Guard:
        return policy._guard
    if type(policy) is Expected or type(policy) is Streaming:
        return policy._expected
    if type(policy) is Capped:
        return compiled(policy._cap), compiled(policy._policy)
    return policy


def _observed(rows: list[tuple[int, bool, int]]) -> list[Observation]:
    return [Observation(ns(age), is_answered, count) for age, is_answered, count in rows]


def _ends(observations: list[Observation]) -> Iterator[tuple[End, ns]]:
    for it in observations:
        yield from [(End.ANSWERED if it.is_answered else End.CENSORED, it.response)] * it.count


def _chosen(fields: tuple[int, str, int | None, float | None]) -> Chosen:
    deadline, reason, case, loss = fields
    return Chosen(ns(deadline), Reason(reason), None if case is None else Case(case), loss)
