"""What the vehicle is emulated with: parts that can die, and recorded networks."""

from __future__ import annotations

import asyncio
from bisect import bisect_right
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")

DATA = Path(__file__).parents[4] / "testkit/data"
#: What can be killed while the vehicle drives.
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


@dataclass(frozen=True)
class Kill:
    """Which part dies, and when. A dead sensor sends nothing; a dead source never answers."""

    part: str | None
    at: float

    def hits(self, part: str) -> bool:
        """Whether this part is dead by now."""
        return self.part == part and self.at <= asyncio.get_running_loop().time()

    async def compute(self, part: str, seconds: float, result: T) -> T:
        """A computation of this part."""
        await asyncio.sleep(seconds)
        if self.hits(part):
            await asyncio.Event().wait()
        return result


class Network:
    """Round trips of a file of `testkit/data`, by time: none where the network was not there."""

    def __init__(self, file: str, unit: float, column: int, start: float) -> None:
        self._at: list[float] = []
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
        """Takes as long as a message and its reply took then, or for ever."""
        since = (asyncio.get_running_loop().time() - self._start) % self._at[-1]
        place = bisect_right(self._at, since) - 1
        seconds = self._seconds[place] if place >= 0 else None
        if seconds is None:
            await asyncio.Event().wait()
        else:
            await asyncio.sleep(seconds)


def _seconds(field: str) -> float | None:
    """Of milliseconds; what is infinite or below 0 is no round trip."""
    ms = float(field)
    return ms / 1000 if 0 <= ms < float("inf") else None
