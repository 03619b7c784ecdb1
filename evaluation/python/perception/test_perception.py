"""Compares the README of the example with the kept detections, and tests the metrics by hand."""

from __future__ import annotations

import tempfile
import unittest
from pathlib import Path
from typing import ClassVar

import fuseline
import numpy as np

from agreement import agreement, by_source, read
from detections import SOURCES, load
from emulation import STARTS
from metrics import Boxes, match, mean_overlap, overlaps, precision
from play import KeptDrive, MeasuredPolicies
from reference import reference
from table import Scores, compare, least_gain, mean

KEPT = load()


def boxes(*rows: tuple[float, ...]) -> Boxes:
    """Returns rows as boxes."""
    return np.array(rows, np.float64)


README = Path(__file__).with_name("README.md").read_text()
CHAPTER = Path(__file__).resolve().parents[3] / "docs/book/src/use/perception.md"


def _row_of_the_readme(name: str) -> list[str]:
    """Returns the figures of an approach in the README's table."""
    row = next(it for it in README.splitlines() if it.startswith(f"| {name} |"))
    return [it.strip() for it in row.split("|")[2:-1]]


class Metrics(unittest.TestCase):
    """Compares the metrics with figures that were worked out by hand."""

    def test_overlap_is_common_by_all(self) -> None:
        shared = overlaps(
            boxes((0, 0, 10, 10)), boxes((0, 0, 10, 10), (5, 0, 15, 10), (20, 0, 30, 10))
        )
        np.testing.assert_allclose(shared, [[1.0, 1 / 3, 0.0]])

    def test_a_person_is_found_once_by_the_better_score(self) -> None:
        person = boxes((0, 0, 10, 10))
        found = boxes((0, 0, 10, 9, 0.4), (0, 0, 10, 8, 0.9))
        scores, hits, people = match(found, person)
        self.assertEqual((scores.tolist(), people), ([0.9, 0.4], 1))
        # At 0.85 the first is no longer a hit, and the second finds the person.
        self.assertEqual(hits[:, 0].tolist(), [True, False])
        self.assertEqual(hits[:, 7].tolist(), [False, True])

    def test_precision_of_a_half_found_world(self) -> None:
        """Two of four people, then a wrong box: precision 1 up to recall 0.5, 0 beyond."""
        people = boxes((0, 0, 10, 10), (20, 0, 30, 10), (40, 0, 50, 10), (60, 0, 70, 10))
        found = boxes((0, 0, 10, 10, 0.9), (20, 0, 30, 10, 0.8), (80, 0, 90, 10, 0.7))
        self.assertAlmostEqual(precision([match(found, people)]).ap50, 51 / 101 * 100)
        nothing = match(np.zeros((0, 5)), people)
        self.assertEqual(precision([nothing]), (0.0, 0.0))

    def test_overlap_of_right_boxes_alone(self) -> None:
        people = [boxes((0, 0, 10, 10), (20, 0, 30, 10))]
        found = [boxes((0, 0, 10, 8, 0.9), (23, 0, 33, 4, 0.8))]
        self.assertAlmostEqual(mean_overlap(found, people), 0.8)

    def test_the_reference_fills_gaps_and_leaves_out_what_is_short(self) -> None:
        walker = [boxes((10 + 4 * k, 0, 30 + 4 * k, 50, 0.6)) for k in range(40)]
        walker[3] = np.zeros((0, 5))
        walker[5] = np.concatenate([walker[5], boxes((300, 0, 320, 50, 0.9))])
        sign = boxes((200, 0, 210, 40, 0.8))
        people = reference([np.concatenate([it, sign]) for it in walker])
        self.assertEqual([len(it) for it in people], [1] * 40)
        np.testing.assert_allclose(people[3], [[22, 0, 42, 50]])


