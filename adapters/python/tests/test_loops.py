"""Tests the operator on loops in real time, with threads, processes and a full disk."""

from __future__ import annotations

import asyncio
import os
import random
import signal
import subprocess
import sys
import threading
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import fuseline
import pytest
from fuseline import Call, Ending, Item, Local, Operator, check, check_observed


def _uvloop() -> asyncio.AbstractEventLoop:
    uvloop = pytest.importorskip("uvloop")
    loop: asyncio.AbstractEventLoop = uvloop.new_event_loop()
    return loop


LOOPS = [
    pytest.param(asyncio.SelectorEventLoop, id="asyncio"),
    pytest.param(_uvloop, id="uvloop"),
]
Make = Callable[[], asyncio.AbstractEventLoop]


def run(make: Make, main: Callable[[], Any]) -> Any:
    loop = make()
    try:
        return loop.run_until_complete(main())
    finally:
        loop.run_until_complete(loop.shutdown_asyncgens())
        loop.run_until_complete(loop.shutdown_default_executor())
        loop.close()


def square(n: int, t: int) -> int:
    return n * n


def process_of(message: object, t: int) -> int:
    return os.getpid()


@pytest.mark.parametrize("make", LOOPS)
def test_random_load_in_real_time_conforms(make: Make, tmp_path: Path) -> None:
    rng = random.Random(1)
    trace = tmp_path / "trace.jsonl"
    messages = 200

    async def flaky(request: int, call: Call) -> int:
        await asyncio.sleep(rng.choice([0, 0.001, 0.004, 0.01, 1]))
        if rng.random() < 0.2:
            raise OSError("broke")
        return request

    async def camera() -> AsyncIterator[int]:
        for message in range(messages):
            yield message
            await asyncio.sleep(rng.choice([0, 0.001, 0.002]))

    async def main() -> list[Item[int]]:
        on_board: Local[int, int] = Local.threads(lambda message, t: message, workers=2)
        operator: Operator[int, int] = Operator(on_board, trace=trace)
        for p in (3, 1, 2):
            operator.use_cloud(
                flaky,
                lambda message, t: (message, rng.choice([0.002, 0.005, 0.02])),
                lambda response: response,
                p,
                calls=2,
                limit=3,
            )
        async with operator:
            operator.feed(camera())
            return [item async for item in operator]

    items = run(make, main)
    assert sorted(item.timestamp for item in items) == list(range(messages))
    assert all(item.value == item.timestamp for item in items if item.ending is Ending.FORWARDED)
    verdict = check(trace)
    assert not verdict.violations, str(verdict)
    assert fuseline.replay(trace) == trace.read_bytes()
    # Recorded instants come from the operator's own clock, so only timers may be late.
    observed = check_observed(trace, tolerance=0, lateness=5.0)
    assert not observed.violations, str(observed)


@pytest.mark.parametrize("make", LOOPS)
def test_local_computes_in_threads_of_its_own(make: Make) -> None:
    names = set()

    def local(message: int, t: int) -> int:
        names.add(threading.current_thread().name.rsplit("_", 1)[0])
        if message == 3:
            raise ValueError("three")
        return message * 10

    async def main() -> list[Any]:
        operator: Operator[int, int] = Operator(Local.threads(local, workers=3))
        async with operator:
            operator.feed(range(5))
            return sorted([(item.timestamp, item.value) async for item in operator])

    assert run(make, main) == [(0, 0), (1, 10), (2, 20), (3, None), (4, 40)]
    assert names == {"fuseline-local"}


def test_local_computes_in_processes_of_its_own() -> None:
    async def main() -> None:
        operator: Operator[int, int] = Operator(Local.processes(square, deadline=None))
        async with operator:
            operator.feed(range(4))
            assert sorted([item.value async for item in operator if item.value is not None]) == [
                0,
                1,
                4,
                9,
            ]

    run(asyncio.SelectorEventLoop, main)


