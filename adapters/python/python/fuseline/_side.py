"""Makes side requests: calls whose answers change shared state and never become an output."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field, replace
from typing import Any

from fuseline._errors import in_one_line
from fuseline._fuseline import Gate, nanoseconds
from fuseline._item import Call
from fuseline._wiring import is_awaitable

_log = logging.getLogger("fuseline")

#: The possible outcomes of a message for which a side request could be made.
SIDE_OUTCOMES = ("handler failed", "refused", "requested", "expired", "failed", "answered")


@dataclass(slots=True)
class SideRequest:
    """Makes the calls of a registered side request. The machine does not know of them."""

    name: str
    handle: Callable[[Any, Call], Awaitable[Any]]
    message_handler: Callable[[Any, int], tuple[Any, Any] | None]
    response_handler: Callable[[Any], Any]
    gate: Gate
    #: The number of calls that may be under way.
    calls: int
    #: The counts by outcome, one of `SIDE_OUTCOMES`.
    counts: Counter[str] = field(default_factory=Counter)
    #: The number of requests that wait for a call to end.
    waiting: int = 0
    running: asyncio.Semaphore | None = None
    tasks: set[asyncio.Task[None]] = field(default_factory=set)

    def on_message(self, message: Any, call: Call) -> None:
        """Makes a request for an accepted message, if the message handler returns one."""
        try:
            wanted = self.message_handler(message, call.timestamp)
            if wanted is None:
                return
            request, deadline = wanted
            seconds = nanoseconds(deadline) / 1e9
        except (Exception, asyncio.CancelledError):
            _log.exception("the message handler of %s failed", self.name)
            self.counts["handler failed"] += 1
            return
        if seconds == 0 or not self.gate.admits(self.waiting):
            self.counts["refused"] += 1
            return
        self.counts["requested"] += 1
        if self.running is None:
            self.running = asyncio.Semaphore(self.calls)
        call = replace(call, deadline=seconds)
        task = asyncio.get_running_loop().create_task(self._ask(self.running, request, call))
        self.tasks.add(task)
        task.add_done_callback(self.tasks.discard)

    def stop(self) -> list[asyncio.Task[None]]:
        """Aborts the calls under way, and returns their tasks."""
        tasks = list(self.tasks)
        for task in tasks:
            task.cancel()
        return tasks

    async def _ask(self, running: asyncio.Semaphore, request: Any, call: Call) -> None:
        try:
            answer = await asyncio.wait_for(self._call(running, request, call), call.deadline)
            handled = self.response_handler(answer)
            if is_awaitable(handled):
                await handled
        except asyncio.TimeoutError:
            self.counts["expired"] += 1
        except Exception as error:
            self.counts["failed"] += 1
            _log.warning("%s: no answer will come: %s", self.name, in_one_line(error))
        else:
            self.counts["answered"] += 1

    async def _call(self, running: asyncio.Semaphore, request: Any, call: Call) -> Any:
        loop = asyncio.get_running_loop()
        begin = loop.time()
        # A request that gets its turn at once does not wait.
        waits = running.locked()
        self.waiting += waits
        try:
            await running.acquire()
        finally:
            self.waiting -= waits
        try:
            left = max(call.deadline - (loop.time() - begin), 0.0)
            return await self.handle(request, replace(call, deadline=left))
        finally:
            running.release()
