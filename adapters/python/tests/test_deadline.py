"""Tests losses that are functions, and durations with a unit."""

from __future__ import annotations

import math
import pickle
from datetime import timedelta
from typing import Any

import pytest
from fuseline import DeadlineError, TimeError, ns
from fuseline.deadline import (
    Accuracy,
    BoxDetector,
    Capped,
    Case,
    Chosen,
    Constant,
    End,
    Expected,
    Guard,
    Hazard,
    Impact,
    Parameters,
    Policy,
    Reason,
    Situation,
    Streaming,
    Time,
    Whose,
    compiled,
    policy_of,
)


def seen(loss: object, ages: list[float]) -> Expected:
    policy = Expected(loss, local_response=0.01, probe_every=None)  # type: ignore[arg-type]
    for age in ages:
        policy.ended(End.ANSWERED, age)
    return policy


@pytest.mark.parametrize("speed", [math.nan, 0.0, 17.5])
@pytest.mark.parametrize("loss", [Accuracy(0.3, 0.5, 0.001), Impact(Parameters())])
def test_a_function_is_a_loss_as_those_here_are(loss: Accuracy | Impact, speed: float) -> None:
    def function(situation: Situation, source: Whose, response: ns) -> float:
        return loss(situation, source, response)

    ages = [0.02, 0.05, 0.05, 0.3]
    known = Situation(speed)
    own, called = (seen(it, ages).decide(known, 1.0) for it in (loss, function))
    assert repr(own) == repr(called)


def test_a_loss_of_ones_own_decides() -> None:
    calls: list[tuple[Situation, Whose, ns]] = []

    def patient(situation: Situation, source: Whose, response: ns) -> float:
        calls.append((situation, source, response))
        return 1.0 if source == "local" else 0.0

    known = Situation(speed=3.0)
    policy = seen(patient, [0.02, 0.3])
    assert policy.decide(known, 1.0).deadline > 300_000_000
    assert policy.decide(known, 0.1).deadline <= 100_000_000
    assert all(it is known for it, _, _ in calls)
    assert {source for _, source, _ in calls} == {"local", "cloud"}
    assert all(type(response) is ns for _, _, response in calls)
    hasty = seen(lambda situation, source, response: float(response), [0.02, 0.3])
    assert hasty.decide(known, 1.0).deadline == 10_000_000


def test_what_a_loss_raises_is_raised_and_the_policy_goes_on() -> None:
    broken = [True]

    def loss(situation: Situation, source: Whose, response: ns) -> float:
        if broken[0]:
            raise LookupError("no figure")
        return 0.0

    policy = seen(loss, [0.02])
    with pytest.raises(LookupError, match="no figure"):
        policy.decide(Situation(), 1.0)
    broken[0] = False
    assert policy.decide(Situation(), 1.0).reason is Reason.EXPECTED
    with pytest.raises(TypeError):
        seen(lambda situation, source, response: "much", [0.02]).decide(Situation(), 1.0)


class LearningPolicy(Policy):
    """Chooses a deadline, and stores everything that it learns."""

    def __init__(self, deadline: float) -> None:
        self.deadline, self.learnt = deadline, list[tuple[End, Any]]()

    def decide(self, situation: Situation, cap: Any) -> Chosen:
        return Constant(self.deadline).decide(situation, cap)

    def ended(self, end: End, age: Any) -> None:
        self.learnt.append((end, age))


def test_what_is_compiled_of_policies_is_given_to_the_engine_and_all_else_as_it_is() -> None:
    class OwnConstant(Constant):
        """Might override the decision."""

    guard, expected = Guard(), Expected(Accuracy(0.3, 0.5, 0.001), 0.3)
    streaming = Streaming(BoxDetector(70.0, 0.7), BoxDetector(95.0, 0.85), 0.14, 0.015)
    own = OwnConstant(0.2)
    assert compiled(Constant(0.2)) == ns(200_000_000)
    assert compiled(guard) is guard._guard
    assert compiled(expected) is expected._expected
    assert compiled(streaming) is streaming._expected
    assert compiled(own) is own
    capped = guard.cap(expected)
    assert compiled(capped) == (guard._guard, expected._expected)


def test_a_function_is_given_the_cap_in_nanoseconds_and_a_cap_that_is_met_is_none() -> None:
    caps: list[Any] = []

    def function(situation: Situation, cap: ns) -> float:
        caps.append(cap)
        return 0.3

    policy = policy_of(function)
    assert policy.decide(Situation(), 0.3) == Chosen(ns(300_000_000), Reason.CONSTANT)
    assert policy.decide(Situation(), ns(299_999_999)) == Chosen(ns(299_999_999), Reason.CAP)
    assert [(type(it), it) for it in caps] == [(ns, 300_000_000), (ns, 299_999_999)]
    policy.ended(End.ANSWERED, 0.1)
    constant = Constant(0.3)
    assert policy_of(constant) is constant


