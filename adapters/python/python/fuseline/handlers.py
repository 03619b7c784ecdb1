"""Message handlers that send less.

Each is put around a handler of your own, and nests in the others, as in
``by_content(lambda frame: frame.people > 0, every_nth(3, send))``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

__all__ = ["by_content", "every_nth"]

M = TypeVar("M")
Req = TypeVar("Req")


def every_nth(
    n: int, handler: Callable[[M, int], tuple[Req, float] | None], *, turn: int = 0
) -> Callable[[M, int], tuple[Req, float] | None]:
    """Of every ``n`` messages, only one makes a request.

    Clouds alternate if each has the same ``n`` and its own ``turn``. Messages count by their
    timestamps, those that the window refused among them.

    Args:
        n: 1 or more.
        handler: Looks at the messages that are left.
        turn: The number of the one message, from 0 to ``n - 1``.

    Raises:
        ValueError: ``n`` is less than 1, or ``turn`` is not among its numbers.
    """
    if n < 1:
        raise ValueError(f"one message in {n}: n must be 1 or more")
    if not 0 <= turn < n:
        raise ValueError(f"turn {turn}: it must be from 0 to {n - 1}")

    def handle(message: M, timestamp: int) -> tuple[Req, float] | None:
        return handler(message, timestamp) if timestamp % n == turn else None

    return handle


def by_content(
    is_wanted: Callable[[M], bool], handler: Callable[[M, int], tuple[Req, float] | None]
) -> Callable[[M, int], tuple[Req, float] | None]:
    """Only messages of which ``is_wanted`` is true make a request."""

    def handle(message: M, timestamp: int) -> tuple[Req, float] | None:
        return handler(message, timestamp) if is_wanted(message) else None

    return handle
