"""Runs the tests' coroutines in virtual time, so that no test waits."""

from __future__ import annotations

import asyncio
import os
import subprocess
import threading
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import pytest
from drives import drive, spoiled
from fuseline.testing import VirtualLoop

T = TypeVar("T")

#: The root of the project.
ROOT = Path(__file__).parents[3]
CORPUS = sorted((ROOT / "traces/corpus").glob("*.jsonl"))
ANNOTATED = sorted((ROOT / "traces/corpus/annotated").glob("*.jsonl"))
BAD = sorted((ROOT / "traces/corpus/bad").glob("*.jsonl"))
DOUBTS = sorted((ROOT / "traces/corpus/doubts").glob("*.jsonl"))


Run = Callable[[Callable[[VirtualLoop], Coroutine[Any, Any, T]]], T]


@pytest.fixture
def run() -> Run[Any]:
    """Runs a test's coroutine in virtual time, and checks that it leaves nothing behind."""

    def run(main: Callable[[VirtualLoop], Coroutine[Any, Any, T]]) -> T:
        files = open_files()
        loop = VirtualLoop()
        loop.set_debug(False)
        errors: list[Any] = []
        loop.set_exception_handler(lambda _, context: errors.append(context))
        try:
            result = loop.run_until_complete(main(loop))
            timers = [it for it in loop._scheduled if not it.cancelled()]  # type: ignore[attr-defined]
        finally:
            left = asyncio.all_tasks(loop)
            loop.run_until_complete(loop.shutdown_asyncgens())
            loop.close()
            assert not left, f"tasks were left behind: {left}"
        assert not errors, f"callbacks failed: {errors}"
        assert not timers, f"timers were left behind: {timers}"
        for thread in threading.enumerate():
            if thread.name.startswith("fuseline-"):
                thread.join(30)
                assert not thread.is_alive(), f"{thread.name} was left behind"
        assert open_files() <= files, "files were left open"
        return result

    return run


def open_files() -> int:
    """Returns the number of descriptors of this process."""
    files = Path("/proc/self/fd")
    return len(list(files.iterdir())) if files.is_dir() else 0


@pytest.fixture(scope="session")
def command() -> str:
    """Returns the path of the command `fuseline`, which was built from this project."""
    path = os.environ.get("FUSELINE_COMMAND")
    if not path:
        pytest.skip("FUSELINE_COMMAND does not name the command")
    return path


@contextmanager
def serving(command: str, *arguments: str) -> Iterator[str]:
    """Runs the command's own cloud or forwarder. Yields its URL."""
    words = [command, "serve", "--listen", "127.0.0.1:0", *arguments]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield process.stdout.readline().rsplit(maxsplit=1)[-1]
        finally:
            process.kill()


@pytest.fixture(scope="session")
def drives(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Returns the paths of 48 drives, some wrong or cut short, and of one missing file."""
    folder = tmp_path_factory.mktemp("fleet")
    for seed in range(48):
        trace = drive(seed, 200)
        if seed % 16 == 3:
            trace = spoiled(trace)
        if seed % 16 == 5:
            trace = trace[:-9]
        (folder / f"drive-{seed:02}.jsonl").write_bytes(trace)
    return [str(path) for path in sorted(folder.iterdir())] + [str(folder / "nowhere.jsonl")]
