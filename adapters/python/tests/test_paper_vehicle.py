"""Tests that the paper's vehicle has a control output at each tick, whichever part dies."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import fuseline
import pytest

EXAMPLE = Path(__file__).parents[1] / "examples/paper_vehicle"
CHAPTER = Path(__file__).parents[3] / "docs/book/src/use/pipelines.md"
COMMANDS = re.compile(r"^([a-z ]+): (\d+) of (\d+) ticks within (\d+) ms", re.M)


def vehicle(*options: str, of: tuple[str, ...] = (sys.executable, str(EXAMPLE))) -> str:
    ran = subprocess.run([*of, *options], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


@pytest.fixture(scope="module")
def each_killed() -> str:
    return vehicle("--seconds", "12", "--kill", "each")


def test_control_outputs_at_each_tick_whatever_dies(each_killed: str) -> None:
    """Control has an output at each of its ticks, whichever part dies (E1, E2, E4, E5)."""
    drives = COMMANDS.findall(each_killed)
    assert len(drives) == 60
    for rule, commands, ticks, slowest in drives:
        assert (commands, ticks) == ("240", "240"), rule
        assert int(slowest) <= 40, rule


def test_same_lines_as_in_rust(each_killed: str) -> None:
    """The lines match the chapter's table, which a Rust test compares with the Rust vehicle."""
    printed = vehicle()
    rows = [line for line in printed.splitlines() if line.startswith("| ")]
    assert len(rows) == 7
    for row in rows:
        assert row.removesuffix("|") in CHAPTER.read_text()
    in_rust = os.environ.get("FUSELINE_VEHICLE")
    if not in_rust:
        pytest.skip("FUSELINE_VEHICLE does not name the example paper_vehicle of fuseline")
    assert vehicle(of=(in_rust,)) == printed
    assert vehicle("--seconds", "12", "--kill", "each", of=(in_rust,)) == each_killed


def test_one_frame_is_answered_in_order(tmp_path: Path) -> None:
    """One frame's operators are answered in order and in time (E2)."""
    printed = vehicle("--seconds", "20", "--frame", "31", "--traces", str(tmp_path))
    life = re.findall(r"frame 31: (\w+) +from +(\d+) to +(\d+) ms", printed)
    names = ["detection", "tracking", "prediction", "planning", "control"]
    assert [name for name, *_ in life] == names
    ends = [int(end) for _, _, end in life]
    assert ends == sorted(ends) and ends[-1] <= 500
    for trace in tmp_path.iterdir():
        verdict = fuseline.check(trace)
        assert not verdict.violations, verdict
    assert {line.seq for line in fuseline.Trace(tmp_path / "planning.jsonl").lines} >= {31}


def test_an_option_that_makes_no_drive_is_refused() -> None:
    for options in (["--seconds", "3"], ["--kill", "the-driver"]):
        ran = subprocess.run(
            [sys.executable, str(EXAMPLE), *options], capture_output=True, text=True, check=False
        )
        assert ran.returncode == 2, ran.stderr
