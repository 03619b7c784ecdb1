"""Whether a coroutine lets others run: how long it runs between two pauses."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Generator
from typing import Any


class TimedSteps:
    """Awaits a coroutine, and reports how many nanoseconds each of its steps took."""

    __slots__ = ("_clock", "_coroutine", "_report")

    def __init__(
        self,
        coroutine: Coroutine[Any, Any, None],
        clock: Callable[[], int],
        report: Callable[[int], None],
    ) -> None:
        self._coroutine, self._clock, self._report = coroutine, clock, report

    def __await__(self) -> Generator[Any, Any, None]:
        coroutine, clock, report = self._coroutine, self._clock, self._report
        error: BaseException | None = None
        try:
            while True:
                begin = clock()
                try:
                    paused = coroutine.send(None) if error is None else coroutine.throw(error)
                except StopIteration:
                    return
                finally:
                    report(clock() - begin)
                error = None
                try:
                    yield paused
                except GeneratorExit:
                    raise
                except BaseException as raised:
                    error = raised
        finally:
            coroutine.close()
