"""The frames of OpenCV's sample `vtest.avi`, as JPEGs."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

#: The JPEG quality that a camera would use.
QUALITY = 80
#: Frames a second, estimated from the speed at which people walk.
RATE = 7.0


def extract(video: Path, folder: Path) -> list[Path]:
    """Writes each frame to a file and returns the files. Files that exist are used again."""
    if files := jpegs(folder):
        return files
    part = folder.with_name(f"{folder.name}.part")
    part.mkdir(parents=True, exist_ok=True)
    capture = cv2.VideoCapture(str(video))
    number = 0
    while True:
        is_there, image = capture.read()
        if not is_there:
            break
        is_encoded, jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        if not is_encoded:
            raise OSError(f"{video}: frame {number} cannot be encoded")
        (part / f"{number:04}.jpg").write_bytes(jpeg.tobytes())
        number += 1
    if not number:
        raise OSError(f"{video}: OpenCV reads no frame of it")
    part.rename(folder)
    return jpegs(folder)


def jpegs(folder: Path) -> list[Path]:
    """Returns the frames of a folder, in order."""
    return sorted(folder.glob("[0-9]*.jpg"))


def decode(jpeg: bytes) -> NDArray[np.uint8]:
    """Returns the image of a JPEG."""
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise ValueError("not a JPEG")
    return np.asarray(image, np.uint8)
