"""What the documents show is what happens."""

from __future__ import annotations

import doctest
import re
import subprocess
import sys
from pathlib import Path

import fuseline

README = Path(__file__).parents[1] / "README.md"


def test_the_machines_own_example_runs() -> None:
    doc = fuseline.Fusion.__doc__
    assert doc is not None
    parser = doctest.DocTestParser()
    example = parser.get_doctest(doc, {}, "Fusion", None, None)
    assert example.examples
    assert doctest.DocTestRunner().run(example).failed == 0


def test_the_readmes_code_runs(tmp_path: Path) -> None:
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL)
    assert blocks
    for place, block in enumerate(blocks):
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
            assert ran.stdout.splitlines() == [
                "0 forwarded cloud-1 red light by west",
                "1 forwarded cloud-1 clear by west",
                "run.jsonl: conforms; 2 timestamps judged in 15 lines",
            ]
