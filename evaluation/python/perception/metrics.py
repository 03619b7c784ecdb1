"""Average precision of people, by frame and streaming.

*Streaming* follows Li, Wang and Ramanan, *Towards Streaming Perception* (2020): at each instant the
world is compared with the newest output that was sent by then.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

#: A box in each row: left, top, right, bottom in pixels. A detected box also has its score.
Boxes: TypeAlias = NDArray[np.float64]

#: COCO's thresholds of overlap (IoU).
THRESHOLDS = np.linspace(0.5, 0.95, 10)
#: COCO's recalls.
RECALLS = np.linspace(0.0, 1.0, 101)


class BoxMatches(NamedTuple):
    """States which of one frame's boxes are right."""

    #: The boxes' scores, the greatest first.
    scores: NDArray[np.float64]
    #: True if a box is right, by box and threshold.
    hits: NDArray[np.bool_]
    #: The number of people.
    people: int


class Precision(NamedTuple):
    """Average precision in percent."""

    #: A box is right if it overlaps a person's by half.
    ap50: float
    #: The mean over `THRESHOLDS`.
    ap: float


def overlaps(some: Boxes, others: Boxes) -> NDArray[np.float64]:
    """Returns the overlap (IoU) of each pair."""
    top_left = np.maximum(some[:, None, :2], others[None, :, :2])
    bottom_right = np.minimum(some[:, None, 2:4], others[None, :, 2:4])
    common = np.prod(np.clip(bottom_right - top_left, 0.0, None), axis=2)
    total = _areas(some)[:, None] + _areas(others)[None] - common
    return np.asarray(common / np.maximum(total, 1e-9))


def match(found: Boxes, truth: Boxes) -> BoxMatches:
    """Matches boxes with people as COCO does.

    Each box, by falling score, takes the free person that it overlaps most.
    """
    found = found[np.argsort(-found[:, 4], kind="stable")]
    hits = np.zeros((len(found), len(THRESHOLDS)), np.bool_)
    shared = overlaps(found, truth)
    # The people that a box may take: hardly ever more than one.
    candidates = [
        sorted(
            ((shared[i, j], int(j)) for j in np.flatnonzero(shared[i] >= THRESHOLDS[0])),
            reverse=True,
        )
        for i in range(len(found))
    ]
    for column, threshold in enumerate(THRESHOLDS):
        taken: set[int] = set()
        for i, options in enumerate(candidates):
            for overlap, j in options:
                if overlap < threshold - 1e-9:
                    break
                if j not in taken:
                    taken.add(j)
                    hits[i, column] = True
                    break
    return BoxMatches(found[:, 4], hits, len(truth))


def precision(frames: Iterable[BoxMatches]) -> Precision:
    """Returns the average precision over frames, interpolated at COCO's recalls."""
    frames = list(frames)
    people = sum(it.people for it in frames)
    scores = np.concatenate([it.scores for it in frames])
    if not people or not len(scores):
        return Precision(0.0, 0.0)
    hits = np.concatenate([it.hits for it in frames])[np.argsort(-scores, kind="stable")]
    right = np.cumsum(hits, axis=0)
    share = right / np.arange(1, len(hits) + 1)[:, None]
    envelope = np.maximum.accumulate(share[::-1], axis=0)[::-1]
    averages = []
    for column in range(len(THRESHOLDS)):
        at = np.searchsorted(right[:, column] / people, RECALLS)
        averages.append(np.append(envelope[:, column], 0.0)[np.minimum(at, len(hits))].mean())
    return Precision(float(averages[0]) * 100, float(np.mean(averages)) * 100)


def mean_overlap(found: Sequence[Boxes], truth: Sequence[Boxes]) -> float:
    """Returns the mean overlap (IoU) with the people that some box overlaps by half."""
    best = []
    for boxes, people in zip(found, truth, strict=True):
        if len(boxes) and len(people):
            most = overlaps(boxes, people).max(axis=0)
            best += [it for it in most if it >= THRESHOLDS[0]]
    return float(np.mean(best)) if best else float(THRESHOLDS[0])


def _areas(boxes: Boxes) -> NDArray[np.float64]:
    return np.asarray((boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1]))
