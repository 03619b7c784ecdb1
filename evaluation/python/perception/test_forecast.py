"""Tests the forecast of boxes against tracks that are followed one by one."""

from __future__ import annotations

import math
import random
import unittest

from forecast import Forecast, overlap


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


def covered(of: tuple[float, ...]) -> set[tuple[int, int]]:
    """The unit squares of a box with whole sides."""
    left, top, right, bottom = map(int, of[:4])
    return {(x, y) for x in range(left, right) for y in range(top, bottom)}


class Overlap(unittest.TestCase):
    """Compares `overlap` with a count of squares."""

    def test_share_of_squares(self) -> None:
        rng = random.Random(6)
        for _ in range(300):
            one, other = (
                (x, y, x + rng.randint(0, 5), y + rng.randint(0, 5))
                for x, y in ((rng.randint(0, 4), rng.randint(0, 4)) for _ in "ab")
            )
            common, all_of = covered(one) & covered(other), covered(one) | covered(other)
            expected = len(common) / len(all_of) if all_of else 0.0
            self.assertAlmostEqual(overlap(one, other), expected)
            self.assertAlmostEqual(overlap(other, one), expected)


class Tracks(unittest.TestCase):
    """Follows boxes that move, come and go, at instants that repeat and go back."""

    def test_like_tracks_followed_one_by_one(self) -> None:
        rng = random.Random(8)
        for least in (0.3, 0.5, 1.0) * 20:
            forecast, reference = Forecast(least, 0.4), ReferenceForecast(least, 0.4)
            at = 0.0
            here = [[rng.uniform(0, 90), rng.uniform(0, 90)] for _ in range(4)]
            for _ in range(12):
                at += rng.choice([0.1, 0.1, 0.3, 0.0, -0.05])
                for it in here:
                    if rng.random() < 0.7:
                        it[0], it[1] = it[0] + rng.uniform(-6, 9), it[1] + rng.uniform(-9, 6)
                boxes: list[tuple[float, ...]] = [
                    (x, y, x + rng.uniform(18, 22), y + rng.uniform(18, 22), 0.9)
                    for x, y in here
                    if rng.random() < 0.85
                ]
                self._compare(forecast.update(at, boxes), reference.update(at, boxes))
                for later in (at, at + 0.7):
                    moved = zip(forecast.boxes(later), reference.boxes(later), strict=True)
                    for own, other in moved:
                        self._compare(own, other)

    def test_least_overlap_is_enough(self) -> None:
        forecast = Forecast(least_overlap=0.5)
        forecast.update(0.0, [(0.0, 0.0, 2.0, 1.0)])
        self.assertEqual(forecast.update(0.5, [(0.0, 0.0, 1.0, 1.0)]), [1.0])

    def test_ignores_instants_that_are_none(self) -> None:
        forecast, box = Forecast(), (0.0, 0.0, 2.0, 1.0)
        forecast.update(0.3, [box])
        for at in (0.2, math.nan, math.inf, -math.inf):
            self.assertEqual(forecast.update(at, [(9.0, 0.0, 11.0, 1.0)]), [])
            self.assertEqual(forecast.boxes(0.3), [box])

    def test_refuses_other_shares(self) -> None:
        for share in (0.0, 1.01, -0.1):
            with self.assertRaises(ValueError):
                Forecast(least_overlap=share)
            with self.assertRaises(ValueError):
                Forecast(weight=share)

    def _compare(
        self, own: list[float] | tuple[float, ...], other: list[float] | tuple[float, ...]
    ) -> None:
        self.assertEqual(len(own), len(other))
        for one, another in zip(sorted(own), sorted(other), strict=True):
            self.assertAlmostEqual(one, another)


if __name__ == "__main__":
    unittest.main()
