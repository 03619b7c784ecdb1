"""Has the code that tests of operators share: clouds and local with a runtime."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

from fuseline import Call, Item, Operator

Handle = Callable[[Any, Call], Awaitable[Any]]

MS = 0.001


def after(seconds: float) -> Handle:
    """Returns a cloud that answers `seconds` after it was called."""

    async def handle(request: Any, call: Call) -> Any:
        await asyncio.sleep(seconds)
        return request

    return handle


def local_after(seconds: float) -> Callable[[Any, int], Awaitable[Any]]:
    async def local(message: Any, t: int) -> Any:
        await asyncio.sleep(seconds)
        return f"{message} on board"

    return local


def ask(deadline: float) -> Callable[[Any, int], tuple[Any, float]]:
    return lambda message, t: (message, deadline)


async def items_of(operator: Operator[Any, Any], messages: Any) -> list[Item[Any]]:
    async with operator:
        operator.feed(list(messages) if isinstance(messages, str) else messages)
        return [item async for item in operator]


def stubborn(seconds: float, count: list[int]) -> Handle:
    """Returns a cloud whose first calls continue for `seconds` after they were cancelled."""

    async def handle(request: Any, call: Call) -> Any:
        if call.timestamp >= count[0]:
            return request
        count[1] += 1
        try:
            await asyncio.sleep(1)
        except asyncio.CancelledError:
            await asyncio.sleep(seconds)
        finally:
            count[1] -= 1

    return handle
