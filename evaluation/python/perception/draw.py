"""Draws boxes on frames, coloured by source, as a strip of images."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from metrics import Boxes

#: Each source's colour: blue, green and red.
COLOURS = {"local": (0, 140, 255), "west": (255, 120, 0), "east": (60, 200, 0)}
COLUMNS = 3
#: The scale of a drawn frame, as a share of its size.
SCALE = 0.7


@dataclass(frozen=True)
class DrawnOutput:
    """Boxes of a source, and when they were sent, in seconds after the frame's capture."""

    source: str
    boxes: Boxes
    latency: float


def draw(image: NDArray[np.uint8], number: int, outputs: list[DrawnOutput]) -> NDArray[np.uint8]:
    """Returns a frame with its outputs. The last output's boxes are thick, the others thin."""
    image = image.copy()
    for output in outputs:
        is_last = output is outputs[-1]
        for box in output.boxes:
            left, top, right, bottom = (round(float(it)) for it in box[:4])
            thickness = 2 if is_last else 1
            cv2.rectangle(image, (left, top), (right, bottom), COLOURS[output.source], thickness)
    cv2.rectangle(image, (0, 0), (image.shape[1], 26), (0, 0, 0), -1)
    x = _write(image, f"frame {number}", 8, (255, 255, 255))
    for output in outputs:
        words = f"{output.source} {output.latency * 1e3:.0f} ms, {len(output.boxes)}"
        x = _write(image, words, x + 24, COLOURS[output.source])
    return image


def strip(images: list[NDArray[np.uint8]], path: Path) -> None:
    """Writes the images in rows to one file."""
    blank = np.zeros_like(images[0])
    images = images + [blank] * (-len(images) % COLUMNS)
    images = [
        cv2.resize(it, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_AREA) for it in images
    ]
    rows = [np.hstack(images[at : at + COLUMNS]) for at in range(0, len(images), COLUMNS)]
    if not cv2.imwrite(str(path), np.vstack(rows)):
        raise OSError(f"{path} cannot be written")


def _write(image: NDArray[np.uint8], words: str, x: int, colour: tuple[int, int, int]) -> int:
    """Writes words and returns where they end."""
    font, size = cv2.FONT_HERSHEY_SIMPLEX, 0.55
    cv2.putText(image, words, (x, 19), font, size, colour, 1, cv2.LINE_AA)
    return int(x + cv2.getTextSize(words, font, size, 1)[0][0])
