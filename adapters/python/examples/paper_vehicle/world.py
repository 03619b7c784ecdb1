"""The emulated world of the vehicle: parts that can die, and recorded networks."""

from __future__ import annotations

import asyncio
import math
from bisect import bisect_right
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")

DATA = Path(__file__).parents[4] / "testkit/data"
#: The parts that can be killed while the vehicle drives.
PARTS = (
    "left-camera",
    "right-camera",
    "localization",
    "west-detector",
    "east-detector",
    "cloud-tracker",
    "local-detector",
    "local-tracker",
    "local-predictor",
    "local-planner",
)


def elapsed_ms(start: float) -> int:
    """Milliseconds since an instant of the loop, whose seconds may be off in their last digit."""
    return round((asyncio.get_running_loop().time() - start) * 1000)


@dataclass(frozen=True)
class Kill:
    """Kills a part at an instant. A dead sensor sends nothing; a dead source never answers."""

    part: str | None
    start: float
    #: Milliseconds after the start.
    after: int

    def hits(self, part: str) -> bool:
        """Returns whether this part is dead by now."""
        return self.part == part and self.after <= elapsed_ms(self.start)

    async def compute(self, part: str, seconds: float, result: T) -> T:
        """Returns the result after this part's runtime, or never if the part is dead by then."""
        await asyncio.sleep(seconds)
        if self.hits(part):
            await asyncio.Event().wait()
        return result


def in_steps(ms: float) -> float:
    """Seconds of milliseconds, rounded up to whole steps of 2 ms.

    Control's ticks lie between two steps, so that no plan comes just at a tick: loops do not
    promise the order of what happens at one instant.
    """
    return math.ceil(ms / 2.0) * 2.0 / 1000.0


class Network:
    """Round trips of a file of `testkit/data`, by time: none where the network was not there."""

    def __init__(self, file: str, unit: int, column: int, start: float) -> None:
        #: In milliseconds; the file has them in units of that many.
        self._at: list[int] = []
        self._seconds: list[float | None] = []
        self._start = start
        for line in (DATA / file).read_text().splitlines():
            fields = line.split(",")
            try:
                at, seconds = int(fields[0]) * unit, _seconds(fields[column])
            except (ValueError, IndexError):
                continue  # the head, or a remark
            self._at.append(at)
            self._seconds.append(seconds)

    async def round_trip(self) -> None:
        """Takes as long as a message and its reply took then, or forever."""
        since = elapsed_ms(self._start) % self._at[-1]
        place = bisect_right(self._at, since) - 1
        seconds = self._seconds[place] if place >= 0 else None
        if seconds is None:
            await asyncio.Event().wait()
        else:
            await asyncio.sleep(seconds)


def _seconds(field: str) -> float | None:
    """Returns the seconds of a field in ms; an infinite or negative one is no round trip."""
    ms = float(field)
    return in_steps(ms) if 0 <= ms < float("inf") else None
