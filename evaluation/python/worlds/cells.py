"""The traffic jam's table with SUMO as the world: the paper's 90 cells, or a sample.

The motorcycle stands at eight places between two frames. A cell agrees if all eight end as in the paper. Prints the cells that
do not, and the metres left or the speed at impact of those that were driven. Exit code 1: a cell does not agree.
"""

from __future__ import annotations

import argparse
import json
import random
import sys
from concurrent.futures import ProcessPoolExecutor
from typing import NamedTuple

from drive import RATE, Result, drive
from network import ROOT
from scenes import Jam

PAPER = json.loads((ROOT / "evaluation/paper.json").read_text())["traffic_jam"]
APPROACHES = {"local": "local", "cloud": "cloud", "ours": "guard"}
PLACES = 8


class Cell(NamedTuple):
    """A speed in m/s, an approach, and the cloud's response in s."""

    speed: int
    approach: str
    response: float


def paper(cell: Cell) -> bool:
    """Returns whether it collides in the paper."""
    collides = PAPER["collides"][str(cell.speed)][cell.approach]
    return bool(collides[PAPER["cloud_response_s"].index(cell.response)])


def run(cell: Cell) -> list[Result]:
    """Drives a cell, from eight places."""
    results = []
    for place in range(PLACES):
        start = 100.0 + (2 * place + 1) / (2 * PLACES) * cell.speed / RATE
        results.append(
            drive(Jam(float(cell.speed), start=start), APPROACHES[cell.approach], cell.response)
        )
    return results


def main() -> int:
    """Drives the cells."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--sample", type=int, metavar="N", help="only this many cells, drawn again each time"
    )
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes [2]")
    options = parser.parse_args()
    cells = [
        Cell(int(speed), approach, response)
        for speed in PAPER["collides"] for approach in APPROACHES for response in PAPER["cloud_response_s"]
    ]  # fmt: skip
    if options.sample:
        cells = random.sample(cells, min(options.sample, len(cells)))
    differing = 0
    print(f"{'m/s':>4} {'approach':<9}{'response':>9}  {'the paper':<10}SUMO")
    with ProcessPoolExecutor(options.jobs) as pool:
        for cell, results in zip(cells, pool.map(run, cells), strict=True):
            collides = paper(cell)
            agrees = all((result.impact is not None) == collides for result in results)
            differing += not agrees
            print(
                f"{cell.speed:>4} {cell.approach:<9}{cell.response:>7.2f} s  {'collides' if collides else 'avoids':<10}"
                f"{ends(results)}{'' if agrees else '   DIFFERS'}"
            )
    print(f"{len(cells) - differing} of {len(cells)} cells end as in the paper")
    return 1 if differing else 0


def ends(results: list[Result]) -> str:
    """Returns the range of metres left, and of speeds at impact."""
    impacts = [result.impact for result in results if result.impact is not None]
    left = [result.left for result in results if result.impact is None and result.left is not None]
    parts = []
    if left:
        parts.append(f"{min(left):.1f} to {max(left):.1f} m left")
    if impacts:
        parts.append(f"hits at {min(impacts):.1f} to {max(impacts):.1f} m/s")
    return ", ".join(parts)


if __name__ == "__main__":
    sys.exit(main())
