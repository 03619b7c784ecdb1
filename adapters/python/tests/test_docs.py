"""Tests that the programs in the documents do what the documents say."""

from __future__ import annotations

import doctest
import re
import subprocess
import sys
from pathlib import Path

import fuseline

README = Path(__file__).parents[1] / "README.md"
USE = Path(__file__).parents[3] / "docs/book/src/use"


def test_the_machines_own_example_runs() -> None:
    doc = fuseline.Fusion.__doc__
    assert doc is not None
    parser = doctest.DocTestParser()
    example = parser.get_doctest(doc, {}, "Fusion", None, None)
    assert example.examples
    assert doctest.DocTestRunner().run(example).failed == 0


def test_the_documents_code_runs(tmp_path: Path) -> None:
    each = [
        re.findall(r"```python\n(.*?)```", document.read_text(), re.DOTALL)
        for document in (README, USE / "python.md", USE / "pipelines.md", USE / "robot.md")
    ]
    assert all(each)
    blocks = [block for of_one in each for block in of_one]
    for place, block in enumerate(blocks):
        if block.startswith("# /// needs"):
            continue  # run by tests/engines
        script = tmp_path / f"block_{place}.py"
        script.write_text(block)
        ran = subprocess.run(
            [sys.executable, "-W", "error", script],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert ran.returncode == 0, ran.stderr
        if place == 0:
            *items, verdict = ran.stdout.splitlines()
            assert items == ["0 east red light by east", "1 east clear by east"]
            # On a busy host both clouds may answer at once, and west's result is then not recorded.
            assert re.fullmatch(r"run\.jsonl: conforms; 2 timestamps judged in \d+ lines", verdict)


def test_a_robot_whose_policy_server_dies_is_never_without_an_action(tmp_path: Path) -> None:
    example = README.parent / "examples/remote_policy.py"
    files = ["--trace", str(tmp_path / "arm.jsonl"), "--plot", str(tmp_path / "arm.png")]
    ran = subprocess.run(
        [sys.executable, str(example), "--seconds", "3", *files],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    assert "90 actions in 90 ticks" in ran.stdout
    lines = fuseline.Trace(tmp_path / "arm.jsonl").lines
    emitted = [line.p for line in lines if line.ev == "emit"]
    assert len(emitted) == 90
    # The server was dead for at least a third of the time.
    assert set(emitted[32:60]) == {0}
    assert (tmp_path / "arm.png").read_bytes().startswith(b"\x89PNG")


def test_the_costs_are_measured() -> None:
    bench = README.parent / "benches/cost.py"
    words = ["--messages", "50", "--rounds", "1"]
    ran = subprocess.run(
        [sys.executable, bench, *words], capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.count(" times") == 2
