"""Keeps an operator in its loop and thread, and takes messages from other threads there."""

from __future__ import annotations

import asyncio
import logging
import os
import threading
import weakref
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from fuseline._errors import Closed, Full, in_one_line
from fuseline._item import Lineage

if TYPE_CHECKING:
    from fuseline._operator import Operator

M = TypeVar("M")

_log = logging.getLogger("fuseline")
_running_loop = asyncio._get_running_loop

#: Stands for the thread of an operator in a process that was forked.
_FORKED = -1


class Home:
    """Knows the loop and the thread that an operator runs in, and refuses calls from elsewhere."""

    def __init__(self) -> None:
        self.loop: asyncio.AbstractEventLoop | None = None
        self.thread: int | None = None

    def enter(self) -> None:
        """Makes the running loop and this thread the operator's."""
        self.loop = asyncio.get_running_loop()
        self.thread = threading.get_ident()
        _ENTERED.add(self)

    def check(self, method: str, *, is_over: bool) -> None:
        """Refuses a method in another thread or loop, or in a process that was forked."""
        if self.thread is None or threading.get_ident() == self.thread:
            self._check_loop(method, is_over=is_over)
            return
        if self.thread == _FORKED:
            raise RuntimeError(
                f"{method} was called in a forked process, but the operator runs in the process "
                "that started it; make an operator here"
            )
        if method == "write":
            remedy = "use write_threadsafe"
        else:
            remedy = f"let its loop do it: loop.call_soon_threadsafe(operator.{method})"
        raise RuntimeError(
            f"{method} was called in another thread than the operator's loop; {remedy}"
        )

    def _check_loop(self, method: str, *, is_over: bool) -> None:
        running = _running_loop()
        if self.loop is None or running is self.loop:
            return
        if self.loop.is_closed() and not is_over:
            raise Closed(
                f"{method} was called after the operator's loop ended; an operator has only one "
                "loop"
            )
        if running is not None and not is_over:
            raise RuntimeError(
                f"{method} was called in another loop than the operator's; an operator has only "
                "one loop"
            )


class Arrivals(Generic[M]):
    """Carries messages from other threads to an operator's loop, and counts those that are lost."""

    def __init__(self, operator: Operator[M, Any], limit: int) -> None:
        self._operator, self._limit = operator, limit
        self._lock = threading.Lock()
        self._on_their_way = 0
        #: The number of messages that the operator did not accept.
        self.not_taken = 0

    def send(
        self, loop: asyncio.AbstractEventLoop, message: M, lineage: Lineage | None
    ) -> Future[int]:
        """Sends a message to the loop. Returns a future of its timestamp.

        Raises:
            Full: if the limit of messages on their way is reached.
            Closed: if the loop has ended.
        """
        with self._lock:
            if self._on_their_way >= self._limit:
                self.not_taken += 1
                raise Full(f"{self._on_their_way} messages wait for the loop, which is held up")
            self._on_their_way += 1
        future: Future[int] = Future()
        try:
            loop.call_soon_threadsafe(self._take, message, lineage, future)
        except RuntimeError as error:
            with self._lock:
                self._on_their_way -= 1
                self.not_taken += 1
            raise Closed("the operator's loop has ended") from error
        return future

    def count_lost(self, count: int) -> None:
        """Counts messages of a stream that the operator did not accept."""
        with self._lock:
            self.not_taken += count

    def _take(self, message: M, lineage: Lineage | None, future: Future[int]) -> None:
        with self._lock:
            self._on_their_way -= 1
        try:
            future.set_result(self._operator.write(message, lineage))
        except Exception as error:
            with self._lock:
                self.not_taken += 1
                times = self.not_taken
            future.set_exception(error)
            if times & (times - 1) == 0:
                name, why = self._operator.name, in_one_line(error)
                _log.warning("%s: a message was not taken: %s (%d so far)", name, why, times)


#: The homes of running operators. In a forked process they are marked as foreign, because operators
#: run only where they were started.
_ENTERED: weakref.WeakSet[Home] = weakref.WeakSet()


def _forked() -> None:
    for home in list(_ENTERED):
        home.thread = _FORKED


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)
