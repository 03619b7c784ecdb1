"""Checks that the checks of this folder can fail: each fault is put into a copy, and its check must then fail.

Prints a line for each. Exit code 1: a check passed in spite of its fault.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).resolve().parent


class SeededFault(NamedTuple):
    """A line that is changed, and the check that must fail."""

    file: str
    line: str
    instead: str
    check: tuple[str, ...]


FAULTS = (
    SeededFault("planner.py", "return row >= self._wanted", "return row >= 1", ("-m", "unittest", "test_worlds")),
    SeededFault("sight.py", "if any(_crosses(eye, point, polygon)", "if False and any(_crosses(eye, point, polygon)", ("-m", "unittest", "test_worlds")),
    SeededFault("jaywalking.py", "LATERAL, DECELERATION = 7.0, 7.5", "LATERAL, DECELERATION = 6.5, 7.5", ("-m", "unittest", "test_worlds")),
    SeededFault("swerve.py", "nanos(response), None", "nanos(response + 0.2), None", ("-m", "unittest", "test_worlds")),
    SeededFault("scenes.py", "return not stops and", "return False and", ("-m", "unittest", "test_worlds")),
    SeededFault("drive.py", "RANGES = (39.0, 57.0)", "RANGES = (30.0, 40.0)", ("cells.py", "--sample", "30")),
    SeededFault("drive.py", '"guard": lambda: Fused(Guard(PARAMETERS))', '"guard": lambda: Fused(Constant(3.0))', ("drives.py", "--drives", "60", "--approach", "guard")),
)  # fmt: skip


def is_noticed(fault: SeededFault) -> bool:
    """Returns whether the check fails with the fault."""
    with tempfile.TemporaryDirectory(prefix="fuseline-worlds-") as folder:
        root = Path(folder)
        copy = root / "evaluation/python/worlds"
        shutil.copytree(HERE, copy, ignore=shutil.ignore_patterns("__pycache__"))
        # The recorded networks and the paper's table stand elsewhere in the tree.
        (root / "testkit").symlink_to(HERE.parents[2] / "testkit")
        shutil.copy(HERE.parents[1] / "paper.json", root / "evaluation")
        text = (copy / fault.file).read_text()
        if text.count(fault.line) != 1:
            raise SystemExit(f"{fault.file} has not once {fault.line!r}")
        (copy / fault.file).write_text(text.replace(fault.line, fault.instead))
        done = subprocess.run(
            [sys.executable, *fault.check], cwd=copy, capture_output=True, text=True
        )
        if done.returncode not in (0, 1):
            raise SystemExit(f"{fault.file}: {done.stderr}")
        return done.returncode == 1


def main() -> int:
    """Tries each fault."""
    missed = 0
    for fault in FAULTS:
        noticed = is_noticed(fault)
        missed += not noticed
        print(
            f"{'noticed' if noticed else 'MISSED':<8}{fault.file}: {fault.instead.splitlines()[0].strip()}",
            flush=True,
        )
    print(f"{len(FAULTS) - missed} of {len(FAULTS)} faults are noticed")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
