"""Counts the instructions of a message on uvloop, by callgrind, and of the same by hand.

    python benches/instructions.py [--messages N] [--most TIMES]

It runs itself under valgrind, whose header a C compiler needs. Each message is computed on board
and in two clouds, which answer at once, as in `cost.py`. It fails if a message takes more than
`TIMES` as many as by hand.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

#: Valgrind counts from the one to the other.
MARKS = """
#include <valgrind/callgrind.h>
void begin(void) { CALLGRIND_START_INSTRUMENTATION; CALLGRIND_ZERO_STATS; }
void end(void) { CALLGRIND_DUMP_STATS; CALLGRIND_STOP_INSTRUMENTATION; }
"""
WARM_UP = 200


def inside(messages: int, library: str) -> None:
    """Runs the operator and then the same by hand; valgrind runs this."""
    import uvloop
    from cost import Sources, by_hand, one_by_one, operator

    marks = ctypes.CDLL(library)
    loop = uvloop.new_event_loop()
    sources = Sources((0, 0, 0))

    def run(ask: Callable[[int], Coroutine[Any, Any, Any]]) -> None:
        loop.run_until_complete(one_by_one(ask, WARM_UP))
        marks.begin()
        loop.run_until_complete(one_by_one(ask, messages))
        marks.end()

    # Valgrind is slow: nothing is late.
    ours = operator(sources, lag_warning=60.0)

    async def ask(message: int) -> None:
        ours.write(message)
        await anext(ours)

    loop.run_until_complete(ours.start())
    run(ask)
    run(lambda message: by_hand(sources, message))
    loop.run_until_complete(ours.__aexit__(None, None, None))
    loop.close()


def measured(messages: int) -> tuple[float, float]:
    """Instructions of a message: the operator's, and by hand."""
    with tempfile.TemporaryDirectory() as folder:
        out, source, library = (str(Path(folder, it)) for it in ("out", "marks.c", "marks.so"))
        Path(source).write_text(MARKS)
        compiler = os.environ.get("CC", "cc")
        subprocess.run([compiler, "-shared", "-fPIC", "-o", library, source], check=True)
        valgrind = ["valgrind", "--quiet", "--tool=callgrind", f"--callgrind-out-file={out}"]
        this = [sys.executable, __file__, "--inside", library, "--messages", str(messages)]
        subprocess.run(
            [*valgrind, "--instr-atstart=no", *this],
            check=True,
            env={**os.environ, "PYTHONHASHSEED": "0"},
        )
        ours, hand = (_total(Path(f"{out}.{number}")) / messages for number in (1, 2))
    return ours, hand


def _total(profile: Path) -> int:
    for line in profile.read_text().splitlines():
        name, _, count = line.partition(": ")
        if name == "totals":
            return int(count)
    raise ValueError(f"{profile} has no totals")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--messages", type=int, default=300)
    parser.add_argument("--most", type=float)
    parser.add_argument("--inside", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.inside:
        inside(args.messages, args.inside)
        return
    ours, hand = measured(args.messages)
    times = ours / hand
    print(f"a message: {ours:,.0f} instructions, {hand:,.0f} by hand, {times:.2f} times")
    if args.most is not None and not 0 < times <= args.most:
        sys.exit(f"error: above the bound of {args.most} times")


if __name__ == "__main__":
    main()
