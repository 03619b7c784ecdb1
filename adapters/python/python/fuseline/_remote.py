"""Calls a remote policy in a thread of its own, so that a call can be ended."""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import logging
import queue
import threading
from collections.abc import Callable
from dataclasses import replace
from time import monotonic
from typing import Any, Protocol

from fuseline._errors import CallError, ConfigError, in_one_line
from fuseline._item import Call
from fuseline._wiring import check_read, is_async

_log = logging.getLogger("fuseline")

#: The number of threads that may hang, in calls or in closing, before the next call is delayed.
HUNG_THREADS = 16
#: The seconds from the end of a connection until the next one may begin. They double with each
#: thread that hangs beyond `HUNG_THREADS`, up to `LONGEST_PAUSE`.
PAUSE = 0.1
LONGEST_PAUSE = 60.0


class RemotePolicy(Protocol):
    """Is a connection to a policy server.

    If ``infer`` has a parameter ``call``, it gets a `Call`. The call's ``timestamp`` is the tick,
    and its ``deadline`` is the seconds for which the action is useful.
    """

    @property
    def infer(self) -> Callable[..., Any]:
        """Sends an observation, and waits for its actions."""

    def close(self) -> None:
        """Ends the connection, and with it a call under way. It is called from another thread."""


class RemoteThread:
    """Connects, and makes one call at a time.

    A cancelled call closes its connection, so that its reply cannot be mistaken for a later call's
    reply. The next call connects again.

    Args:
        connect: Makes a connection.
        read: Makes a value from a reply, or raises an error if the reply has none.
        name: The operator's name in logs.
    """

    def __init__(
        self,
        connect: Callable[[], RemotePolicy],
        read: Callable[[Any], Any] = lambda reply: reply,
        name: str = "policy",
    ) -> None:
        self._connect, self._read, self._name = connect, read, name
        self._connection: PolicyConnection | None = None
        #: Threads of calls that were given up, and of those that close connections.
        self._hung: list[threading.Thread] = []
        self._ended = -PAUSE
        self._is_calling = False

    def is_ready(self) -> bool:
        """Returns True if a call can be made: none is under way, and no connection just ended."""
        if self._is_calling:
            return False
        if self._connection is not None and not self._connection.is_over:
            return True
        return monotonic() >= self._ended + self._pause()

    async def infer(self, observation: Any, call: Call) -> Any:
        """Makes a call. At most one call may be under way."""
        connection = self._connection
        if connection is None or connection.is_over:
            connection = self._connection = PolicyConnection(self._connect, self._read)
        self._is_calling = True
        try:
            return await connection.infer(observation, call)
        except BaseException:
            self.close()
            raise
        finally:
            self._is_calling = False

    def close(self) -> None:
        """Ends the connection and a call under way, without waiting for that."""
        connection, self._connection = self._connection, None
        if connection is None:
            return
        before = len(self._alive())
        self._hung += [connection.thread, *connection.close()]
        self._ended = monotonic()
        hung = len(self._alive())
        # Logs this each time that the number doubles.
        if hung >= HUNG_THREADS and hung.bit_length() > before.bit_length():
            _log.error(
                "%s: %d threads hang in calls to the remote policy or in closing it, and the next "
                "call is made after %.1f s: let close() end a call under way",
                self._name,
                hung,
                self._pause(),
            )

    def wait(self, seconds: float) -> None:
        """Waits until the closed connections have ended, but no longer than this."""
        until = monotonic() + seconds
        for thread in self._alive():
            thread.join(max(until - monotonic(), 0.0))

    def _alive(self) -> list[threading.Thread]:
        self._hung = [thread for thread in self._hung if thread.is_alive()]
        return self._hung

    def _pause(self) -> float:
        beyond = max(len(self._alive()) - HUNG_THREADS, 0)
        return min(PAUSE * 2.0 ** min(beyond, 64), LONGEST_PAUSE) if PAUSE else 0.0


