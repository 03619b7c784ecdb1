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


def covered(of: tuple[float, ...]) -> set[tuple[int, int]]:
    """The unit squares of a box with whole sides."""
    left, top, right, bottom = map(int, of[:4])
    return {(x, y) for x in range(left, right) for y in range(top, bottom)}


def test_overlap_is_the_share_of_squares_in_common() -> None:
    rng = random.Random(6)
    for _ in range(300):
        one, other = (
            (x, y, x + rng.randint(0, 5), y + rng.randint(0, 5))
            for x, y in ((rng.randint(0, 4), rng.randint(0, 4)) for _ in "ab")
        )
        common, all_of = covered(one) & covered(other), covered(one) | covered(other)
        expected = len(common) / len(all_of) if all_of else 0.0
        assert overlap(one, other) == pytest.approx(expected), (one, other)


class ReferenceForecast:
    """Does what `Forecast` does, by whole tracks: each is a box and its velocity."""

    def __init__(self, least: float, weight: float) -> None:
        self.least, self.weight = least, weight
        self.at: float | None = None
        self.tracks: list[tuple[tuple[float, ...], tuple[float, float] | None]] = []

    def boxes(self, at: float) -> list[tuple[float, ...]]:
        after = at - (self.at or 0.0)
        moved = []
        for (left, top, right, bottom, *more), velocity in self.tracks:
            dx, dy = (0.0, 0.0) if velocity is None else (velocity[0] * after, velocity[1] * after)
            moved.append((left + dx, top + dy, right + dx, bottom + dy, *more))
        return moved

    def update(self, at: float, boxes: list[tuple[float, ...]]) -> list[float]:
        if self.at is not None and at < self.at:
            return []
        old, free_old, free_new = (
            self.boxes(at),
            set(range(len(self.tracks))),
            set(range(len(boxes))),
        )
        pairs = {}
        while free_old and free_new:
            best = max((overlap(old[i], boxes[j]), i, j) for i in free_old for j in free_new)
            if best[0] < self.least:
                break
            pairs[best[2]] = best[1]
            free_old.remove(best[1])
            free_new.remove(best[2])
        speeds, tracks = [], []
        for j, now in enumerate(boxes):
            velocity = None
            if j in pairs:
                before, known = self.tracks[pairs[j]]
                velocity = known
                after = at - (self.at or 0.0)
                if after > 0:
                    middles = [[(it[k] + it[k + 2]) / 2 for k in (0, 1)] for it in (before, now)]
                    newest = [(b - a) / after for a, b in zip(*middles, strict=True)]
                    share = 1.0 if known is None else self.weight
                    x, y = (
                        share * a + (1 - share) * b
                        for a, b in zip(newest, known or (0.0, 0.0), strict=True)
                    )
                    velocity = x, y
                    speeds.append(abs(x) / (now[2] - now[0]) + abs(y) / (now[3] - now[1]))
            tracks.append((now, velocity))
        self.at, self.tracks = at, tracks
        return speeds


@pytest.mark.parametrize("least", [0.3, 0.5, 1.0])
def test_a_forecast_is_that_of_tracks_followed_one_by_one(least: float) -> None:
    rng = random.Random(8)
    for _ in range(20):
        forecast, reference = Forecast(least, 0.4), ReferenceForecast(least, 0.4)
        at = 0.0
        here = [[rng.uniform(0, 90), rng.uniform(0, 90)] for _ in range(4)]
        for _ in range(12):
            at += rng.choice([0.1, 0.1, 0.3, 0.0, -0.05])
            for it in here:
                if rng.random() < 0.7:
                    it[0], it[1] = it[0] + rng.uniform(-6, 9), it[1] + rng.uniform(-9, 6)
            seen = [it for it in here if rng.random() < 0.85]
            boxes: list[tuple[float, ...]] = [
                (x, y, x + rng.uniform(18, 22), y + rng.uniform(18, 22), 0.9) for x, y in seen
            ]
            speeds = forecast.update(at, boxes)
            assert sorted(speeds) == pytest.approx(sorted(reference.update(at, boxes)))
            for later in (at, at + 0.7):
                for own, other in zip(forecast.boxes(later), reference.boxes(later), strict=True):
                    assert own == pytest.approx(other)


def test_a_box_that_overlaps_by_just_the_least_is_the_one_of_before() -> None:
    forecast = Forecast(least_overlap=0.5)
    forecast.update(0.0, [(0.0, 0.0, 2.0, 1.0)])
    assert forecast.update(0.5, [(0.0, 0.0, 1.0, 1.0)]) == [1.0]


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
    assert Constant(0.1).cap(policy).decide(Situation(), 1.0).deadline == 15_000_000


def test_a_detector_that_could_not_be_is_refused() -> None:
    with pytest.raises(DeadlineError, match="overlap of right boxes"):
        streaming(BoxDetector(70.0, 0.4))
    with pytest.raises(DeadlineError, match="local's accuracy"):
        streaming(BoxDetector(math.nan, 0.7))
    with pytest.raises(DeadlineError, match="frames"):
        streaming(period=0.0)
    with pytest.raises(TypeError, match="overlap"):
        streaming(BoxDetector(70.0, "much"))  # type: ignore[arg-type]
