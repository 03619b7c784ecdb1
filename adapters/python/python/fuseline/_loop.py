"""Helps operators to use their event loop."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterable, AsyncIterator, Iterable
from typing import TypeVar

T = TypeVar("T")


class WaiterList:
    """Lets coroutines wait to be woken. It costs nothing while nobody waits."""

    __slots__ = ("waiters",)

    def __init__(self) -> None:
        #: Who waits: always the same list.
        self.waiters: list[asyncio.Future[None]] = []

    async def wait(self) -> None:
        """Waits for the next `wake`."""
        waiter = asyncio.get_running_loop().create_future()
        self.waiters.append(waiter)
        try:
            await waiter
        except BaseException:
            # Nobody wakes it.
            if waiter in self.waiters:
                self.waiters.remove(waiter)
            raise

    def wake(self) -> None:
        """Wakes all who wait now."""
        for waiter in self.waiters:
            if not waiter.done():
                waiter.set_result(None)
        self.waiters.clear()


async def each(messages: AsyncIterable[T] | Iterable[T]) -> AsyncIterator[T]:
    """Yields messages of either kind, with a turn for others between two of a plain one."""
    if isinstance(messages, AsyncIterable):
        async for message in messages:
            yield message
        return
    for message in messages:
        yield message
        await asyncio.sleep(0)
