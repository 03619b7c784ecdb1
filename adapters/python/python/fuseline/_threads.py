"""Computes for an event loop in threads for which the interpreter does not wait at its end."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any

#: The waiting loop and future, and the arguments of the computation.
_Job = tuple[asyncio.AbstractEventLoop, "asyncio.Future[Any]", tuple[Any, ...]]


class DaemonThreads:
    """Runs threads, each with a function that ``make`` made for it.

    Unlike the threads of ``concurrent.futures`` they are daemons, so one that hangs does not keep
    the program from ending.
    """

    def __init__(self, make: Callable[[], Callable[..., Any]], count: int, name: str) -> None:
        self._make, self._name = make, name
        self._jobs: SimpleQueue[_Job | None] = SimpleQueue()
        self._lock = threading.Lock()
        #: The running computations, with True if the computation's thread was replaced.
        self._running: dict[asyncio.Future[Any], bool] = {}
        for _ in range(count):
            self._start(make())

    def run(self, *arguments: Any) -> asyncio.Future[Any]:
        """Returns a future on the running loop. If it is cancelled early, nothing is computed."""
        loop = asyncio.get_running_loop()
        future = loop.create_future()
        self._jobs.put((loop, future, arguments))
        return future

    def replace(self, future: asyncio.Future[Any]) -> bool:
        """Replaces the thread that computes this. That thread ends after its computation.

        Returns True if another thread was started.
        """
        with self._lock:
            if self._running.get(future, True):
                return False
        self._start(self._make())
        with self._lock:
            if future in self._running:
                self._running[future] = True
        return True

    def hung_len(self) -> int:
        """Counts the threads that were replaced and have not ended."""
        with self._lock:
            return sum(self._running.values())

    def stop(self) -> None:
        """Ends each thread after its current computation."""
        self._jobs.put(None)

    def _start(self, compute: Callable[..., Any]) -> None:
        threading.Thread(target=self._work, args=(compute,), name=self._name, daemon=True).start()

    def _work(self, compute: Callable[..., Any]) -> None:
        while True:
            job = self._jobs.get()
            if job is None:
                # For the next thread.
                self._jobs.put(None)
                return
            is_replaced = self._compute(compute, *job)
            # The thread would otherwise keep the values until the next job comes.
            del job
            if is_replaced:
                return

    def _compute(
        self,
        compute: Callable[..., Any],
        loop: asyncio.AbstractEventLoop,
        future: asyncio.Future[Any],
        arguments: tuple[Any, ...],
    ) -> bool:
        """Computes a job. Returns True if this thread was replaced in the meantime."""
        if future.cancelled():
            return False
        with self._lock:
            self._running[future] = False
        value: Any = None
        error: BaseException | None = None
        try:
            value = compute(*arguments)
        except StopIteration as stop:
            # A future cannot hold a StopIteration.
            error = RuntimeError(f"it raised {stop!r}")
        except BaseException as raised:
            error = raised
        with self._lock:
            is_replaced = self._running.pop(future)
        # If the loop has ended, nobody waits any more.
        with contextlib.suppress(RuntimeError):
            loop.call_soon_threadsafe(_settle, future, value, error)
        return is_replaced


def _settle(future: asyncio.Future[Any], value: Any, error: BaseException | None) -> None:
    if future.done():
        return
    if error is None:
        future.set_result(value)
    else:
        future.set_exception(error)
