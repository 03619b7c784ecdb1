"""Compares the figures of the book's chapter on scenarios with the software that made them."""

from __future__ import annotations

import json
import math
import unittest
from pathlib import Path

import drives
import swerve
from fuseline.deadline import Situation
from jaywalking import touches
from operators import Race
from planner import Planner
from scenes import Meeting
from sight import sees
from world import Pose


class Jaywalking(unittest.TestCase):
    """CommonRoad's car hits nobody 0.02 m/s below the stored speeds, and somebody 0.02 m/s above."""

    def test_the_stored_speeds(self) -> None:
        """Tests each row that the closed form is compared with, and the book's rows on braking."""
        stored = json.loads((Path(__file__).parent / "greatest.json").read_text())["rows"]
        brakes = [(False, 0.4, 0.5, 8.88), (False, 0.4, 0.4, 9.42)]
        for swerves, rate, response, speed in [(True, *row) for row in stored] + brakes:
            with self.subTest(swerves=swerves, rate=rate, response=response):
                self.assertFalse(
                    touches(speed - 0.02, response, swerves=swerves, steering_rate=rate)
                )
                self.assertTrue(
                    touches(speed + 0.02, response, swerves=swerves, steering_rate=rate)
                )


class SwerveInSumo(unittest.TestCase):
    """In SUMO too only a cached plan swerves in time."""

    def test_only_the_cached_plan_avoids(self) -> None:
        for speed, response, expected in (
            (7.8, 0.5, False), (8.7, 0.5, True), (8.7, 0.4, False), (9.9, 0.4, True)
        ):  # fmt: skip
            with self.subTest(speed=speed, response=response):
                self.assertEqual(swerve.touches(speed, response), expected)


class Sharing(unittest.TestCase):
    """Tests when a shared location makes ego brake."""

    def test_a_runner_is_one_that_cannot_stop_and_meets_ego_soon(self) -> None:
        scene = Meeting(12.0, "car", 14.0, 0.0, (8.0, 6.0))
        scene._x, scene._y = 100.0, 100.0

        def brakes(ahead: float, away: float, age: float = 0.0) -> bool:
            ego = Pose((100.0 - ahead, 100.0), 0.0, 12.0, 4.7, 1.9)
            other = Pose((100.0, 100.0 - away), math.pi / 2, 14.0, 4.7, 1.9)
            return scene.must_brake(ego, other, age)

        # 30 m before its line it needs 3.3 m/s² to stop there; 23 m before, 4.3.
        self.assertFalse(brakes(30.0, 35.0))
        self.assertTrue(brakes(30.0, 28.0))
        self.assertTrue(brakes(30.0, 35.0, age=0.5), "it went on meanwhile")
        self.assertFalse(brakes(60.0, 28.0), "ego comes three seconds later")
        self.assertFalse(brakes(-1.0, 5.0), "ego is past it")


class Parts(unittest.TestCase):
    """The parts of a drive."""

    def test_three_consecutive_frames_in_any_order_decide(self) -> None:
        planner = Planner()
        self.assertEqual([planner.take(t, True) for t in (0, 2, 1)], [False, False, True])
        planner = Planner()
        self.assertEqual(
            [planner.take(t, t != 1) for t in range(5)], [False, False, False, False, True]
        )

    def test_what_stands_between_hides(self) -> None:
        target = [(30.0, -1.0), (30.0, 1.0), (32.0, 1.0), (32.0, -1.0)]
        wall = [(10.0, -3.0), (11.0, -3.0), (11.0, 3.0), (10.0, 3.0)]
        self.assertAlmostEqual(sees((0.0, 0.0), 0.0, target, []) or 0.0, 30.0)
        self.assertIsNone(sees((0.0, 0.0), 0.0, target, [wall]))
        self.assertIsNone(sees((0.0, 0.0), 3.0, target, []))

    def test_a_race_gives_what_is_first(self) -> None:
        race = Race(lambda local, cloud: min((local, 0), (cloud or 0, 1)))
        race.frame(0, 300, 200, Situation())
        self.assertEqual([(it.at, it.source) for it in race.until(250)], [(200, 1)])

    def test_wilson_is_that_of_the_textbooks(self) -> None:
        # Newcombe 1998, table I: 81 of 263.
        low, high = drives.wilson(81, 263)
        self.assertAlmostEqual(low, 0.2553, 4)
        self.assertAlmostEqual(high, 0.3662, 4)


if __name__ == "__main__":
    unittest.main()
