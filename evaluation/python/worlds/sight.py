"""Computes what a camera sees: by range, angle, and what stands between."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

Point = tuple[float, float]

#: How far the camera is behind the front, in metres, and how far it sees to each side, in radians.
BEHIND, HALF_ANGLE = 1.8, math.radians(60.0)


def sees(
    front: Point, heading: float, target: Sequence[Point], hidden_by: Iterable[Sequence[Point]]
) -> float | None:
    """Returns how far something with these corners is from a vehicle's front, in metres.

    Returns None if the camera does not see it. It is seen if its two nearest corners and the middle
    between them are within the camera's angle, and no polygon is in between.
    """
    eye = front[0] - BEHIND * math.cos(heading), front[1] - BEHIND * math.sin(heading)
    near = sorted(target, key=lambda corner: math.dist(eye, corner))[:2]
    middle = ((near[0][0] + near[1][0]) / 2, (near[0][1] + near[1][1]) / 2)
    points = (*near, middle)
    for x, y in points:
        angle = math.atan2(y - eye[1], x - eye[0]) - heading
        if abs(math.remainder(angle, math.tau)) > HALF_ANGLE:
            return None
    for polygon in hidden_by:
        if any(_crosses(eye, point, polygon) for point in points):
            return None
    return min(math.dist(front, point) for point in points)


def _crosses(start: Point, end: Point, polygon: Sequence[Point]) -> bool:
    """Returns whether a segment crosses an edge of a polygon."""
    corners = list(polygon)
    return any(
        _cross(start, end, a, b) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)
    )


def _cross(a: Point, b: Point, c: Point, d: Point) -> bool:
    return _side(a, b, c) * _side(a, b, d) < 0.0 and _side(c, d, a) * _side(c, d, b) < 0.0


def _side(a: Point, b: Point, c: Point) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
