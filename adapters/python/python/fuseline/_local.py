"""Computes messages on board."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from fuseline._errors import ConfigError
from fuseline._fuseline import nanoseconds
from fuseline._processes import WorkerProcess
from fuseline._threads import DaemonThreads
from fuseline._wiring import check_count, check_function, check_takes, is_async

if TYPE_CHECKING:
    from fuseline._judge import Duration

M = TypeVar("M")
V = TypeVar("V")

_log = logging.getLogger("fuseline")


class Local(Generic[M, V]):
    """Describes how messages are computed on board.

    Make one with `task`, `threads`, `threads_of` or `processes`. No decision aborts a computation
    (F7), because it may keep state. An exception is a failure (F4).
    """

    def __init__(
        self,
        compute: Callable[..., Any],
        make: Callable[[int], DaemonThreads] | None,
        at_once: int,
        deadline: Duration | None,
        waiting: int | None,
        skip_answered: bool,
        may_lose_results: bool = False,
        replaceable: int = 0,
    ) -> None:
        check_count(at_once, 1, "local computations at once")
        if waiting is not None:
            check_count(waiting, 0, "messages that wait for local")
        if deadline is not None and nanoseconds(deadline) == 0:
            raise ConfigError(
                "local's deadline is 0, so every message would be refused; give a longer one"
            )
        if may_lose_results and deadline is None:
            raise ConfigError(
                "a local whose results can be lost needs a deadline, so that a loss is noticed"
            )
        self._compute = compute
        self._make = make
        #: Computes one message. A coroutine function that runs on the loop is not wrapped.
        self._run: Callable[[M, int], Awaitable[V]] = compute if make is None else self._run_apart
        self._pool: DaemonThreads | None = None
        #: The processes that the threads wait for, if any.
        self._processes: list[WorkerProcess] = []
        #: The computations of the threads, by timestamp.
        self._running: dict[int, asyncio.Future[Any]] = {}
        self.replaceable = replaceable
        self.at_once = at_once
        self.deadline = None if deadline is None else nanoseconds(deadline)
        self.waiting = waiting
        self.skip_answered = skip_answered
        self.may_lose_results = may_lose_results

    @classmethod
    def task(
        cls,
        compute: Callable[[M, int], Awaitable[V]],
        *,
        at_once: int = 1,
        deadline: Duration | None = 1.0,
        waiting: int | None = None,
        skip_answered: bool = False,
        may_lose_results: bool = False,
    ) -> Local[M, V]:
        """Computes with a coroutine function, in tasks of the loop; it must not block.

        Args:
            compute: Takes a message and its timestamp.
            at_once: The greatest number of computations at once.
            deadline: The time that one computation may take (F1): seconds as a float, a timedelta,
                or nanoseconds as `fuseline.ns`. With None, a message whose computation never ends
                stays open. A computation that runs for longer is logged and counted as lost, and it
                occupies its place until it ends.
            waiting: The number of messages that may wait for a computation; by default as many as
                the window. Beyond that, local fails for the oldest, which only clouds can then
                answer (D17).
            skip_answered: If True, a computation that has not begun is skipped once its message is
                answered.
            may_lose_results: True if a result can be lost on its way, as over a topic. A
                computation that has not ended within the deadline then counts as lost, and its
                place is free again. If False, it occupies its place until it ends.

        >>> import asyncio
        >>> async def double(number, timestamp):
        ...     await asyncio.sleep(0)
        ...     return 2 * number
        >>> local = Local.task(double, at_once=2, deadline=0.4)
        """
        if not is_async(compute):
            raise ConfigError(
                "Local.task takes an async function; give a plain one to Local.threads"
            )
        return cls(compute, None, at_once, deadline, waiting, skip_answered, may_lose_results)

    @classmethod
    def threads(
        cls,
        compute: Callable[[M, int], V],
        *,
        workers: int = 1,
        deadline: Duration | None = 1.0,
        waiting: int | None = None,
        skip_answered: bool = False,
    ) -> Local[M, V]:
        """Computes with a plain function, which may block, in threads of the operator's own.

        The arguments are as for `task`; `workers` computations run at once. Python does not wait
        for these threads when it ends.

        >>> local = Local.threads(lambda number, timestamp: 2 * number, workers=2)
        """
        _plain(compute, "Local.threads")

        def make(workers: int) -> DaemonThreads:
            return DaemonThreads(lambda: compute, workers, "fuseline-local")

        return cls(compute, make, workers, deadline, waiting, skip_answered)

    @classmethod
    def threads_of(
        cls,
        make: Callable[[], Callable[[M, int], V]],
        *,
        workers: int = 1,
        deadline: Duration | None = 1.0,
        waiting: int | None = None,
        skip_answered: bool = False,
        replaceable: int | None = None,
    ) -> Local[M, V]:
        """Computes in threads, each with a function of its own that `make` returns.

        So each function may keep state, such as a model that was loaded. The arguments are as for
        `threads`. A thread whose computation exceeds the deadline is replaced, and `make` is called
        again for the new thread. Up to `replaceable` such threads may still run; by default as many
        as there are workers.

        >>> def load():
        ...     model = {"gain": 2}  # loaded once in each thread
        ...     return lambda number, timestamp: model["gain"] * number
        >>> local = Local.threads_of(load, workers=2)
        """
        check_function(make, "make")
        if replaceable is not None:
            check_count(replaceable, 0, "computations that may be replaced")

        def threads(workers: int) -> DaemonThreads:
            return DaemonThreads(make, workers, "fuseline-local")

        most = workers if replaceable is None else replaceable
        return cls(make, threads, workers, deadline, waiting, skip_answered, replaceable=most)

    @classmethod
    def processes(
        cls,
        compute: Callable[[M, int], V],
        *,
        workers: int = 1,
        deadline: Duration | None = 1.0,
        waiting: int | None = None,
        skip_answered: bool = False,
    ) -> Local[M, V]:
        """Computes with a plain function in processes of the operator's own.

        The function, the messages and the results are pickled. The processes start with the
        operator. If one dies, its computation fails, and a new process takes its place. A process
        that still computes a second after the operator has ended is killed. The arguments are as
        for `task`; `workers` computations run at once.

        >>> import math
        >>> local = Local.processes(math.hypot, workers=2)
        """
        _plain(compute, "Local.processes")

        processes: list[WorkerProcess] = []

        def worker() -> WorkerProcess:
            processes.append(WorkerProcess(compute))
            return processes[-1]

        def make(workers: int) -> DaemonThreads:
            processes.clear()
            return DaemonThreads(worker, workers, "fuseline-local")

        local = cls(compute, make, workers, deadline, waiting, skip_answered)
        local._processes = processes
        return local

    async def _start(self) -> None:
        if self._make is None:
            return
        if self._pool is not None:
            raise ConfigError("this Local is used by two operators at once; make one for each")
        self._pool = self._make(self.at_once)
        try:
            # The first messages would otherwise wait until the processes have started.
            loop = asyncio.get_running_loop()
            await asyncio.gather(*(loop.run_in_executor(None, it.wait) for it in self._processes))
        except BaseException:
            self._stop()
            raise

    def _stop(self) -> None:
        if self._pool is not None:
            self._pool.stop()
        for process in self._processes:
            process.end()
        self._pool = None

    def _replace(self, timestamp: int) -> None:
        """Replaces the thread that computes this message."""
        future = self._running.get(timestamp)
        if future is None or self._pool is None:
            return
        try:
            self._pool.replace(future)
        except Exception:
            _log.exception("local's worker cannot be replaced")

    async def _run_apart(self, message: M, timestamp: int) -> V:
        """Computes one message in a thread, or in the process that the thread waits for."""
        if self._pool is None:
            raise RuntimeError("the operator has ended")
        self._running[timestamp] = future = self._pool.run(message, timestamp)
        try:
            return await future  # type: ignore[no-any-return]
        finally:
            self._running.pop(timestamp, None)


def _plain(compute: Callable[..., Any], where: str) -> None:
    if is_async(compute):
        raise ConfigError(f"{where} takes a plain function; give an async one to Local.task")
    check_function(compute, f"compute of {where}")
    check_takes(compute, "local", "message", "timestamp")


def local_of(local: Local[M, V] | Callable[[M, int], Any]) -> Local[M, V]:
    """Returns a `Local`. An async function runs in tasks, and a plain one in a thread."""
    if isinstance(local, Local):
        return local
    if is_async(local):
        return Local.task(local)
    return Local.threads(local)
