"""Reads an operator's items or a join's sets, with several readers or in order (E9)."""

from __future__ import annotations

import asyncio
import contextlib
import time
import weakref
from collections import deque
from collections.abc import AsyncIterable, AsyncIterator, Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from fuseline._errors import ConfigError
from fuseline._fuseline import Reorderer, nanoseconds
from fuseline._item import Item, fields_of
from fuseline._loop import report_sharing
from fuseline._wiring import check_clock, check_count, check_function

if TYPE_CHECKING:
    from fuseline._judge import Duration

T = TypeVar("T")
V = TypeVar("V")


@dataclass(frozen=True)
class OutOfOrder:
    """Reports items that a reader in order passes over or drops."""

    #: The timestamps that had not ended when a later one was due; empty for a late item.
    passed_over: range | None
    #: The timestamp of an item that was dropped, because the timestamp had been passed over.
    late: int | None


class Items(Generic[T]):
    """Reads an operator's items, or a join's sets. `new_reader` shares them.

    A reader that lags by ``output_len`` blocks the others, and the operator with them. A reader to
    which no reference is left blocks nobody.

    >>> import asyncio
    >>> from fuseline import Operator
    >>> async def main():
    ...     async with Operator(lambda n, t: n * n) as squares:
    ...         squares.feed([1, 2])
    ...         one = Items(squares)
    ...         other = one.new_reader()
    ...         return [(await one.read()).value, (await other.read()).value]
    >>> asyncio.run(main())
    [1, 1]
    """

    def __init__(self, source: AsyncIterator[T], *, output_len: int = 16) -> None:
        check_count(output_len, 1, "an output_len")
        if not isinstance(source, AsyncIterable):
            raise ConfigError(
                f"Items reads an operator, a join or an async iterable, not {source!r}"
            )
        self._shared = _SharedSource(source.__aiter__(), output_len)
        self._waiting: deque[T] = deque()
        #: The number of tasks that read with this reader now, and whether it was logged that they
        #: share it.
        self._readers, self._is_reported = 0, False
        self._shared.add(self)

    def new_reader(self) -> Items[T]:
        """Returns another reader, for all items that come from now on."""
        reader: Items[T] = object.__new__(Items)
        reader._shared, reader._waiting = self._shared, deque()
        reader._readers, reader._is_reported = 0, False
        self._shared.add(reader)
        return reader

    def __aiter__(self) -> AsyncIterator[T]:
        return self

    async def __anext__(self) -> T:
        """Returns the next item or set. Ends after the last one."""
        while not self._waiting:
            if self._readers and not self._is_reported:
                self._is_reported = True
                report_sharing("Items")
            self._readers += 1
            try:
                await self._shared.pull(self._waiting)
            finally:
                self._readers -= 1
        message = self._waiting.popleft()
        self._shared.make_room()
        return message

    async def read(self) -> T | None:
        """Returns the next item or set, or None after the last one."""
        try:
            return await self.__anext__()
        except StopAsyncIteration:
            return None

    def in_order(
        self: Items[Item[V]],
        wait: Duration,
        reserve: Duration = 0.0,
        report: Callable[[OutOfOrder], None] | None = None,
        *,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> Items[Item[V]]:
        """Returns this reader in the order of timestamps. Call it before the first read.

        Args:
            wait: The time that an item waits for the items of earlier messages. At most 1,024 items
                wait. Then the missing timestamps are passed over.
            reserve: The wait also ends when only this time is left of the item's end-to-end
                deadline.
            report: Called with the timestamps that are passed over, and with each item that comes
                for one of them later.
            clock: The operators' clock.
        """
        check_clock(clock)
        if report is not None:
            check_function(report, "a report")
        reorderer = Reorderer(nanoseconds(wait), nanoseconds(reserve), clock())
        ordered = _ordered(self, reorderer, report, clock)
        return Items(ordered, output_len=self._shared.capacity)

    def last_only(self: Items[Item[V]]) -> Items[Item[V]]:
        """Returns this reader without preliminary items: one item for each message.

        Each item has its message's best value, even if that value was preliminary. A value that was
        read before is not returned again; the message's last item is then final and has no value.
        """
        return Items(_last_only(self), output_len=self._shared.capacity)


class _SharedSource(Generic[T]):
    """Reads a source for several readers. Any reader that needs an item reads it for all."""

    def __init__(self, source: AsyncIterator[T], capacity: int) -> None:
        self.source, self.capacity = source, capacity
        self._readers: set[weakref.ref[Items[T]]] = set()
        self._turn, self._room = asyncio.Lock(), asyncio.Event()
        #: A read that has begun, and then how the source has ended.
        self._reading: asyncio.Future[tuple[T] | None] | None = None
        self._is_over = False
        self._error: BaseException | None = None

    def add(self, reader: Items[T]) -> None:
        self._readers.add(weakref.ref(reader, self._gone))

    async def pull(self, waiting: deque[T]) -> None:
        """Reads the next item for all readers, unless another reader has just read one."""
        async with self._turn:
            if waiting:
                return
            # The slowest reader delays the others (E8).
            while any(len(it._waiting) >= self.capacity for it in self._all()):
                self._room.clear()
                await self._room.wait()
            read = await self._read()
            for reader in self._all():
                reader._waiting.append(read)

    async def _read(self) -> T:
        """Returns the next item. A reader that gives up leaves its read to the next reader."""
        if self._error is not None:
            raise self._error
        if self._is_over:
            raise StopAsyncIteration
        if self._reading is None:
            self._reading = asyncio.ensure_future(_next(self.source))
        await asyncio.wait({self._reading})
        reading, self._reading = self._reading, None
        try:
            read = reading.result()
        except asyncio.CancelledError as error:
            # The source was cancelled, not this reader.
            self._error = RuntimeError("the iterable that Items reads ended in CancelledError")
            raise self._error from error
        except BaseException as error:
            self._error = error
            raise
        if read is None:
            self._is_over = True
            raise StopAsyncIteration
        return read[0]

    def make_room(self) -> None:
        self._room.set()

    def _all(self) -> list[Items[T]]:
        readers = (it() for it in self._readers)
        return [it for it in readers if it is not None]

    def _gone(self, reader: weakref.ref[Items[T]]) -> None:
        self._readers.discard(reader)
        self.make_room()
        if not self._readers and self._reading is not None:
            # The read would otherwise take a message that nobody gets.
            with contextlib.suppress(RuntimeError):
                self._reading.cancel()


async def _next(source: AsyncIterator[T]) -> tuple[T] | None:
    try:
        return (await source.__anext__(),)
    except StopAsyncIteration:
        return None


async def _last_only(items: Items[Item[V]]) -> AsyncIterator[Item[V]]:
    #: At most one for each open message.
    preliminary: dict[int, Item[V]] = {}
    async for item in items:
        if not item.last:
            preliminary[item.timestamp] = item
            continue
        earlier = preliminary.pop(item.timestamp, None)
        if earlier is None:
            yield item
            continue
        # Other readers have the original item, so this changes a copy.
        whole = replace(item)
        whole._takes_the_place_of(earlier)
        yield whole


async def _ordered(
    items: Items[Item[V]],
    reorderer: Reorderer,
    report: Callable[[OutOfOrder], None] | None,
    clock: Callable[[], int],
) -> AsyncIterator[Item[V]]:
    reading: asyncio.Future[Item[V] | None] | None = None
    is_over = False
    try:
        while True:
            while (ready := reorderer.next_ready()) is not None:
                _, item, passed_over = ready
                if ready[0] == "item":
                    yield item
                elif report is not None:
                    report(_out_of_order(item, passed_over))
            if is_over:
                return
            if reading is None:
                reading = asyncio.ensure_future(items.read())
            due = reorderer.next_due
            left = None if due is None else max(due - clock(), 0) / 1e9
            await asyncio.wait({reading}, timeout=left)
            if not reading.done():
                reorderer.tick(clock())
                continue
            read, reading = reading.result(), None
            if read is None:
                is_over = True
                reorderer.end()
            else:
                reorderer.arrive(clock(), read.timestamp, read.last, fields_of(read.lineage), read)
    finally:
        if reading is not None:
            reading.cancel()


def _out_of_order(item: Item[Any] | None, passed_over: tuple[int, int] | None) -> OutOfOrder:
    if passed_over is None:
        return OutOfOrder(None, None if item is None else item.timestamp)
    return OutOfOrder(range(*passed_over), None)