class PolicyConnection:
    """Connects and makes calls in a thread, until it fails or is closed."""

    def __init__(self, connect: Callable[[], RemotePolicy], read: Callable[[Any], Any]) -> None:
        self._connect, self._read = connect, read
        self._calls: queue.SimpleQueue[tuple[Any, Call, float, asyncio.Future[Any]] | None] = (
            queue.SimpleQueue()
        )
        self._policy: RemotePolicy | None = None
        self._takes_call = False
        self._lock = threading.Lock()
        self._loop = asyncio.get_running_loop()
        self.is_over = False
        self.thread = threading.Thread(target=self._run, name="fuseline-remote", daemon=True)
        self.thread.start()

    def infer(self, observation: Any, call: Call) -> asyncio.Future[Any]:
        """Hands a call to the thread."""
        future: asyncio.Future[Any] = self._loop.create_future()
        self._calls.put((observation, call, monotonic() + call.deadline, future))
        return future

    def close(self) -> list[threading.Thread]:
        """Ends the connection. A policy that is still connecting is closed once it is connected.

        Closing may wait for the server, so a thread does that.
        """
        with self._lock:
            self.is_over = True
            policy = self._policy
        self._calls.put(None)
        if policy is None:
            return []
        closing = threading.Thread(
            target=_close, args=[policy], name="fuseline-remote-close", daemon=True
        )
        closing.start()
        return [closing]

    def _run(self) -> None:
        while (job := self._calls.get()) is not None:
            observation, call, due, future = job
            try:
                reply = self._reply(observation, call, due)
            except BaseException as error:
                self.is_over = True
                self._answer(future, None, error)
                return
            self._answer(future, reply, None)

    def _reply(self, observation: Any, call: Call, due: float) -> Any:
        if self._policy is None:
            policy = self._connect()
            _check_policy(policy)
            self._takes_call = _takes_call(policy.infer)
            with self._lock:
                self._policy = policy
                is_over = self.is_over
            if is_over:
                _close(policy)
                raise CallError("it was closed while it connected")
        if self._takes_call:
            call = replace(call, deadline=max(due - monotonic(), 0.0))
            reply = self._policy.infer(observation, call=call)
        else:
            reply = self._policy.infer(observation)
        check_read(reply, "infer of the remote policy")
        return self._read(reply)

    def _answer(self, future: asyncio.Future[Any], reply: Any, error: BaseException | None) -> None:
        why = "" if error is None else in_one_line(error)
        if error is not None and not isinstance(error, CallError):
            why = f"{type(error).__name__}: {why}"

        def settle() -> None:
            if future.done():
                return
            if error is None:
                future.set_result(reply)
            else:
                future.set_exception(CallError(why))

        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(settle)


def _check_policy(policy: Any) -> None:
    for method in ("infer", "close"):
        if not callable(getattr(policy, method, None)) or inspect.isclass(policy):
            raise CallError(
                f"the function that connects returned {type(policy).__name__}, which has no "
                f"{method}(): a remote policy has infer(observation) and close()"
            )


def _takes_call(infer: Callable[..., Any]) -> bool:
    try:
        return "call" in inspect.signature(infer).parameters
    except (TypeError, ValueError):
        return False


def _close(policy: RemotePolicy) -> None:
    try:
        policy.close()
    except BaseException as error:
        _log.warning("a remote policy could not be closed: %s", in_one_line(error))


def check_connects(remote: Any) -> None:
    """Refuses a value that is not a function that connects.

    Raises:
        ConfigError: if it is not such a function, for example a policy.
    """
    if not callable(remote) or (hasattr(remote, "infer") and not inspect.isclass(remote)):
        raise ConfigError(
            f"a remote policy is given as a function that connects, not as {remote!r}: give the "
            "class, or `lambda: policy`"
        )
    if is_async(remote):
        raise ConfigError(
            "the function that connects must be plain, not async; it runs in a thread of its own"
        )
