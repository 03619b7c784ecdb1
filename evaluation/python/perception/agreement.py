"""Holds the reference against boxes that were drawn by hand, and these against each other.

    python agreement.py [--annotations FILE.json]

The file has boxes by frame: `first` all of them, `again` some a second time, drawn without a look
at the first.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from detections import KEPT, SOURCES, KeptDetections, load
from metrics import THRESHOLDS, Boxes, Precision, match, overlaps, precision

ANNOTATIONS = Path(__file__).with_name("annotations.json")
#: The boxes of each frame.
Annotations: TypeAlias = dict[int, Boxes]


class BoxAgreement(NamedTuple):
    """The agreement of two sets of boxes."""

    #: Pairs that overlap by half.
    agreed: int
    #: The number of boxes in the one set, and in the other.
    counts: tuple[int, int]
    #: The mean overlap (IoU) of the pairs.
    overlap: float


def read(path: Path = ANNOTATIONS) -> tuple[Annotations, Annotations]:
    """Returns the first and the second pass.

    Raises:
        ValueError: if a box has no area.
    """
    passes = json.loads(path.read_text())
    return _pass(passes["first"]), _pass(passes["again"])


def agreement(one: Annotations, other: Annotations) -> BoxAgreement:
    """Compares two sets on the frames of the second one. Matches the boxes that overlap most."""
    shared: list[float] = []
    counts = [0, 0]
    for frame, boxes in other.items():
        counts[0] += len(one[frame])
        counts[1] += len(boxes)
        pairs = overlaps(one[frame], boxes)
        while pairs.size and pairs.max() >= THRESHOLDS[0]:
            i, j = np.unravel_index(np.argmax(pairs), pairs.shape)
            shared.append(float(pairs[i, j]))
            pairs[i], pairs[:, j] = -1.0, -1.0
    return BoxAgreement(len(shared), (counts[0], counts[1]), float(np.mean(shared or [0.0])))


def by_source(
    kept: KeptDetections, first: Annotations
) -> Iterator[tuple[str, Precision, Precision]]:
    """Rates each source on these frames: by hand, and by the reference."""
    for source in SOURCES:
        found = [kept.found[source][frame] for frame in first]
        by_hand = precision(map(match, found, first.values()))
        reference = (kept.reference[frame] for frame in first)
        yield source, by_hand, precision(map(match, found, reference))


def _pass(frames: dict[str, list[list[float]]]) -> Annotations:
    annotations = {}
    for frame, rows in frames.items():
        boxes = np.array(rows, np.float64).reshape(-1, 4)
        if not (boxes[:, :2] < boxes[:, 2:]).all():
            raise ValueError(f"frame {frame}: a box without area")
        annotations[int(frame)] = boxes
    return annotations


def _print(words: str, found: BoxAgreement) -> None:
    one, other = found.counts
    print(f"{words}: {found.agreed} agree of {one} and {other}, overlap {found.overlap:.2f}")


def main() -> int:
    """Compares."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--annotations", type=Path, default=ANNOTATIONS, metavar="FILE")
    options = parser.parse_args()
    kept = load(KEPT)
    try:
        first, again = read(options.annotations)
    except (OSError, KeyError, ValueError) as error:
        parser.error(f"{options.annotations}: {error}")
    if outside := [it for it in [*first, *again] if it >= len(kept) or it not in first]:
        parser.error(f"{options.annotations}: frame {outside[0]} is not annotated or not kept")
    print(f"{len(first)} frames by hand, {len(again)} of them twice")
    _print("by hand, first and again", agreement(first, again))
    reference = {frame: kept.reference[frame] for frame in first}
    _print("by hand and the reference", agreement(first, reference))
    for source, by_hand, by_reference in by_source(kept, first):
        print(
            f"{source}: AP50 {by_hand.ap50:.1f} by hand, {by_reference.ap50:.1f} by the reference;"
            f" AP {by_hand.ap:.1f}, {by_reference.ap:.1f}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