def test_a_process_that_dies_costs_its_own_message_alone(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        operator: Operator[str, int] = Operator(Local.processes(process_of, deadline=None))
        async with operator:
            operator.write("a")
            first = (await anext(operator)).value
            assert first is not None
            os.kill(first, signal.SIGKILL)
            operator.write("b")
            lost = await anext(operator)
            # The process's death may be noticed before or while the message is sent to it.
            if lost.ending is Ending.MISSED:
                assert lost.failures[0].source.name == "local"
                assert "died with code -9" in lost.failures[0].why
                operator.write("c")
                lost = await anext(operator)
            assert lost.value not in (None, first, os.getpid())

    run(asyncio.SelectorEventLoop, main)
    assert caplog.text.count("a process of local's died; others take over") == 1


FULL_DISK = """
import asyncio, logging, resource, sys
import fuseline

logging.basicConfig(format="%(levelname)s %(message)s")


async def main(trace):
    operator = fuseline.Operator(lambda n, t: n * n, window=100, trace=trace)
    values = []
    try:
        async with operator:
            # From here on no file may grow beyond this, as on a disk that is full.
            resource.setrlimit(resource.RLIMIT_FSIZE, (4096, resource.RLIM_INFINITY))
            operator.feed(range(100))
            values = [item.value async for item in operator]
    except fuseline.TraceError as error:
        print("raised", error)
    print("recording_error", operator.recording_error)
    assert sorted(values) == [n * n for n in range(100)]


asyncio.run(main(sys.argv[1]))
"""


def test_a_disk_that_fills_is_reported_and_the_operator_goes_on(tmp_path: Path) -> None:
    trace = tmp_path / "trace.jsonl"
    command = [sys.executable, "-c", FULL_DISK, str(trace)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    raised, recording_error = ended.stdout.splitlines()
    assert raised.startswith("raised the trace ends early: ")
    assert recording_error.startswith("recording_error ")
    assert "File too large" in raised
    assert "File too large" in recording_error
    assert (
        "ERROR the trace ends here, because it cannot be written; the operator continues (why="
        in ended.stderr
    )
    # The trace ends with a whole input (D10).
    assert 0 < trace.stat().st_size <= 4096
    assert trace.read_bytes().endswith(b"\n")
    fuseline.replay(trace)


def test_a_trace_ends_although_the_loops_threads_hang(tmp_path: Path) -> None:
    trace = tmp_path / "trace.jsonl"
    go_on = threading.Event()

    async def hang(request: int, call: Call) -> None:
        await asyncio.to_thread(go_on.wait)

    async def main() -> None:
        loop = asyncio.get_running_loop()
        loop.set_default_executor(ThreadPoolExecutor(1))
        operator: Operator[int, int] = Operator(square, trace=trace)
        operator.use_cloud(hang, lambda message, t: (message, 0.001), lambda it: 0, 1)
        try:
            async with operator:
                operator.feed(range(3))
                async for _ in operator:
                    pass
            assert check(trace).judged == 3
        finally:
            go_on.set()

    run(asyncio.SelectorEventLoop, main)


def test_a_trace_that_cannot_be_written_is_refused_at_the_start(tmp_path: Path) -> None:
    async def main() -> None:
        operator: Operator[int, int] = Operator(square, trace=tmp_path / "no" / "trace.jsonl")
        with pytest.raises(FileNotFoundError, match=r"No such file or directory: '.*trace\.jsonl"):
            await operator.start()
        full: Operator[int, int] = Operator(square, trace="/dev/full")
        with pytest.raises(OSError, match="No space left on device: '/dev/full'"):
            await full.start()

    run(asyncio.SelectorEventLoop, main)


def test_an_operator_can_be_read_along(tmp_path: Path) -> None:
    """A missed message is on the disk at once, while the operator runs."""
    trace = tmp_path / "trace.jsonl"

    def broken(message: int, t: int) -> int:
        raise ValueError("nothing")

    async def main() -> None:
        operator: Operator[int, int] = Operator(broken, trace=trace)
        async with operator:
            operator.write(1)
            assert (await anext(operator)).ending is Ending.MISSED
            while b'"miss"' not in trace.read_bytes():
                await asyncio.sleep(0.001)
            assert check(trace).judged == 1

    run(asyncio.SelectorEventLoop, main)