def test_of_a_policy_under_the_cap_of_another_both_learn() -> None:
    least, other = LearningPolicy(0.2), LearningPolicy(0.3)
    capped = Capped(least, other)
    assert capped.decide(Situation(), 1.0) == Chosen(ns(200_000_000), Reason.CONSTANT)
    assert capped.decide(Situation(), 0.1) == Chosen(ns(100_000_000), Reason.CAP)
    other.deadline = 0.05
    assert capped.decide(Situation(), 0.1) == Chosen(ns(50_000_000), Reason.CONSTANT)
    capped.ended(End.FAILED, 0.4)
    assert least.learnt == other.learnt == [(End.FAILED, 0.4)]


def test_durations_that_come_out_can_go_in() -> None:
    chosen = Constant(0.2).decide(Situation(), cap=1.0)
    assert (type(chosen.deadline), repr(chosen.deadline)) == (ns, "ns(200000000)")
    assert Constant(chosen.deadline).decide(Situation(), cap=1.0) == chosen
    with pytest.raises(TypeError, match=r"100000000\.0 for seconds, or ns\(100000000\)"):
        Constant(chosen.deadline // 2)


#: A type checker would refuse this where metres belong.
MARGIN: Any = timedelta(seconds=2)


@pytest.mark.parametrize("response", [0.3017, timedelta(milliseconds=301.7), ns(301_700_000)])
@pytest.mark.parametrize("period", [0.04, timedelta(milliseconds=40), ns(40_000_000)])
def test_times_of_a_vehicle_are_durations(response: Time, period: Time) -> None:
    vehicle = Parameters(local_response=response, period_local=period)
    assessment = Guard(vehicle).judge(Situation(speed=18.0))
    assert assessment.case is Case.LOCAL_STOPS
    seconds = Parameters(local_response=0.3017, period_local=0.04)
    assert assessment == Guard(seconds).judge(Situation(speed=18.0))


@pytest.mark.parametrize(
    ("vehicle", "error", "message"),
    [
        (Parameters(local_response=301_700_000), TypeError, r"local_response: .* ns\(301700000\)"),
        (Parameters(lateness=5), TypeError, r"lateness: a duration of 5: write 5\.0 for seconds"),
        (Parameters(brake_delay=(0.1, 100)), TypeError, r"brake_delay: .* ns\(100\)"),
        (Parameters(local_response=301.7), DeadlineError, "local's response: 301.7 s; it must be"),
        (Parameters(brake_delay=-0.1), TimeError, "brake_delay: a duration of -0.1 s"),
        (Parameters(deceleration=ns(7)), TypeError, r"deceleration: ns\(7\): a duration was given"),
        (Parameters(margin=MARGIN), TypeError, r"margin: .* a duration was given"),
        (
            Parameters(hazards=(Hazard(range_local=39e3, range_cloud=57e3),)),
            DeadlineError,
            "local's range: 39000 m; it must be from 0.01 to 10000 m",
        ),
    ],
)
def test_a_figure_in_a_wrong_unit_is_refused(
    vehicle: Parameters, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        Guard(vehicle)
    with pytest.raises(error, match=message):
        Expected(Impact(vehicle), local_response=0.3)


def test_a_policy_of_expected_checks_its_figures() -> None:
    loss = Accuracy(0.3, 0.5, 0.001)
    with pytest.raises(TypeError, match=r"ns\(300\)"):
        Expected(loss, local_response=300)
    with pytest.raises(DeadlineError, match="price of a millisecond: -1"):
        Expected(Accuracy(0.3, 0.5, -1.0), local_response=0.3)
    with pytest.raises(TypeError, match="a loss is Impact, Accuracy or a function"):
        Expected(5, local_response=0.3)  # type: ignore[arg-type]


def test_nanoseconds_are_whole_and_in_their_range() -> None:
    for part in (0.5, 1.0, "7", True, None):
        with pytest.raises(TypeError, match="nanoseconds are a whole number"):
            ns(part)  # type: ignore[arg-type]
    for beyond in (-1, 2**64):
        with pytest.raises(TimeError, match="nanoseconds are from 0"):
            ns(beyond)
    assert pickle.loads(pickle.dumps(ns(2**64 - 1))) == ns(2**64 - 1)
