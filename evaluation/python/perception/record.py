"""Runs each network over the frames once, and keeps what it found and how long it took.

    python record.py FRAMES MODELS [OUT.jsonl.gz]

Time is processor time of one thread, so that other work on the host does not count.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from detections import KEPT, SOURCES, KeptDetections
from frames import RATE, decode, jpegs
from metrics import Boxes
from models import SIZES, NanoDet, average, on_tiles, network_name
from reference import reference

#: The number of frames that are kept: almost a minute.
COUNT = 400
#: One frame in this many is also looked at in tiles.
TILE_STEP = 4


def network(folder: Path, source: str) -> NanoDet:
    """Returns a source's network.

    Raises:
        FileNotFoundError: if it is not there.
    """
    height, width = SIZES[source]
    path = folder / f"nanodet-{width}x{height}.onnx"
    if not path.exists():
        raise FileNotFoundError(f"{path}: no network; `run` makes it")
    return NanoDet(path)


def offline(east: NanoDet, images: list[NDArray[np.uint8]], whole: list[Boxes]) -> list[Boxes]:
    """Finds boxes by the largest network, in whole images and in the tiles of some."""
    opinions = list(whole)
    for number in range(0, len(images), TILE_STEP):
        opinions[number] = np.concatenate([whole[number], on_tiles(east, images[number])])
    return [average(it) for it in opinions]


def main() -> int:
    """Records."""
    if len(sys.argv) not in (3, 4):
        print(__doc__, file=sys.stderr)
        return 2
    try:
        kept = Path(sys.argv[3]) if len(sys.argv) == 4 else KEPT
        return record(Path(sys.argv[1]), Path(sys.argv[2]), kept)
    except OSError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


def record(folder: Path, models: Path, out: Path) -> int:
    """Records what each network finds.

    Raises:
        OSError: if there are no frames or no network, or the file cannot be written.
    """
    if not (files := jpegs(folder)[:COUNT]):
        raise FileNotFoundError(f"{folder}: no frames; `run` makes them")
    images = [decode(file.read_bytes()) for file in files]
    found, seconds = {}, {}
    for source in SOURCES:
        model = network(models, source)
        model.detect(images[0])  # the first is slower
        pairs = [model.timed(image) for image in images]
        found[source] = [boxes for boxes, _ in pairs]
        seconds[source] = [taken for _, taken in pairs]
        print(
            f"{source}: {network_name(source)}, {sorted(seconds[source])[len(images) // 2] * 1e3:.1f} ms"
        )
    people = reference(offline(network(models, "east"), images, found["east"]))
    kept = KeptDetections(
        RATE,
        [file.stat().st_size for file in files],
        {source: network_name(source) for source in SOURCES},
        seconds,
        found,
        people,
    )
    kept.save(out)
    print(f"{out}: {len(kept)} frames, {sum(map(len, people))} people, {out.stat().st_size} bytes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
