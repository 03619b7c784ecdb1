"""The paper's vehicle: whatever one part dies, control has an output at each of its ticks."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import fuseline

EXAMPLE = Path(__file__).parents[1] / "examples/paper_vehicle"
ROW = re.compile(
    r"^(local|cloud|fusion) (\S*) +(\d+) of +(\d+) +(\d+) ms +\d+ ms +\d+ ms +([\d.]+)", re.M
)


def vehicle(*options: str) -> str:
    ran = subprocess.run(
        [sys.executable, str(EXAMPLE), *options], capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def test_whatever_one_part_dies_control_has_an_output_at_each_tick() -> None:
    """E1, E2, E4, E5."""
    rows = ROW.findall(vehicle("--seconds", "20", "--kill", "each"))
    assert len({part for _, part, *_ in rows}) == 10 and len(rows) == 30
    for mode, part, commands, ticks, slowest, _ in rows:
        assert (commands, ticks) == ("400", "400"), f"{mode} without {part}"
        assert int(slowest) <= 40, f"{mode} without {part}"


def test_both_are_better_than_on_board_and_one_frame_has_its_answers_in_order(
    tmp_path: Path,
) -> None:
    """E2."""
    printed = vehicle("--seconds", "20", "--frame", "31", "--traces", str(tmp_path))
    accuracy = {mode: float(found) for mode, *_, found in ROW.findall(printed)}
    assert accuracy["fusion"] > accuracy["local"]
    life = re.findall(r"frame 31: (\w+) +(\d+) to +(\d+) ms", printed)
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
