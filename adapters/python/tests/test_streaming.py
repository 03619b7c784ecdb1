"""Tests how the speed of a stream's boxes determines the deadline."""

from __future__ import annotations

import copy
import math
import pickle

import pytest
from fuseline import DeadlineError
from fuseline.deadline import BoxDetector, Constant, End, Expected, Situation, Streaming

DETECTORS = BoxDetector(70.0, 0.7), BoxDetector(95.0, 0.85)


def streaming(local: BoxDetector = DETECTORS[0], period: float = 0.14) -> Streaming:
    return Streaming(local, DETECTORS[1], period, local_response=0.015, probe_every=None)


def test_the_faster_the_world_the_shorter_the_deadline() -> None:
    deadlines = []
    for speed in (0.0, 0.3, 0.6, 2.0):
        policy = streaming()
        policy.moved([speed, math.nan, -1.0])
        for age in (0.06, 0.06, 0.2, 0.4):
            policy.ended(End.ANSWERED, age)
        deadlines.append(policy.decide(Situation(), 0.5).deadline)
    assert deadlines == sorted(deadlines, reverse=True)
    assert len(set(deadlines)) >= 3


@pytest.mark.parametrize("copied", [lambda it: pickle.loads(pickle.dumps(it)), copy.deepcopy])
def test_a_copy_knows_the_cloud_and_the_speeds(copied: object) -> None:
    policy = streaming()
    policy.moved([0.9] * 70)
    for age in (0.05, 0.2, 0.3):
        policy.ended(End.ANSWERED, age)
    copy_of = copied(policy)  # type: ignore[operator]
    assert type(copy_of) is Streaming
    assert copy_of.decide(Situation(), 0.5) == policy.decide(Situation(), 0.5)
    forgetful = streaming()
    forgetful.__setstate__((policy.observations(), []))
    assert forgetful.decide(Situation(), 0.5) != policy.decide(Situation(), 0.5)


def test_a_constant_caps_it_and_it_is_one_of_those_that_expect() -> None:
    policy = streaming()
    policy.ended(End.ANSWERED, 0.3)
    assert isinstance(policy, Expected)
    assert Constant(0.1).cap(policy).decide(Situation(), 1.0).deadline == 15_000_000


def test_a_detector_that_could_not_be_is_refused() -> None:
    with pytest.raises(DeadlineError, match="overlap of correct boxes"):
        streaming(BoxDetector(70.0, 0.4))
    with pytest.raises(DeadlineError, match="local's accuracy"):
        streaming(BoxDetector(math.nan, 0.7))
    with pytest.raises(DeadlineError, match="frames"):
        streaming(period=0.0)
    with pytest.raises(TypeError, match="overlap"):
        streaming(BoxDetector(70.0, "much"))  # type: ignore[arg-type]
