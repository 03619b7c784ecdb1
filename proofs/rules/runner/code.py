"""What the shipped core does, by the program `proofs/runner/src/bin/rules`."""

from __future__ import annotations

import functools
import os
import subprocess
from pathlib import Path

from .text import FOLDER

ROOT = FOLDER.parent.parent


class Unbuilt(Exception):
    """The program could not be built or ended early; the message says why."""


def ask(lines: list[str]) -> list[str]:
    """The answer to each line."""
    done = subprocess.run(
        [_built()],
        input="".join(f"{line}\n" for line in lines),
        capture_output=True,
        text=True,
        check=False,
    )
    answers = done.stdout.splitlines()
    if done.returncode or len(answers) != len(lines):
        raise Unbuilt(done.stderr or f"{len(answers)} answers to {len(lines)} lines")
    return answers


@functools.cache
def _built() -> Path:
    """The program, built anew if something changed, unless the checks built it with all others."""
    if built_by_checks := os.environ.get("FUSELINE_BUILT"):
        return Path(built_by_checks) / "fuseline-rules"
    command = ["cargo", "build", "--locked", "--quiet", "-p", "fuseline-prove"]
    command += ["--bin", "fuseline-rules"]
    built = subprocess.run(command, cwd=ROOT, stderr=subprocess.PIPE, text=True, check=False)
    if built.returncode:
        raise Unbuilt(built.stderr)
    return ROOT / os.environ.get("CARGO_TARGET_DIR", "target") / "debug" / "fuseline-rules"
