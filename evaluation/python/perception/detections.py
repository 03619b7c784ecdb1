"""Stores the boxes that the networks found, so that policies need neither models nor frames."""

from __future__ import annotations

import gzip
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from metrics import Boxes

KEPT = Path(__file__).with_name("detections.jsonl.gz")
#: Coordinates are kept in halves of a pixel, scores in hundredths.
STEPS_PER_PIXEL = 2
#: Local, then the clouds by rising priority.
SOURCES = ("local", "west", "east")


@dataclass(frozen=True)
class KeptDetections:
    """The boxes and the computing times of each source, and the reference, by frame."""

    #: Frames a second.
    rate: float
    #: The number of bytes of each frame's JPEG.
    jpeg_bytes: list[int]
    #: The network of each source, in words.
    networks: dict[str, str]
    #: The time that each source computed for each frame, in seconds, on one thread.
    seconds: dict[str, list[float]]
    #: The boxes that each source found in each frame.
    found: dict[str, list[Boxes]]
    #: The places of people: boxes without scores.
    reference: list[Boxes]

    def __len__(self) -> int:
        return len(self.jpeg_bytes)

    def save(self, path: Path = KEPT) -> None:
        """Writes packed JSON: a line about all frames, then a line for each frame."""
        lines: list[dict[str, Any]] = [{"rate": self.rate, "networks": self.networks}]
        for frame, jpeg_bytes in enumerate(self.jpeg_bytes):
            seconds = {name: round(self.seconds[name][frame], 4) for name in SOURCES}
            line = {"jpeg_bytes": jpeg_bytes, "seconds": seconds}
            line |= {name: _rows(self.found[name][frame]) for name in SOURCES}
            lines.append(line | {"reference": _rows(self.reference[frame])})
        words = (json.dumps(line, ensure_ascii=False, separators=(",", ":")) for line in lines)
        unpacked = "".join(f"{line}\n" for line in words)
        path.write_bytes(gzip.compress(unpacked.encode(), mtime=0))


def load(path: Path = KEPT) -> KeptDetections:
    """Reads what `KeptDetections.save` wrote."""
    about, *frames = map(json.loads, gzip.decompress(path.read_bytes()).splitlines())
    return KeptDetections(
        about["rate"],
        [it["jpeg_bytes"] for it in frames],
        about["networks"],
        {name: [it["seconds"][name] for it in frames] for name in SOURCES},
        {name: [_boxes(it[name], 5) for it in frames] for name in SOURCES},
        [_boxes(it["reference"], 4) for it in frames],
    )


def _rows(boxes: Boxes) -> list[list[float]]:
    """Rounds boxes to whole steps."""
    corners = np.round(boxes[:, :4] * STEPS_PER_PIXEL) / STEPS_PER_PIXEL
    rows = np.column_stack([corners, np.round(boxes[:, 4:], 2)])
    return [[int(it) if it == int(it) else it for it in row] for row in rows.tolist()]


def _boxes(rows: list[list[float]], width: int) -> Boxes:
    return np.array(rows, np.float64).reshape(-1, width)
