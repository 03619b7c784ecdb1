"""What operators do with their event loop."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterable, AsyncIterator, Iterable
from typing import TypeVar

T = TypeVar("T")


def wake(event: asyncio.Event) -> None:
    """Wake all who wait for it now."""
    event.set()
    event.clear()


async def each(messages: AsyncIterable[T] | Iterable[T]) -> AsyncIterator[T]:
    """Messages of either kind, with a turn for others between two of a plain one."""
    if isinstance(messages, AsyncIterable):
        async for message in messages:
            yield message
        return
    for message in messages:
        yield message
        await asyncio.sleep(0)
