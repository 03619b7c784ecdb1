"""Drives of emulated operators: the shipped machine among sources of random responses.

``python tests/drives.py FOLDER --drives 1000`` writes a fleet of them.
"""

from __future__ import annotations

import argparse
import heapq
import random
from pathlib import Path

from fuseline import Admitted, Cloud, Fusion, ns

#: The time between two messages.
PERIOD = 33_333_333
#: The deadline of a request.
DEADLINE = 100_000_000


def drive(seed: int, messages: int, operator: str = "perception") -> bytes:
    """Returns the trace of one drive, which is always the same for a seed."""
    chance = random.Random(seed)
    clouds = [Cloud(1, name="west"), Cloud(2, name="east")]
    fusion = Fusion(clouds, window=64, operator=operator, record=True)
    # Each drive has a different network, and at times none.
    medians = {1: chance.uniform(0.02, 0.08), 2: chance.uniform(0.04, 0.12)}
    later: list[tuple[int, int, int]] = []
    away = 0
    for t in range(messages):
        now = t * PERIOD + chance.randrange(1_000_000)
        while later and later[0][0] <= now:
            at, of, p = heapq.heappop(later)
            fusion.result(at, of, p)
        fusion.open(now, t)
        heapq.heappush(later, (now + chance.randrange(15_000_000, 30_000_000), t, 0))
        if chance.random() < 0.002:
            away = t + chance.randrange(300)
        for p, median in medians.items():
            _, admission = fusion.offer(now, t, p, ns(DEADLINE))
            if isinstance(admission, Admitted) and t >= away:
                response = int(median * chance.lognormvariate(0.0, 0.4) * 1e9)
                heapq.heappush(later, (now + response, t, p))
    while later:
        at, of, p = heapq.heappop(later)
        fusion.result(at, of, p)
    if fusion.next_due is not None:
        fusion.tick(fusion.now + DEADLINE)
    return fusion.take_trace()


def spoiled(trace: bytes) -> bytes:
    """Returns the drive with an output from a wrong source, which the rules do not allow."""
    head, emit, tail = trace.partition(b'{"ev":"emit"')
    line, end, rest = tail.partition(b"\n")
    p = b'"p":0}' if not line.endswith(b'"p":0}') else b'"p":1}'
    return head + emit + line[: line.rindex(b'"p"')] + p + end + rest


def write(folder: Path, drives: int, messages: int) -> list[Path]:
    """Writes a fleet: a trace for each drive, each with its own seed. Returns the paths."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for seed in range(drives):
        path = folder / f"drive-{seed:05}.jsonl"
        path.write_bytes(drive(seed, messages))
        paths.append(path)
    return paths


def main() -> None:
    """Writes a fleet and prints how large it is."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--drives", type=int, default=1000)
    parser.add_argument("--messages", type=int, default=2000)
    given = parser.parse_args()
    paths = write(given.folder, given.drives, given.messages)
    print(f"{len(paths)} drives, {sum(path.stat().st_size for path in paths):,} bytes")


if __name__ == "__main__":
    main()
