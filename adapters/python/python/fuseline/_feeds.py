"""Writes streams to an operator."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncGenerator, AsyncIterable, Iterable, Sized
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from fuseline._errors import Closed, Full
from fuseline._item import Item
from fuseline._join import Joined
from fuseline._loop import each

if TYPE_CHECKING:
    from fuseline._operator import Operator

M = TypeVar("M")

_log = logging.getLogger("fuseline")

#: The seconds after which it is logged that messages wait because nobody reads the items.
UNREAD_SECONDS = 5.0
#: The end of each message about unread items: the reason and the remedy.
_UNREAD = "and no item has been read: read the items within the block, `async for item in operator`"


class Feeds(Generic[M]):
    """Writes streams to an operator, each in a task of its own, and closes it after the last one.

    It reports a reader that takes no items while a stream waits for room.
    """

    def __init__(self, operator: Operator[M, Any]) -> None:
        self._operator, self._output = operator, operator._output
        #: The task of each stream, with True if the stream is known to end.
        self.tasks: dict[asyncio.Task[None], bool] = {}
        #: The first exception that a stream ended in.
        self.error: BaseException | None = None
        #: The number of items that had been read when the output was last found full.
        self._read_before = 0
        self._unread_timer: asyncio.TimerHandle | None = None

    def begin(self, messages: AsyncIterable[M] | Iterable[M]) -> None:
        """Writes each message of a stream in a task."""
        task = asyncio.get_running_loop().create_task(self._feed(messages))
        task.set_name(f"{self._operator.name}: feed")
        self.tasks[task] = isinstance(messages, Sized)
        task.add_done_callback(self._fed)

    def stop(self) -> None:
        """Cuts all streams off."""
        if self._unread_timer is not None:
            self._unread_timer.cancel()
        for task in self.tasks:
            task.cancel()

    async def end(self) -> None:
        """Ends the feeds. Raises an error if nobody has read an item by the block's end."""
        output = self._output
        if not self.tasks or self._operator._is_last or output.read_count or output.readers.waiters:
            return
        output.is_ending = True
        output.writers.wake()
        if finite := [task for task, is_finite in self.tasks.items() if is_finite]:
            await asyncio.wait(finite)
        if self.tasks and self.error is None:
            self.error = Closed(f"the block ended while messages were fed, {_UNREAD}")

    async def write_each(self, messages: AsyncIterable[M] | Iterable[M], written: list[int]) -> int:
        """Writes each message as soon as there is room, and counts them in `written`."""
        operator = self._operator
        async with contextlib.AsyncExitStack() as stack:
            if isinstance(messages, AsyncGenerator):
                await stack.enter_async_context(contextlib.aclosing(messages))
            async for message in each(messages):
                while not operator._has_room() and not operator._is_last:
                    self._watch_unread()
                    await self._output.writers.wait()
                lineage = message.lineage if isinstance(message, (Item, Joined)) else None
                operator.write(message, lineage)
                written[0] += 1
        return written[0]

    async def _feed(self, messages: AsyncIterable[M] | Iterable[M]) -> None:
        written, operator = [0], self._operator
        try:
            await self.write_each(messages, written)
        except Closed:
            self._cut_off(messages, written[0])
        except BaseException as error:
            # The stream has ended, perhaps because a task that it waits for was cancelled. Nobody
            # must wait for its messages.
            if not operator._is_over:
                self.error = self.error or error
                operator.close()
            elif not operator._is_stopped:
                self._cut_off(messages, written[0])
            if not isinstance(error, Exception):
                raise

    def _fed(self, task: asyncio.Task[None]) -> None:
        """Forgets a stream that has ended, and closes the operator after the last one."""
        del self.tasks[task]
        if not task.cancelled():
            # The error was stored and is raised at the end of the block.
            task.exception()
        if not self.tasks and not self._operator._is_last:
            self._operator.close()

    def _cut_off(self, messages: AsyncIterable[M] | Iterable[M], written: int) -> None:
        """Reports messages that were left over when the operator was closed."""
        name = self._operator.name
        if not isinstance(messages, Sized):
            _log.info("%s: closed while a stream was fed, after %d messages", name, written)
        elif (left := len(messages) - written) > 0:
            self._operator._arrivals.count_lost(left)
            _log.warning(
                "%s: closed while messages were fed: %d were taken, %d were not",
                name,
                written,
                left,
            )

    def _watch_unread(self) -> None:
        """Starts to watch for readers, if a stream waits because nobody has read so far."""
        output, loop = self._output, self._operator._home.loop
        if len(output.items) < output.limit or loop is None:
            return
        if output.is_ending and not output.readers.waiters:
            raise Full(f"{len(output.items)} items wait to be read, {_UNREAD}")
        if self._unread_timer is None:
            self._read_before = output.read_count
            self._unread_timer = loop.call_later(UNREAD_SECONDS, self._report_unread)

    def _report_unread(self) -> None:
        self._unread_timer = None
        if not self._output.writers.waiters:
            return
        is_unread = self._output.read_count == self._read_before
        self._watch_unread()
        if is_unread:
            _log.warning(
                "%s: %d items wait to be read, and none was read for %s s: no message is taken "
                "until one is read",
                self._operator.name,
                len(self._output.items),
                UNREAD_SECONDS,
            )
