"""Reads the recorded detections and scores a drive by *streaming AP50*.

The boxes behind each command are compared with where people are in the newest frame that was
captured by its tick. `score.rs` of the example in Rust defines it.
"""

from __future__ import annotations

import sys
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[4] / "evaluation/python/perception"))
from detections import KeptDetections, load
from metrics import Boxes, BoxMatches, match, precision
from world import in_steps

#: The cameras look at the left and at the right half of the picture.
MIDDLE = 384.0


@dataclass(frozen=True)
class Seen:
    """Names the boxes that a message stands for, in place of the boxes themselves."""

    frame: int
    #: ``local``, ``west`` or ``east``.
    by: str
    #: The cameras whose frames were there.
    left: bool
    right: bool


@dataclass(frozen=True)
class Command:
    """Records what control did at one tick."""

    #: Milliseconds since the drive began.
    tick: int
    #: Seconds since the tick.
    latency: float
    #: The boxes behind the plan; none is a safe stop.
    seen: Seen | None


@dataclass(frozen=True)
class Figures:
    """Holds the figures of a drive: shares and precision in percent, ages in milliseconds."""

    ap50: float
    old: float
    p50: int
    p99: int
    stops: int


def captured(frame: int) -> int:
    """Returns when a frame is captured, in ms since the first one: 7 a second, as filmed."""
    return frame * 500 // 7 * 2


class Recording:
    """Holds the finds and times of three networks, and where people are."""

    def __init__(self) -> None:
        self._kept: KeptDetections = load()
        self._matches = cache(self._match)

    def __len__(self) -> int:
        return len(self._kept)

    def runtime(self, by: str, frame: int) -> float:
        """Returns how long a detector computes for a frame, in seconds."""
        return in_steps(self._kept.seconds[by][frame] * 1000.0)

    def newest(self, since: int) -> int:
        """Returns the newest frame that was captured by then."""
        return bisect_right(self._captures, since) - 1

    def figures(self, commands: Sequence[Command], deadline: int) -> Figures:
        """Returns the figures of a drive."""
        ages = sorted(it.tick - captured(it.seen.frame) for it in commands if it.seen is not None)
        matches = [self._matches(it.seen, self.newest(it.tick)) for it in commands]
        p50, p99 = (ages[len(ages) * percent // 100] if ages else 0 for percent in (50, 99))
        old = 100.0 * sum(age > deadline for age in ages) / len(commands)
        return Figures(precision(matches).ap50, old, p50, p99, len(commands) - len(ages))

    @cached_property
    def _captures(self) -> list[int]:
        return [captured(frame) for frame in range(len(self))]

    def _boxes(self, seen: Seen | None) -> Boxes:
        """Returns the boxes, with their scores."""
        if seen is None:
            return self._kept.found["local"][0][:0]
        boxes = self._kept.found[seen.by][seen.frame]
        is_left = (boxes[:, 0] + boxes[:, 2]) / 2.0 < MIDDLE
        return boxes[(is_left & seen.left) | (~is_left & seen.right)]

    def _match(self, seen: Seen | None, frame: int) -> BoxMatches:
        return match(self._boxes(seen), self._kept.reference[frame])
