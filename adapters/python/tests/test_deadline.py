"""Losses as functions, and durations that say their unit."""

from __future__ import annotations

import math

import pytest
from fuseline import ns
from fuseline.deadline import (
    Accuracy,
    Constant,
    End,
    Expected,
    Impact,
    Parameters,
    Reason,
    Situation,
    Whose,
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
    asked: list[tuple[Situation, Whose, ns]] = []

    def patient(situation: Situation, source: Whose, response: ns) -> float:
        asked.append((situation, source, response))
        return 1.0 if source == "local" else 0.0

    known = Situation(speed=3.0)
    policy = seen(patient, [0.02, 0.3])
    assert policy.decide(known, 1.0).deadline > 300_000_000
    assert policy.decide(known, 0.1).deadline <= 100_000_000
    assert all(it is known for it, _, _ in asked)
    assert {source for _, source, _ in asked} == {"local", "cloud"}
    assert all(type(response) is ns for _, _, response in asked)
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


def test_durations_that_come_out_can_go_in() -> None:
    chosen = Constant(0.2).decide(Situation(), cap=1.0)
    assert (type(chosen.deadline), repr(chosen.deadline)) == (ns, "ns(200000000)")
    assert Constant(chosen.deadline).decide(Situation(), cap=1.0) == chosen
    with pytest.raises(TypeError, match=r"100000000\.0 for seconds, or ns\(100000000\)"):
        Constant(chosen.deadline // 2)
