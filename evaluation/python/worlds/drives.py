"""Random drives in SUMO, the same for each approach: what collides, how hard, and who brakes for nothing.

Speeds, traffic, obstacles, what hides them, the network and the place in its recording are drawn by the drive's seed. A drive in
which an approach brakes hard although nothing would have been hit (*blind*) is *for nothing*. Intervals are Wilson's, of 95 %.
Exit code 1: with the guard's deadlines a drive hits what local alone does not hit.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial

from drive import APPROACHES, BEFORE, Result, drive
from network import Network, load_all
from scenes import Jam, Meeting, Scene

SITUATIONS: dict[str, Callable[[random.Random], Scene]] = {
    "traffic jam": Jam.draw,
    "red light": Meeting.draw_runner,
    "jaywalking": Meeting.draw_person,
}
NETWORKS = load_all()
#: A longer round trip counts as slow, in s.
SLOW = 0.5


@dataclass(frozen=True)
class Drive:
    """A drive by its seed, and how it ended with each approach."""

    seed: int
    situation: str
    network: str
    results: dict[str, Result]


def draw(seed: int) -> tuple[str, Scene, int, float]:
    """Returns what a seed draws: the situation, its scene, the network's number, and the start."""
    rng = random.Random(seed)
    situation = rng.choice(list(SITUATIONS))
    scene = SITUATIONS[situation](rng)
    number = rng.randrange(len(NETWORKS))
    return situation, scene, number, _place(rng, NETWORKS[number])


def _place(rng: random.Random, network: Network) -> float:
    """Returns from where a recording is played.

    Every other drive meets a slow or absent network, if the recording has one.
    """
    slow = [
        at
        for at, it in zip(network.sent, network.round_trips, strict=True)
        if it is None or it > SLOW
    ]
    if not slow or rng.random() < 0.5:
        return rng.uniform(0.0, network.length)
    return (rng.choice(slow) - BEFORE - rng.uniform(0.0, 10.0)) % network.length


def run(seed: int, approaches: Sequence[str] = tuple(APPROACHES)) -> Drive:
    """Drives a seed once with each approach."""
    results = {}
    for approach in approaches:
        situation, scene, number, offset = draw(seed)
        results[approach] = drive(scene, approach, NETWORKS[number], offset=offset)
    return Drive(seed, situation, NETWORKS[number].name, results)


def wilson(hits: int, of: int) -> tuple[float, float]:
    """Returns Wilson's interval of a share, at 95 %."""
    if not of:
        return 0.0, 1.0
    z, share = 1.959964, hits / of
    middle = share + z * z / (2 * of)
    width = z * math.sqrt(share * (1 - share) / of + z * z / (4 * of * of))
    below = 1 + z * z / of
    return max(0.0, (middle - width) / below), min(1.0, (middle + width) / below)


def summary(drives: Sequence[Drive], approach: str) -> dict[str, float]:
    """Returns the outcome of an approach."""
    results = [drive.results[approach] for drive in drives]
    harmless = [it for it in drives if it.results["blind"].impact is None]
    hits = [result.impact for result in results if result.impact is not None]
    nothing = sum(it.results[approach].decided is not None for it in harmless)
    return {
        "drives": len(drives),
        "collisions": len(hits),
        "energy": round(sum(impact * impact for impact in hits) / max(1, len(drives)), 2),
        "harmless": len(harmless),
        "for_nothing": nothing,
    }


def worse(drives: Sequence[Drive], approach: str) -> list[Drive]:
    """Returns the drives in which it collides and local alone does not."""
    return [
        it for it in drives
        if it.results[approach].impact is not None and it.results["local"].impact is None
    ]  # fmt: skip


def print_table(drives: Sequence[Drive], approaches: Sequence[str]) -> None:
    """Prints the table, for all drives and for each situation."""
    groups = {"all": list(drives)}
    groups |= {name: [it for it in drives if it.situation == name] for name in SITUATIONS}
    for group, members in groups.items():
        print(f"\n{group}: {len(members)} drives")
        head = ("collisions", "95 %", "m²/s² a drive", "worse than local", "brakes for nothing")
        print(f"{'':<10}{head[0]:>12}{head[1]:>18}{head[2]:>16}{head[3]:>18}{head[4]:>20}")
        for approach in approaches:
            row = summary(members, approach)
            low, high = wilson(int(row["collisions"]), len(members))
            nothing = f"{row['for_nothing']} of {row['harmless']}"
            print(
                f"{approach:<10}{row['collisions']:>12}{f'{low:.1%} to {high:.1%}':>18}{row['energy']:>16}"
                f"{len(worse(members, approach)):>18}{nothing:>20}"
            )


def show(seed: int, approach: str) -> None:
    """Prints one drive, step by step."""
    situation, scene, number, offset = draw(seed)
    print(
        f"drive {seed}: {situation}, {scene}\nover {NETWORKS[number].name} from {offset:.1f} s, {approach}"
    )
    print(drive(scene, approach, NETWORKS[number], offset=offset, log=print))


def main() -> int:
    """Runs the drives."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--drives",
        type=int,
        default=100,
        metavar="N",
        help="the number of drives, by seeds from 0 on [100]",
    )
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed [0]")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes [2]")
    parser.add_argument(
        "--approach",
        metavar="A,A,…",
        default=",".join(APPROACHES),
        help=f"only these, beside blind and local [{','.join(APPROACHES)}]",
    )
    parser.add_argument("--json", action="store_true", help="all drives as JSON")
    parser.add_argument(
        "--show", nargs=2, metavar=("SEED", "APPROACH"), help="one drive, output by output"
    )
    options = parser.parse_args()
    if options.show:
        seed, approach = options.show
        if approach not in APPROACHES or not seed.isdigit():
            parser.error(f"--show takes a seed and one of {', '.join(APPROACHES)}")
        show(int(seed), approach)
        return 0
    wanted = {"blind", "local", *options.approach.split(",")}
    if unknown := wanted - set(APPROACHES):
        parser.error(f"--approach {', '.join(sorted(unknown))}: there are {', '.join(APPROACHES)}")
    approaches = [name for name in APPROACHES if name in wanted]
    seeds = range(options.first, options.first + options.drives)
    with ProcessPoolExecutor(options.jobs) as pool:
        drives = list(pool.map(partial(run, approaches=approaches), seeds, chunksize=4))
    if options.json:
        json.dump([asdict(it) for it in drives], sys.stdout)
        print()
    else:
        print_table(drives, approaches)
    guarded = [name for name in ("guard", "expected") if name in approaches]
    unsafe = [it for name in guarded for it in worse(drives, name)]
    for it in unsafe:
        print(
            f"drive {it.seed} ({it.situation}, {it.network}) hits, and local does not",
            file=sys.stderr,
        )
    return 1 if unsafe else 0


if __name__ == "__main__":
    sys.exit(main())
