"""An operator for programs without an event loop: scripts, and control loops of their own."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Coroutine, Iterator
from concurrent.futures import Future
from types import TracebackType
from typing import Any, Generic, TypeVar

from fuseline._errors import ConfigError
from fuseline._item import Item, Lineage
from fuseline._operator import Operator

M = TypeVar("M")
V = TypeVar("V")
T = TypeVar("T")


class BlockingOperator(Generic[M, V]):
    """Runs an operator on an event loop in a thread of its own; use it as a context manager.

    Handles and an ``async def`` of local run in that thread. Its methods may be called from any
    other thread, also at once from several. At the end of the block it waits as `Operator` does.

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

    def __enter__(self) -> BlockingOperator[M, V]:
        if self._thread is not None:
            raise ConfigError("an operator is started once; make another")
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(
            target=_run, args=(self._loop,), name="fuseline-operator", daemon=True
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
        """Take a message in; return its timestamp.

        Raises:
            Full: if items wait to be read, as many as the operator's ``output_len``.
            Closed: if the operator takes no more messages.
        """
        return self._call(self._write(message, lineage))

    def read(self, timeout: float | None = None) -> Item[V] | None:
        """The next item; None if none comes within so many seconds, or none will come any more."""
        return self._call(self.operator.read(timeout))

    def __iter__(self) -> Iterator[Item[V]]:
        """The items, until the operator is closed and all are read."""
        while True:
            item = self.read()
            if item is None:
                return
            yield item

    def close(self) -> None:
        """Take no more messages; the items end once all are answered."""
        self._call(self._close())

    async def _write(self, message: M, lineage: Lineage | None) -> int:
        return self.operator.write(message, lineage)

    async def _close(self) -> None:
        self.operator.close()

    def _call(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine on the operator's loop, and wait for it."""
        if self._loop is None or self._loop.is_closed():
            coroutine.close()
            raise ConfigError("the operator does not run; use it with `with`")
        if threading.current_thread() is self._thread:
            coroutine.close()
            raise RuntimeError("a handler must not wait for its own operator")
        future: Future[T] = asyncio.run_coroutine_threadsafe(coroutine, self._loop)
        return future.result()

    def _end(self) -> None:
        loop, thread = self._loop, self._thread
        assert loop is not None and thread is not None
        loop.call_soon_threadsafe(loop.stop)
        thread.join()


def _run(loop: asyncio.AbstractEventLoop) -> None:
    asyncio.set_event_loop(loop)
    try:
        loop.run_forever()
        loop.run_until_complete(loop.shutdown_asyncgens())
    finally:
        loop.close()
