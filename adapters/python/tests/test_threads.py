"""Tests how threads, processes and connections are replaced, and what they keep."""

from __future__ import annotations

import asyncio
import gc
import logging
import threading
import time
import weakref
from collections.abc import Callable
from typing import Any

import pytest
from fuseline import (
    Call,
    Ending,
    Local,
    Operator,
    _remote,
)
from fuseline._remote import RemoteThread
from fuseline._threads import DaemonThreads


def hangs_once(release: threading.Event, made: list[Any]) -> Callable[[], Any]:
    def make() -> Any:
        made.append(None)
        if len(made) > 2:
            raise MemoryError("no room for another model")

        def compute(message: int, t: int) -> int:
            if message == 0:
                release.wait(30)
            return message

        return compute

    return make


@pytest.mark.parametrize(
    ("options", "words", "models"),
    [
        ({"replaceable": 0}, "it occupies its worker until it ends", 1),
        ({"replaceable": 1}, "another worker replaces it", 2),
        ({"workers": 2}, "local's worker cannot be replaced", 3),
    ],
)
def test_a_thread_that_hangs_is_replaced_as_often_as_allowed(
    caplog: pytest.LogCaptureFixture, options: dict[str, Any], words: str, models: int
) -> None:
    """A thread that hangs is replaced as often as allowed (D8, D15)."""
    release, made = threading.Event(), list[Any]()
    others = set(threading.enumerate())

    def computing() -> int:
        return sum(it.name == "fuseline-local" for it in set(threading.enumerate()) - others)

    async def main() -> None:
        local = Local.threads_of(hangs_once(release, made), deadline=0.05, **options)
        operator = Operator(local)
        async with operator:
            operator.write(0)
            lost = await operator.read()
            assert lost is not None and lost.ending is Ending.MISSED
            until = time.monotonic() + 30
            while words not in caplog.text and time.monotonic() < until:
                await asyncio.sleep(0.001)
            local._replace(99)
            release.set()
            operator.write(7)
            while (item := await operator.read()) is not None and item.value is None:
                operator.write(7)
            assert item is not None and item.value == 7
            # A replaced thread ends with its computation, so no more threads than workers are left.
            until = time.monotonic() + 30
            while computing() > local.at_once and time.monotonic() < until:
                await asyncio.sleep(0.001)
            assert computing() == local.at_once

    asyncio.run(main())
    assert words in caplog.text
    assert len(made) == models
    assert caplog.text.count("local's worker cannot be replaced") == words.startswith("local")


def test_threads_keep_nothing_and_are_replaced_only_in_a_computation() -> None:
    """Threads keep no values, and are replaced only during a computation (D8)."""
    made: list[Any] = []
    go_on = threading.Event()

    class WeakFrame:
        pass

    def make() -> Any:
        made.append(None)

        def compute(job: Any) -> Any:
            if job == "stop":
                raise StopIteration(job)
            if job is go_on:
                go_on.wait(30)
            return job

        return compute

    async def main() -> None:
        threads = DaemonThreads(make, 1, "test")
        frame = WeakFrame()
        alive = weakref.ref(frame)
        assert await threads.run(frame) is frame
        future = threads.run("a")
        assert await future == "a"
        del frame
        gc.collect()
        assert alive() is None, "a thread that waits keeps what it computed"
        threads.replace(future)
        assert len(made) == 1, "nothing was being computed"
        with pytest.raises(RuntimeError, match="it raised StopIteration"):
            await threads.run("stop")
        assert await threads.run("b") == "b"
        frame = WeakFrame()
        alive = weakref.ref(frame)
        await threads.run(frame)
        del frame
        until = time.monotonic() + 10
        while alive() is not None and time.monotonic() < until:
            await asyncio.sleep(0.001)
        assert alive() is None, "a thread that waits keeps what it computed"
        # A computation that is given up ends silently.
        errors: list[Any] = []
        asyncio.get_running_loop().set_exception_handler(lambda _, error: errors.append(error))
        given_up = threads.run(go_on)
        while given_up not in threads._running:
            await asyncio.sleep(0)
        given_up.cancel()
        go_on.set()
        assert await threads.run("c") == "c"
        assert not errors
        threads.stop()

    asyncio.run(main())


def test_a_connection_that_cannot_be_closed_is_reported_and_the_next_waits(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    class StuckPolicy:
        def infer(self, observation: Any) -> Any:
            return observation

        def close(self) -> None:
            raise OSError("it is stuck")

    async def main() -> None:
        remote = RemoteThread(StuckPolicy)
        assert await remote.infer(7, Call(0, 1.0)) == 7
        remote.close()
        remote.wait(30.0)
        for pause, ready in ((3600.0, False), (0.0, True)):
            monkeypatch.setattr(_remote, "PAUSE", pause)
            assert remote.is_ready() == ready

    with caplog.at_level(logging.DEBUG, "fuseline"):
        asyncio.run(main())
    assert "a remote policy could not be closed: it is stuck" in caplog.text
