"""Boxes of a stream: moved on at constant velocity, and what their speed makes of a deadline."""

from __future__ import annotations

import copy
import math
import pickle
import random

import pytest
from fuseline import DeadlineError
from fuseline.deadline import BoxDetector, Constant, End, Expected, Situation, Streaming
from fuseline.forecast import Forecast, overlap

DETECTORS = BoxDetector(70.0, 0.7), BoxDetector(95.0, 0.85)


def streaming(local: BoxDetector = DETECTORS[0], period: float = 0.14) -> Streaming:
    return Streaming(local, DETECTORS[1], period, local_response=0.015, probe_every=None)


def box(left: float, top: float = 50.0, width: float = 20.0) -> tuple[float, ...]:
    return (left, top, left + width, top + 50.0, 0.9)


def test_what_moves_evenly_is_where_it_was_forecast() -> None:
    forecast = Forecast()
    for k in range(6):
        at = k / 7
        where = [box(100 + 30 * at), box(400 - 20 * at, 200 + 7 * at, 30.0)]
        if k >= 2:
            for forecasted, real in zip(forecast.boxes(at), where, strict=True):
                assert forecasted == pytest.approx(real)
        speeds = forecast.update(at, where)
        if k:
            assert speeds == pytest.approx([30 / 20, 20 / 30 + 7 / 50]) or speeds == pytest.approx(
                [20 / 30 + 7 / 50, 30 / 20]
            )


def test_two_who_cross_are_followed_by_where_they_should_be() -> None:
    forecast = Forecast(weight=1.0)
    for k in range(11):
        at = k / 10
        forecast.update(at, [box(100 + 100 * at), box(200 - 100 * at, 65.0)])
    right, left = forecast.boxes(1.1)
    assert right[0] == pytest.approx(210)
    assert left[0] == pytest.approx(90)


def test_one_who_speeds_up_is_followed_beyond_where_the_boxes_still_overlap() -> None:
    forecast = Forecast(weight=1.0)
    for k in range(8):
        assert len(forecast.update(k / 10, [box(100 + 2 * k * k)])) == min(k, 1)


def test_a_revision_takes_the_place_of_what_it_revises_and_keeps_its_speed() -> None:
    forecast = Forecast()
    forecast.update(0.0, [box(100)])
    assert forecast.update(0.1, [box(104)]) == pytest.approx([2.0])
    assert forecast.update(0.1, [box(103), box(500)]) == []
    assert forecast.boxes(0.2)[0][0] == pytest.approx(107)
    assert forecast.boxes(0.2)[1][0] == 500


def test_what_is_older_or_of_no_instant_is_ignored() -> None:
    forecast = Forecast()
    forecast.update(0.3, [box(100)])
    for at in (0.2, math.nan, math.inf, -math.inf):
        assert forecast.update(at, [box(300)]) == []
        assert forecast.boxes(0.3) == [box(100)]


def test_who_is_gone_or_new_is_not_taken_for_another() -> None:
    forecast = Forecast()
    forecast.update(0.0, [box(100), box(300)])
    assert forecast.update(0.1, [box(600)]) == []
    assert forecast.boxes(0.5) == [box(600)]
    assert forecast.update(0.2, []) == []
    assert forecast.boxes(0.5) == []


@pytest.mark.parametrize("shares", [(0.0, 0.5), (0.3, 0.0), (1.1, 0.5), (0.3, math.nan)])
def test_a_forecast_by_what_is_no_share_is_refused(shares: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="shares"):
        Forecast(*shares)


def test_overlap_is_symmetric_and_a_share() -> None:
    rng = random.Random(5)
    for _ in range(1000):
        one, other = (box(rng.uniform(0, 60), rng.uniform(0, 90), rng.uniform(1, 50)) for _ in "ab")
        assert overlap(one, other) == pytest.approx(overlap(other, one))
        assert 0.0 <= overlap(one, other) <= 1.0
        assert overlap(one, one) == pytest.approx(1.0)


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
    assert Constant(0.1).caps(policy).decide(Situation(), 1.0).deadline == 15_000_000


def test_a_detector_that_could_not_be_is_refused() -> None:
    with pytest.raises(DeadlineError, match="overlap of right boxes"):
        streaming(BoxDetector(70.0, 0.4))
    with pytest.raises(DeadlineError, match="local's accuracy"):
        streaming(BoxDetector(math.nan, 0.7))
    with pytest.raises(DeadlineError, match="frames"):
        streaming(period=0.0)
    with pytest.raises(TypeError, match="overlap"):
        streaming(BoxDetector(70.0, "much"))  # type: ignore[arg-type]
