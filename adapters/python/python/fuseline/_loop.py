"""Helps operators to use their event loop."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterable, AsyncIterator, Coroutine, Iterable
from typing import Any, TypeVar

T = TypeVar("T")

_log = logging.getLogger("fuseline")

#: The longest sleep, in nanoseconds: a day.
LONGEST_SLEEP = 86_400_000_000_000


class WaiterList:
    """Lets coroutines wait to be woken. It costs nothing while nobody waits."""

    __slots__ = ("waiters",)

    def __init__(self) -> None:
        #: The futures that wait. The list object never changes.
        self.waiters: list[asyncio.Future[None]] = []

    async def wait(self) -> None:
        """Waits for the next `wake`."""
        waiter = asyncio.get_running_loop().create_future()
        self.waiters.append(waiter)
        try:
            await waiter
        except BaseException:
            # Nobody will wake this waiter any more.
            if waiter in self.waiters:
                self.waiters.remove(waiter)
            raise

    def wake(self) -> None:
        """Wakes all current waiters."""
        for waiter in self.waiters:
            if not waiter.done():
                waiter.set_result(None)
        self.waiters.clear()


class ReaderList(WaiterList):
    """Lets the readers of something wait, and logs once that several read it at once.

    Args:
        what: The name for people of the thing that they read.
    """

    __slots__ = ("_is_reported", "_what")

    def __init__(self, what: str) -> None:
        super().__init__()
        self._what = what
        self._is_reported = False

    def wait(self) -> Coroutine[Any, Any, None]:
        """Waits for the next `wake`."""
        # Each message waits here, and a second coroutine would slow each of them down.
        if self.waiters and not self._is_reported and any(not it.done() for it in self.waiters):
            self._is_reported = True
            report_sharing(self._what)
        return WaiterList.wait(self)


def report_sharing(what: str) -> None:
    """Logs that several readers read the same thing at once, so that each gets only a part."""
    _log.warning(
        "%s: several readers share the items, so each gets only some of them; for all items read "
        "Items, and give each reader its own new_reader()",
        what,
    )


async def each(messages: AsyncIterable[T] | Iterable[T]) -> AsyncIterator[T]:
    """Yields messages of either kind. A plain iterable gives other tasks turns in between."""
    if isinstance(messages, AsyncIterable):
        async for message in messages:
            yield message
        return
    for message in messages:
        yield message
        await asyncio.sleep(0)
