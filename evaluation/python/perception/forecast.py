"""Moves a detector's boxes on to the present, because the world moved while it computed.

A `Forecast` follows boxes from output to output by their overlap, and moves each on at constant
velocity:

>>> forecast = Forecast()
>>> forecast.update(0.0, [(100.0, 50.0, 120.0, 100.0)])
[]
>>> forecast.update(0.1, [(102.0, 50.0, 122.0, 100.0)])  # 20 pixels a second, a box a second
[1.0]
>>> forecast.boxes(0.2)
[(104.0, 50.0, 124.0, 100.0)]
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

__all__ = ["Box", "Forecast", "overlap"]

#: Left, top, right, bottom, and whatever else belongs to it, such as a score.
Box: TypeAlias = Sequence[float]


def overlap(one: Box, other: Box) -> float:
    """Returns the overlap of two boxes: their intersection over their union (IoU).

    >>> overlap((0.0, 0.0, 2.0, 1.0), (1.0, 0.0, 3.0, 1.0))
    0.333...
    """
    width = min(one[2], other[2]) - max(one[0], other[0])
    height = min(one[3], other[3]) - max(one[1], other[1])
    if width <= 0 or height <= 0:
        return 0.0
    common = width * height
    return common / (_area(one) + _area(other) - common)


class Forecast:
    """Follows boxes from output to output, and moves them on at constant velocity.

    Args:
        least_overlap: The least overlap (IoU) at which a box counts as one of the previous boxes.
            Among several, the one with the greatest overlap counts.
        weight: The weight of the newest movement in the mean velocity, above 0 and at most 1.

    Raises:
        ValueError: if an argument is out of its range.
    """

    def __init__(self, least_overlap: float = 0.3, weight: float = 0.5) -> None:
        if not (0.0 < least_overlap <= 1.0 and 0.0 < weight <= 1.0):
            raise ValueError("least_overlap and weight are shares, above 0 and at most 1")
        self._least_overlap, self._weight = least_overlap, weight
        self._at = -math.inf
        self._boxes: list[tuple[float, ...]] = []
        #: The velocity of each box, in the unit of boxes a second; None if it was seen once.
        self._velocities: list[tuple[float, float] | None] = []

    def update(self, at: float, boxes: Sequence[Box]) -> list[float]:
        """Updates the forecast with the boxes of a frame, captured at an instant in seconds.

        Boxes of the same instant replace the previous ones, as a revision does. Boxes of an earlier
        instant are ignored.

        Returns:
            The speed of each box that was seen before, in boxes a second: ``|vx| / width + |vy| /
            height``. Give these speeds to `fuseline.deadline.Streaming.moved`.
        """
        if not math.isfinite(at) or at < self._at:
            return []
        new = [tuple(float(it) for it in box) for box in boxes]
        velocities: list[tuple[float, float] | None] = [None] * len(new)
        speeds = []
        for i, j in self._pairs(self.boxes(at), new):
            velocities[j] = velocity = self._velocity(i, new[j], at)
            if velocity is not None and at > self._at:
                left, top, right, bottom = new[j][:4]
                speeds.append(
                    abs(velocity[0]) / max(right - left, 1e-9)
                    + abs(velocity[1]) / max(bottom - top, 1e-9)
                )
        self._at, self._boxes, self._velocities = at, new, velocities
        return speeds

    def boxes(self, at: float) -> list[tuple[float, ...]]:
        """Returns the newest boxes, each at its expected place at an instant."""
        moved = []
        for box, velocity in zip(self._boxes, self._velocities, strict=True):
            x, y = ((at - self._at) * it for it in velocity or (0.0, 0.0))
            moved.append((box[0] + x, box[1] + y, box[2] + x, box[3] + y, *box[4:]))
        return moved

    def _pairs(
        self, old: list[tuple[float, ...]], new: list[tuple[float, ...]]
    ) -> list[tuple[int, int]]:
        """Returns which old box is which new one; the pairs that overlap most come first."""
        pairs = sorted(
            (
                (overlap(one, other), i, j)
                for i, one in enumerate(old)
                for j, other in enumerate(new)
            ),
            reverse=True,
        )
        left, right = set(range(len(old))), set(range(len(new)))
        chosen = []
        for shared, i, j in pairs:
            if shared < self._least_overlap:
                break
            if i in left and j in right:
                left.remove(i)
                right.remove(j)
                chosen.append((i, j))
        return chosen

    def _velocity(self, i: int, box: tuple[float, ...], at: float) -> tuple[float, float] | None:
        """Returns the velocity of a box that was number `i` before."""
        known, seconds = self._velocities[i], at - self._at
        if seconds <= 0:
            return known
        before = self._boxes[i]
        # The box's middle moves; that its size changes is its detector's noise, or its pose.
        moved = (
            (box[0] + box[2] - before[0] - before[2]) / 2 / seconds,
            (box[1] + box[3] - before[1] - before[3]) / 2 / seconds,
        )
        if known is None:
            return moved
        weight = self._weight
        return (
            weight * moved[0] + (1 - weight) * known[0],
            weight * moved[1] + (1 - weight) * known[1],
        )


def _area(box: Box) -> float:
    return (box[2] - box[0]) * (box[3] - box[1])
