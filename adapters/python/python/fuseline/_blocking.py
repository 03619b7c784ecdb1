"""Runs an operator for programs without an event loop: scripts, and loops of their own."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import threading
from collections.abc import Coroutine, Iterator
from concurrent.futures import Future
from types import TracebackType
from typing import Any, Generic, TypeVar

from fuseline._errors import ConfigError, in_one_line
from fuseline._item import Item, Lineage
from fuseline._operator import Operator

M = TypeVar("M")
V = TypeVar("V")
T = TypeVar("T")

_log = logging.getLogger("fuseline")


class BlockingOperator(Generic[M, V]):
    """Runs an operator on an event loop in a thread of its own; use it as a context manager.

    Handles and an ``async def`` of local run in that thread. Its methods may be called from any
    other thread, even from several at once. At the end of the block it waits as `Operator` does.

    >>> def local(n, t):
    ...     return f"{n} on board"
    >>> with BlockingOperator(Operator(local)) as operator:
    ...     t = operator.write(20)
    ...     print(operator.read(timeout=5.0).value)
    20 on board
    """

    def __init__(self, operator: Operator[M, V]) -> None:
        if not isinstance(operator, Operator):
            raise ConfigError(f"a BlockingOperator runs an Operator, not {operator!r}")
        self.operator = operator
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None
        self._process = os.getpid()
        self._has_ended = threading.Event()
        #: True once it was logged that a call blocks another event loop.
        self._is_warned = False

    async def __aenter__(self) -> None:
        raise ConfigError("a BlockingOperator has a loop of its own: use `with`, or the Operator")

    async def __aexit__(self, *_: object) -> None:
        """Never called: `__aenter__` raises."""

    def __enter__(self) -> BlockingOperator[M, V]:
        if self._thread is not None:
            raise ConfigError("this operator was started before; make another")
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(
            target=_run,
            args=(self._loop, self.operator.name, self._has_ended),
            name="fuseline-operator",
            daemon=True,
        )
        self._thread.start()
        try:
            self._call(self.operator.start())
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        where: TracebackType | None,
    ) -> None:
        try:
            self._call(self.operator.__aexit__(kind, error, where))
        finally:
            self._end()

    def write(self, message: M, lineage: Lineage | None = None) -> int:
        """Accepts a message, and returns its timestamp.

        Raises:
            Full: if ``output_len`` items of the operator wait to be read.
            Closed: if the operator accepts no more messages.
        """
        return self._call(self._write(message, lineage))

    def read(self, timeout: float | None = None) -> Item[V] | None:
        """Returns the next item, or None after ``timeout`` seconds or after the last item.

        If it is interrupted, as by Ctrl-C, the next call gets the item.
        """
        handover: _Handover[V] = _Handover()
        try:
            return self._call(self._read(timeout, handover))
        except BaseException:
            item = handover.abandon()
            if item is not None and self._loop is not None:
                with contextlib.suppress(RuntimeError):
                    self._loop.call_soon_threadsafe(self.operator._output.give_back, item)
            raise

    def __iter__(self) -> Iterator[Item[V]]:
        """Yields the items until the operator is closed and all are read."""
        while True:
            item = self.read()
            if item is None:
                return
            yield item

    def close(self) -> None:
        """Accepts no more messages. The items end once all messages are answered."""
        self._call(self._close())

    async def _write(self, message: M, lineage: Lineage | None) -> int:
        return self.operator.write(message, lineage)

    async def _read(self, timeout: float | None, handover: _Handover[V]) -> Item[V] | None:
        item = await self.operator.read(timeout)
        if item is not None and not handover.take(item):
            self.operator._output.give_back(item)
            return None
        return item

    async def _close(self) -> None:
        self.operator.close()

    def _call(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Runs a coroutine on the operator's loop, and waits for it."""
        if self._loop is None or self._loop.is_closed():
            coroutine.close()
            raise ConfigError("the operator does not run; use it with `with`")
        if threading.current_thread() is self._thread:
            coroutine.close()
            raise RuntimeError("a handler must not wait for its own operator")
        if not self._is_warned and asyncio._get_running_loop() is not None:
            self._is_warned = True
            _log.warning(
                "%s: a BlockingOperator is used within a running event loop, which it holds up "
                "while it waits: in async code use the Operator itself, with `async with`",
                self.operator.name,
            )
        if os.getpid() != self._process:
            coroutine.close()
            raise RuntimeError("the operator runs in the process that was forked; make one here")
        future: Future[T] = asyncio.run_coroutine_threadsafe(coroutine, self._loop)
        try:
            return future.result()
        except BaseException:
            # The wait was interrupted, so nobody waits for the result any more.
            future.cancel()
            raise

    def _end(self) -> None:
        loop, thread = self._loop, self._thread
        assert loop is not None and thread is not None
        self._has_ended.set()
        loop.call_soon_threadsafe(loop.stop)
        thread.join()


class _Handover(Generic[V]):
    """Hands an item to a thread that may be interrupted while it waits."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._item: Item[V] | None = None
        self._is_abandoned = False

    def take(self, item: Item[V]) -> bool:
        """Hands the item over. Returns True if the thread still waits for it."""
        with self._lock:
            self._item = item
            return not self._is_abandoned

    def abandon(self) -> Item[V] | None:
        """Ends the wait, and returns the item that was on its way, if there was one."""
        with self._lock:
            self._is_abandoned = True
            return self._item


def _run(loop: asyncio.AbstractEventLoop, name: str, has_ended: threading.Event) -> None:
    asyncio.set_event_loop(loop)
    try:
        while not has_ended.is_set():
            _run_on(loop, name)
        loop.run_until_complete(loop.shutdown_asyncgens())
    finally:
        loop.close()


def _run_on(loop: asyncio.AbstractEventLoop, name: str) -> None:
    """Runs the loop until it is stopped, or until a call raises what ends a program."""
    try:
        loop.run_forever()
    except BaseException as error:
        # It cannot end the program, because this is not the main thread. It ends only its call.
        what = f"{type(error).__name__}: {in_one_line(error)}"
        _log.error("%s: %s in a call, which is a failure; the operator goes on", name, what)
