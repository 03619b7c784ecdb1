"""What the networks found in the frames, kept: policies are compared without models or frames."""

from __future__ import annotations

import io
import lzma
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from metrics import Boxes

KEPT = Path(__file__).with_name("detections.npz.xz")
#: Coordinates are kept in such parts of a pixel, scores in hundredths.
STEPS_PER_PIXEL = 2
#: Local, then the clouds by rising priority.
SOURCES = ("local", "west", "east")


@dataclass(frozen=True)
class KeptDetections:
    """Frame by frame: boxes by source, how long each took, and the reference."""

    #: Frames a second.
    rate: float
    #: How many bytes each frame's JPEG has.
    jpeg_bytes: list[int]
    #: The network of each source, in words.
    networks: dict[str, str]
    #: How long each source computed for each frame, in seconds, on one thread.
    seconds: dict[str, list[float]]
    #: What each source found in each frame.
    found: dict[str, list[Boxes]]
    #: Where people are: boxes without scores.
    reference: list[Boxes]

    def __len__(self) -> int:
        return len(self.jpeg_bytes)

    def save(self, path: Path = KEPT) -> None:
        """Write it, packed."""
        packed: dict[str, Any] = {
            "rate": np.float64(self.rate),
            "jpeg_bytes": np.array(self.jpeg_bytes, np.uint32),
            "networks": np.array([self.networks[name] for name in SOURCES]),
        }
        for name in SOURCES:
            packed[f"{name}_tenths_of_ms"] = np.round(np.array(self.seconds[name]) * 1e4).astype(
                np.uint16
            )
            packed |= _pack(name, self.found[name])
        packed |= _pack("reference", self.reference)
        unpacked = io.BytesIO()
        np.savez(unpacked, **packed)
        path.write_bytes(lzma.compress(unpacked.getvalue(), preset=9))


def load(path: Path = KEPT) -> KeptDetections:
    """Read what `KeptDetections.save` wrote."""
    with np.load(io.BytesIO(lzma.decompress(path.read_bytes())), allow_pickle=False) as packed:
        tenths = {name: packed[f"{name}_tenths_of_ms"] for name in SOURCES}
        return KeptDetections(
            float(packed["rate"]),
            [int(it) for it in packed["jpeg_bytes"]],
            dict(zip(SOURCES, (str(it) for it in packed["networks"]), strict=True)),
            {name: [float(it) / 1e4 for it in values] for name, values in tenths.items()},
            {name: _unpack(name, packed) for name in SOURCES},
            _unpack("reference", packed),
        )


def _pack(name: str, frames: list[Boxes]) -> dict[str, Any]:
    """Columns pack better than rows, and sizes better than far corners."""
    rows = np.concatenate(frames)
    columns = np.round(rows[:, :4] * STEPS_PER_PIXEL).astype(np.int16)
    columns[:, 2:] -= columns[:, :2]
    packed = {
        f"{name}_counts": np.array([len(it) for it in frames], np.uint8),
        f"{name}_columns": np.ascontiguousarray(columns.T),
    }
    if rows.shape[1] == 5:
        packed[f"{name}_scores"] = np.round(rows[:, 4] * 100).astype(np.uint8)
    return packed


def _unpack(name: str, packed: Any) -> list[Boxes]:
    columns = packed[f"{name}_columns"].T.astype(np.float64)
    columns[:, 2:] += columns[:, :2]
    columns /= STEPS_PER_PIXEL
    if f"{name}_scores" in packed:
        columns = np.column_stack([columns, packed[f"{name}_scores"] / 100])
    return np.split(columns, np.cumsum(packed[f"{name}_counts"])[:-1])
