"""One remote policy at a time, in a thread of its own, whose call can be ended."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import queue
import threading
import time
from collections.abc import Callable
from typing import Any, Protocol

from fuseline._errors import CallError, in_one_line

_log = logging.getLogger("fuseline")

#: How many threads may hang in calls that closing their connection did not end.
HUNG_THREADS = 4
#: How long after the end of a connection the next one may begin, in seconds.
PAUSE = 0.1


class RemotePolicy(Protocol):
    """A connection to a policy server."""

    def infer(self, observation: Any) -> Any:
        """Send an observation, and wait for its actions."""

    def close(self) -> None:
        """End the connection, and with it a call under way. It is called from another thread."""


class RemoteThread:
    """Connects, and makes one call at a time.

    A call that is cancelled closes its connection: its reply can only be read by itself, so none
    is taken for that of a later call. The next call connects anew.
    """

    def __init__(self, connect: Callable[[], RemotePolicy]) -> None:
        self._connect = connect
        self._connection: PolicyConnection | None = None
        self._hung: list[threading.Thread] = []
        self._ended = -PAUSE

    def is_ready(self) -> bool:
        """Whether a call can be made: not just after a connection ended, nor while many hang."""
        if self._connection is not None and not self._connection.is_over:
            return True
        self._hung = [thread for thread in self._hung if thread.is_alive()]
        return len(self._hung) < HUNG_THREADS and time.monotonic() >= self._ended + PAUSE

    async def infer(self, observation: Any) -> Any:
        """Make a call; at most one at a time."""
        connection = self._connection
        if connection is None or connection.is_over:
            connection = self._connection = PolicyConnection(self._connect)
        try:
            return await connection.infer(observation)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End the connection and a call under way."""
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.close()
            self._hung.append(connection.thread)
            self._ended = time.monotonic()


class PolicyConnection:
    """A thread that connects and makes calls, until it fails or is closed."""

    def __init__(self, connect: Callable[[], RemotePolicy]) -> None:
        self._connect = connect
        self._calls: queue.SimpleQueue[tuple[Any, asyncio.Future[Any]] | None] = queue.SimpleQueue()
        self._policy: RemotePolicy | None = None
        self._lock = threading.Lock()
        self._loop = asyncio.get_running_loop()
        self.is_over = False
        self.thread = threading.Thread(target=self._run, name="fuseline-remote", daemon=True)
        self.thread.start()

    def infer(self, observation: Any) -> asyncio.Future[Any]:
        """Hand a call to the thread."""
        future: asyncio.Future[Any] = self._loop.create_future()
        self._calls.put((observation, future))
        return future

    def close(self) -> None:
        """End it; a policy that is being connected is closed as soon as it is there."""
        with self._lock:
            self.is_over = True
            policy = self._policy
        self._calls.put(None)
        if policy is not None:
            _close(policy)

    def _run(self) -> None:
        while (call := self._calls.get()) is not None:
            observation, future = call
            try:
                reply = self._reply(observation)
            except BaseException as error:
                self.is_over = True
                self._answer(future, None, error)
                return
            self._answer(future, reply, None)

    def _reply(self, observation: Any) -> Any:
        if self._policy is None:
            policy = self._connect()
            with self._lock:
                self._policy = policy
                is_over = self.is_over
            if is_over:
                _close(policy)
                raise CallError("it was closed while it connected")
        return self._policy.infer(observation)

    def _answer(self, future: asyncio.Future[Any], reply: Any, error: BaseException | None) -> None:
        why = "" if error is None else f"{type(error).__name__}: {in_one_line(error)}"

        def settle() -> None:
            if future.done():
                return
            if error is None:
                future.set_result(reply)
            else:
                future.set_exception(CallError(why))

        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(settle)


def _close(policy: RemotePolicy) -> None:
    try:
        policy.close()
    except Exception as error:
        _log.debug("a remote policy could not be closed: %s", error)
