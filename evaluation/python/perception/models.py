"""NanoDet as ONNX: an image in, boxes of people out."""

from __future__ import annotations

import time
from pathlib import Path

import cv2
import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray

from metrics import Boxes, overlaps

#: The height and width of the input of each source's network.
SIZES = {"local": (160, 224), "west": (320, 416), "east": (576, 768)}
#: COCO's class of people.
PERSON = 0
#: Boxes that overlap by more than this belong to the same person.
GREATEST_OVERLAP = 0.5
#: The normalisation of the network's training: means and deviations of blue, green and red.
MEAN = np.array([103.53, 116.28, 123.675], np.float32)
DEVIATION = np.array([57.375, 57.12, 58.395], np.float32)
#: The sides of the cells of the three heads, in pixels of the input.
STRIDES = (8, 16, 32)
#: A side's distance is a distribution over this many cells.
BINS = 11
CLASSES = 80


def network_name(source: str) -> str:
    """Returns a source's network in words."""
    height, width = SIZES[source]
    return f"NanoDet {width}×{height}"


class NanoDet:
    """One network at one size, on one thread."""

    def __init__(self, path: Path) -> None:
        options = ort.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        self._session = ort.InferenceSession(path, options, providers=["CPUExecutionProvider"])
        self._height, self._width = self._session.get_inputs()[0].shape[2:]
        cv2.setNumThreads(1)

    def detect(self, image: NDArray[np.uint8], least: float = 0.2) -> Boxes:
        """Returns the boxes of people in an OpenCV image, by falling score."""
        height, width = image.shape[:2]
        is_smaller = self._height < height
        small = cv2.resize(
            image,
            (self._width, self._height),
            interpolation=cv2.INTER_AREA if is_smaller else cv2.INTER_LINEAR,
        )
        planes = ((small.astype(np.float32) - MEAN) / DEVIATION).transpose(2, 0, 1)
        heads = self._session.run(None, {"image": np.ascontiguousarray(planes)[None]})
        scale = np.array([width / self._width, height / self._height] * 2 + [1.0])
        return separate(self._decode([head[0] for head in heads], least) * scale)

    def timed(self, image: NDArray[np.uint8]) -> tuple[Boxes, float]:
        """Returns the boxes of people, and the processor time of finding them, in seconds."""
        start = time.process_time()
        boxes = self.detect(image)
        return boxes, time.process_time() - start

    def _decode(self, heads: list[NDArray[np.float32]], least: float) -> Boxes:
        """Turns the cells' scores and distances into boxes, in pixels of the input."""
        scores = sorted((it for it in heads if it.shape[1] == CLASSES), key=len, reverse=True)
        sides = sorted((it for it in heads if it.shape[1] == 4 * BINS), key=len, reverse=True)
        found = [np.zeros((0, 5))]
        for cell_scores, cell_sides, stride in zip(scores, sides, STRIDES, strict=True):
            cells = np.flatnonzero(cell_scores[:, PERSON] >= least)
            logits = cell_sides[cells].reshape(-1, 4, BINS)
            weights = np.exp(logits - logits.max(axis=2, keepdims=True))
            weights /= weights.sum(axis=2, keepdims=True)
            left, top, right, bottom = (weights @ np.arange(BINS) * stride).T
            rows, columns = np.divmod(cells, -(-self._width // stride))
            x, y = (columns + 0.5) * stride - 0.5, (rows + 0.5) * stride - 0.5
            box_scores = cell_scores[cells, PERSON]
            found.append(np.column_stack([x - left, y - top, x + right, y + bottom, box_scores]))
        return np.concatenate(found)


def on_tiles(network: NanoDet, image: NDArray[np.uint8], share: float = 0.6) -> Boxes:
    """Returns the people that a network finds in four overlapping tiles, slowly but thoroughly."""
    height, width = image.shape[:2]
    tile_height, tile_width = round(height * share), round(width * share)
    opinions = []
    for top in (0, height - tile_height):
        for left in (0, width - tile_width):
            tile = image[top : top + tile_height, left : left + tile_width]
            boxes = network.detect(np.ascontiguousarray(tile))
            boxes = boxes + np.array([left, top, left, top, 0.0])
            opinions.append(boxes[~_is_cut(boxes, left, top, tile.shape, image.shape)])
    return np.concatenate(opinions)


def separate(boxes: Boxes) -> Boxes:
    """Drops each box that overlaps a box of a greater score."""
    boxes = boxes[np.argsort(-boxes[:, 4], kind="stable")]
    chosen = []
    while len(boxes):
        best, boxes = boxes[:1], boxes[1:]
        chosen.append(best)
        boxes = boxes[overlaps(best, boxes)[0] < GREATEST_OVERLAP]
    return np.concatenate(chosen) if chosen else np.zeros((0, 5))


def average(boxes: Boxes) -> Boxes:
    """Averages boxes that overlap the best of them, by their scores (Solovyev et al. 2021)."""
    boxes = boxes[np.argsort(-boxes[:, 4], kind="stable")]
    means = []
    while len(boxes):
        is_same = overlaps(boxes[:1], boxes)[0] >= GREATEST_OVERLAP
        group = boxes[is_same]
        corners = (group[:, :4] * group[:, 4:]).sum(axis=0) / group[:, 4].sum()
        means.append(np.append(corners, group[0, 4]))
        boxes = boxes[~is_same]
    return np.array(means).reshape(-1, 5)


def _is_cut(
    boxes: Boxes, left: int, top: int, tile: tuple[int, ...], image: tuple[int, ...]
) -> NDArray[np.bool_]:
    """Returns whether a border inside the image cuts a box.

    The neighbouring tile has the whole box.
    """
    right, bottom = left + tile[1], top + tile[0]
    cut = np.zeros(len(boxes), np.bool_)
    if left > 0:
        cut |= boxes[:, 0] < left + 3
    if top > 0:
        cut |= boxes[:, 1] < top + 3
    if right < image[1]:
        cut |= boxes[:, 2] > right - 3
    if bottom < image[0]:
        cut |= boxes[:, 3] > bottom - 3
    return cut
