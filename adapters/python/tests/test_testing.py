"""Tests that virtual time leaves nothing behind, and jumps only while nothing happens."""

from __future__ import annotations

import asyncio
import gc
import socket
import threading
import time
from collections.abc import AsyncIterator, Coroutine
from typing import Any

import pytest
from fuseline import testing
from fuseline.testing import VirtualLoop


def test_what_a_run_leaves_is_ended_and_its_loop_is_closed() -> None:
    ends: list[str] = []
    loops: list[asyncio.AbstractEventLoop] = []

    async def left_behind() -> None:
        try:
            await asyncio.sleep(3600)
        finally:
            # A task's cleanup may still need the loop.
            await asyncio.sleep(5)
            ends.append("task")

    async def fails() -> None:
        try:
            await asyncio.sleep(3600)
        finally:
            raise OSError("on purpose")

    async def numbers() -> AsyncIterator[int]:
        try:
            yield 1
        finally:
            await asyncio.sleep(5)
            ends.append("generator")

    async def main(loop: VirtualLoop) -> tuple[Any, ...]:
        loops.append(loop)
        source = numbers()
        tasks = [loop.create_task(it()) for it in (left_behind, fails)]
        assert await anext(source) == 1
        return source, tasks

    def makes(loop: VirtualLoop) -> Coroutine[Any, Any, tuple[Any, ...]]:
        # A future that is made before the loop runs belongs to the loop.
        assert asyncio.Future[None]().get_loop() is loop
        return main(loop)

    kept = testing.run(makes)
    assert sorted(ends) == ["generator", "task"]
    assert all(task.done() for task in kept[1])
    assert loops[0].is_closed()
    with pytest.raises(RuntimeError, match="no current event loop"):
        asyncio.get_event_loop_policy().get_event_loop()
    del kept
    gc.collect()


def test_an_error_of_a_run_is_raised_once_what_it_left_is_ended() -> None:
    tasks: list[asyncio.Task[None]] = []

    async def main(loop: VirtualLoop) -> None:
        tasks.append(loop.create_task(asyncio.sleep(3600)))
        raise KeyError("on purpose")

    with pytest.raises(KeyError, match="on purpose"):
        testing.run(main)
    assert tasks[0].cancelled()


def test_time_jumps_to_timers_alone() -> None:
    """Time does not jump while something is ready, and threads are awaited in real time."""
    ours, theirs = socket.socketpair()
    read: list[float] = []

    async def main(loop: VirtualLoop) -> None:
        assert loop.time() == 1000.0
        assert loop.time_ns() == 1_000_000_000_000
        loop.add_reader(ours, lambda: read.append(loop.time() + len(ours.recv(9)) / 100))
        loop.call_later(7.0, theirs.send, b"x")
        begin = time.monotonic()
        await asyncio.sleep(86_400.0)
        loop.remove_reader(ours)
        assert loop.time() == 87_400.0
        loop.block(0.25)
        assert loop.time_ns() == 87_400_250_000_000
        # No timer is set, so the loop waits for the other thread.
        done = threading.Event()
        threading.Timer(0.02, done.set).start()
        assert await asyncio.to_thread(done.wait, 30)
        assert loop.time() == 87_400.25
        assert time.monotonic() - begin >= 0.02

    testing.run(main)
    assert read == [1007.01]
    ours.close()
    theirs.close()


def test_timers_that_were_cancelled_are_forgotten() -> None:
    async def main(loop: VirtualLoop) -> int:
        earlier = loop.call_later(1e5, print)
        for _ in range(2000):
            loop.call_later(1e6, print).cancel()
        await asyncio.sleep(1)
        earlier.cancel()
        return len(loop._scheduled)  # type: ignore[attr-defined]

    assert testing.run(main) < 200


def test_a_loop_that_is_closed_sets_no_timer() -> None:
    loop = VirtualLoop()
    loop.close()
    with pytest.raises(RuntimeError, match="Event loop is closed"):
        loop.call_later(1.0, print)


def test_a_loop_without_timers_waits_no_longer_than_its_patience() -> None:
    loop = VirtualLoop(start=5.0, patience=0.001)
    assert loop.time() == 5.0
    assert loop._jumping.select(None) == []
    assert loop._jumping.select(3.0) == []
    assert loop.time() == 8.0
    loop.close()
