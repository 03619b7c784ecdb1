"""Whether a coroutine lets others run: how long it runs between two pauses."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Generator
from typing import Any


class TimedSteps(Coroutine[Any, Any, None]):
    """A coroutine for a task, which reports its long steps: how many nanoseconds each took.

    Args:
        coroutine: What runs.
        clock: Reads whole nanoseconds.
        longest: How long a step may take and is not reported.
        report: Learns how long a step took.
    """

    __slots__ = ("_clock", "_coroutine", "_longest", "_report")

    def __init__(
        self,
        coroutine: Coroutine[Any, Any, None],
        clock: Callable[[], int],
        longest: int,
        report: Callable[[int], None],
    ) -> None:
        self._coroutine, self._clock = coroutine, clock
        self._longest, self._report = longest, report

    def send(self, value: Any) -> Any:
        """Run it to its next pause."""
        clock = self._clock
        begin = clock()
        try:
            return self._coroutine.send(value)
        finally:
            took = clock() - begin
            if took > self._longest:
                self._report(took)

    def throw(self, *error: Any) -> Any:
        """Run it to its next pause from an exception, such as its cancellation."""
        clock = self._clock
        begin = clock()
        try:
            return self._coroutine.throw(*error)
        finally:
            took = clock() - begin
            if took > self._longest:
                self._report(took)

    def close(self) -> None:
        """End it where it is."""
        self._coroutine.close()

    def __await__(self) -> Generator[Any, Any, None]:
        """A task does not take it: it sends to the coroutine itself."""
        return self._coroutine.__await__()
