"""Finds where people are, by means that no operator has.

The largest network looks at tiles, and its boxes are joined over time. A box joins the track whose
last box it overlaps most. Gaps are filled, and tracks that are short or never sure are left out:
both need the future. Signs, cones and stones are left out too, because they stay in the same place
all the time.
"""

from __future__ import annotations

import numpy as np

from metrics import Boxes, overlaps

#: A track continues with a box that overlaps its last box by at least this much.
LEAST_OVERLAP = 0.25
#: A track ends if its last box is more than this many frames old.
GREATEST_GAP = 6
#: The least number of frames of a track.
LEAST_LENGTH = 5
#: The score that a track must reach at least once.
SURE = 0.5
#: A box is a thing if a box with this overlap is there in more than this share of the frames.
SAME_PLACE, GREATEST_SHARE = 0.6, 0.35
#: One frame in this many is looked at for things.
THING_STEP = 8

#: The boxes of one person, with their frames.
Track = list[tuple[int, Boxes]]


def reference(frames: list[Boxes]) -> list[Boxes]:
    """Returns boxes without scores for each frame."""
    people: list[list[Boxes]] = [[] for _ in frames]
    # If two tracks claim a person, the longer track has the person.
    for track in sorted(tracks(without_things(frames)), key=len, reverse=True):
        for (frame, box), (end, following) in zip(track, [*track[1:], track[-1]], strict=True):
            people[frame].append(box)
            for between in range(frame + 1, end):
                share = (between - frame) / (end - frame)
                people[between].append(box + (following - box) * share)
    return [_one_each(np.array([box[:4] for box in boxes]).reshape(-1, 4)) for boxes in people]


def _one_each(boxes: Boxes) -> Boxes:
    """Drops boxes that are in the same place as an earlier box."""
    chosen = boxes[:0]
    for box in boxes:
        if not len(chosen) or overlaps(box[None], chosen).max() < SAME_PLACE:
            chosen = np.vstack([chosen, box])
    return chosen


def without_things(frames: list[Boxes]) -> list[Boxes]:
    """Drops boxes of things that stand in the same place all the time."""
    looked_at = frames[::THING_STEP]
    candidates = np.concatenate(looked_at)
    shares = np.zeros(len(candidates))
    for boxes in looked_at:
        if len(boxes):
            shares += overlaps(candidates, boxes).max(axis=1) >= SAME_PLACE
    things = candidates[shares >= GREATEST_SHARE * len(looked_at)]
    return [
        boxes[overlaps(boxes, things).max(axis=1) < SAME_PLACE] if len(things) else boxes
        for boxes in frames
    ]


def tracks(frames: list[Boxes]) -> list[Track]:
    """Joins boxes over time."""
    ended: list[Track] = []
    following: list[Track] = []
    for number, boxes in enumerate(frames):
        ended += [it for it in following if number - it[-1][0] > GREATEST_GAP]
        following = [it for it in following if number - it[-1][0] <= GREATEST_GAP]
        free = set(range(len(boxes)))
        if following and len(boxes):
            shared = overlaps(np.array([it[-1][1] for it in following]), boxes)
            while shared.max() > LEAST_OVERLAP:
                i, j = np.unravel_index(np.argmax(shared), shared.shape)
                following[i].append((number, boxes[j]))
                free.discard(int(j))
                shared[i], shared[:, j] = -1.0, -1.0
        following += [[(number, boxes[j])] for j in sorted(free)]
    return [
        it
        for it in ended + following
        if len(it) >= LEAST_LENGTH and max(box[4] for _, box in it) >= SURE
    ]