class Comparison(unittest.TestCase):
    """Compares the approaches over ten starts of each drive."""

    rows: ClassVar[dict[str, list[Scores]]]

    @classmethod
    def setUpClass(cls) -> None:
        names = ["local alone", "first response", "patient, 500 ms", "progressive, 500 ms"]
        cls.rows = compare(KEPT, STARTS, [*names, "patient, Streaming", "progressive, Streaming"])

    def test_progressive_is_as_fresh_as_first_response_and_as_good_as_fusion(self) -> None:
        local, first, fusion, progressive, *_ = self.rows.values()
        self.assertGreaterEqual(least_gain(progressive, first, "sap50"), -1.0)
        self.assertGreaterEqual(least_gain(progressive, first, "sap"), -1.0)
        self.assertGreaterEqual(least_gain(progressive, fusion, "ap50"), -1.0)
        self.assertGreater(mean(fusion, "ap50"), mean(local, "ap50") + 5.0)
        self.assertLess(mean(fusion, "sap50"), mean(local, "sap50"))

    def test_streaming_is_fresher_than_local_at_each_start_and_as_good_as_fusion(self) -> None:
        local, streaming = self.rows["local alone"], self.rows["progressive, Streaming"]
        for figure in ("sap50", "sap", "fsap50", "fsap"):
            self.assertGreaterEqual(least_gain(streaming, local, figure), 0.0, figure)
        self.assertGreaterEqual(min(it.ap50 for it in streaming), 85.0)
        self.assertGreaterEqual(least_gain(streaming, self.rows["patient, 500 ms"], "ap50"), -1.0)

    def test_readme_has_these_figures(self) -> None:
        for name, scores in self.rows.items():
            with self.subTest(name):
                figures = [f"{mean(scores, it):.1f}" for it in ("ap50", "ap", "sap50", "sap")]
                local = self.rows["local alone"]
                gains = (least_gain(scores, local, it) for it in ("sap50", "fsap50"))
                row = _row_of_the_readme(name)
                self.assertEqual(figures, row[:4])
                self.assertEqual(", ".join(f"{it:+.1f}" for it in gains), row[-1])

    def test_the_chapter_repeats_rows_of_the_readme(self) -> None:
        rows = [it.strip("| ").split(" | ") for it in CHAPTER.read_text().splitlines()]
        repeated = [it for it in rows if it[0] in self.rows]
        self.assertGreaterEqual(len(repeated), 5)
        for name, *figures in repeated:
            whole = _row_of_the_readme(name)
            # The columns AP50, sAP50, fsAP50 and p50.
            self.assertEqual(figures, [whole[column] for column in (0, 2, 4, 7)], name)

    def test_traces_conform(self) -> None:
        for commit in ("eager", "progressive"):
            with self.subTest(commit=commit), tempfile.TemporaryDirectory() as folder:
                trace = Path(folder) / "run.jsonl"
                KeptDrive(KEPT, 2).fused(commit, MeasuredPolicies(KEPT).streaming, str(trace))
                verdict = fuseline.check(trace)
                self.assertTrue(verdict.conforms, verdict)
                self.assertEqual(verdict.judged, len(KEPT))


class ByHand(unittest.TestCase):
    """Tests the boxes that were drawn by hand."""

    def test_readme_states_how_well_they_agree(self) -> None:
        first, again = read()
        self.assertGreaterEqual((len(first), len(again)), (60, 10))
        twice = agreement(first, again)
        found = agreement(first, {frame: KEPT.reference[frame] for frame in first})
        wrong = found.counts[1] - found.agreed
        text = " ".join(README.split())
        for words in (
            f"{len(first)} frames, {len(again)} of them twice",
            f"{twice.agreed} of {twice.counts[1]} boxes agree",
            f"overlap (IoU) of {twice.overlap:.2f}",
            f"{found.agreed} of {found.counts[0]} people by hand are in the reference",
            f"overlap of {found.overlap:.2f}; {wrong} of its {found.counts[1]} boxes",
        ):
            self.assertTrue(words in text, words)
        for source, by_hand, by_reference in by_source(KEPT, first):
            figures = (by_hand.ap50, by_reference.ap50, by_hand.ap, by_reference.ap)
            self.assertEqual([f"{it:.1f}" for it in figures], _row_of_the_readme(source))


class KeptFile(unittest.TestCase):
    """Tests the file of the stored detections."""

    def test_they_are_small_and_come_back_as_they_were(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            again = Path(folder) / "again.jsonl.gz"
            KEPT.save(again)
            self.assertLessEqual(again.stat().st_size, 150_000)
            copy = load(again)
        for source in SOURCES:
            self.assertEqual(copy.seconds[source], KEPT.seconds[source])
            for one, other in zip(copy.found[source], KEPT.found[source], strict=True):
                np.testing.assert_array_equal(one, other)
        for one, other in zip(copy.reference, KEPT.reference, strict=True):
            np.testing.assert_array_equal(one, other)


if __name__ == "__main__":
    unittest.main()
