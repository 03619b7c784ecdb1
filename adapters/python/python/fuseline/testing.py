"""Runs tests in virtual time: the loop's clock jumps to the next timer instead of waiting.

An operator with the loop's ``clock``, and everything that it calls in the loop, runs for hours
within milliseconds, and every run is the same. Threads and sockets have no virtual time. If a
coroutine awaits one of them and no timer is set, the loop waits in real time.
"""

from __future__ import annotations

import asyncio
import heapq
import selectors
from collections.abc import Callable, Coroutine
from itertools import count
from typing import Any, TypeVar

__all__ = ["VirtualLoop", "run"]

T = TypeVar("T")


class _JumpingSelector(selectors.DefaultSelector):
    """Jumps to the next timer where another selector would sleep."""

    def __init__(self, patience: float) -> None:
        super().__init__()
        self.jumped = 0.0
        self._patience = patience

    def select(self, timeout: float | None = None) -> list[Any]:
        ready: list[Any] = super().select(0)
        if ready or timeout == 0:
            return ready
        if timeout is None:
            return list(super().select(self._patience))
        self.jumped += timeout
        return ready


class _OrderedTimer(asyncio.TimerHandle):
    """Orders timers that are due at the same instant by the order in which they were set."""

    __slots__ = ("number",)

    number: int

    def __lt__(self, other: Any) -> bool:
        return bool((self.when(), self.number) < (other.when(), other.number))


class VirtualLoop(asyncio.SelectorEventLoop):
    """Runs asyncio in virtual time. Close it as any other loop; `run` does so.

    Timers of one instant go off in the order in which they were set.

    Args:
        start: The clock's first reading, in seconds.
        patience: The longest single wait for a thread or a socket if no timer is set, in real
            seconds.
    """

    def __init__(self, start: float = 1000.0, patience: float = 5.0) -> None:
        self._start, self._jumping = start, _JumpingSelector(patience)
        self._timers = count()
        super().__init__(self._jumping)

    def time(self) -> float:
        """Returns the loop's time, in seconds."""
        return self._start + self._jumping.jumped

    def time_ns(self) -> int:
        """Returns the loop's time in nanoseconds, for the ``clock`` of a `fuseline.Operator`."""
        return round(self.time() * 1e9)

    def call_at(  # type: ignore[override]
        self, when: float, callback: Callable[..., Any], *args: Any, context: Any = None
    ) -> asyncio.TimerHandle:
        """Calls something at an instant of `time`."""
        self._check_closed()  # type: ignore[attr-defined]
        timer = _OrderedTimer(when, callback, args, self, context)
        timer.number = next(self._timers)
        heapq.heappush(self._scheduled, timer)  # type: ignore[attr-defined]
        timer._scheduled = True  # type: ignore[attr-defined]
        return timer

    def block(self, seconds: float) -> None:
        """Advances the time as code does that blocks the loop: nothing else runs meanwhile."""
        self._jumping.jumped += seconds


def run(main: Callable[[VirtualLoop], Coroutine[Any, Any, T]]) -> T:
    """Runs a coroutine in virtual time, as `asyncio.run` does in real time.

    Tasks that are left at its end are cancelled.

    Args:
        main: Returns the coroutine. It gets the loop, whose clock operators need.

    >>> from fuseline import Call, Local, Operator
    >>> async def slow(number: int, call: Call) -> str:
    ...     await asyncio.sleep(3600)
    ...     return f"{number} by the cloud"
    >>> async def main(loop: VirtualLoop) -> tuple[str, float]:
    ...     async def local(number: int, t: int) -> str:
    ...         return f"{number} on board"
    ...     operator = Operator(local, clock=loop.time_ns, greatest_deadline=7200.0)
    ...     operator.use_cloud(slow, lambda number, t: (number, 1800.0), str, priority=1)
    ...     async with operator:
    ...         operator.feed([20])
    ...         return [item.value async for item in operator][0], loop.time() - 1000.0
    >>> run(main)  # half an hour later
    ('20 on board', 1800.0)
    """
    loop = VirtualLoop()
    try:
        asyncio.set_event_loop(loop)
        return loop.run_until_complete(main(loop))
    finally:
        left = asyncio.all_tasks(loop)
        for task in left:
            task.cancel()
        loop.run_until_complete(asyncio.gather(*left, return_exceptions=True))
        loop.run_until_complete(loop.shutdown_asyncgens())
        asyncio.set_event_loop(None)
        loop.close()
