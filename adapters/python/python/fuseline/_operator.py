"""Runs an operator within asyncio: it owns the clock, the payloads and the calls."""

from __future__ import annotations

import asyncio
import logging
import os
import time
from collections.abc import (
    AsyncIterable,
    AsyncIterator,
    Awaitable,
    Callable,
    Iterable,
    Sequence,
)
from concurrent.futures import Future
from threading import get_ident
from types import TracebackType
from typing import TYPE_CHECKING, Generic, Literal, TypeVar

from fuseline._counts import Counts
from fuseline._drive import Clock, Driver, wait_for_cancelled
from fuseline._errors import Closed, ConfigError, Full, TraceError
from fuseline._feeds import Feeds
from fuseline._fuseline import Engine, Latency, nanoseconds
from fuseline._home import Arrivals, Home
from fuseline._item import CurrentDeadline, Item, Lineage
from fuseline._local import Local, local_of
from fuseline._output import Output
from fuseline._setup import Setup
from fuseline._side import SIDE_OUTCOMES
from fuseline._snapshot import UNCHANGEABLE, snapshot
from fuseline._sources import OutputHandlers
from fuseline._tracefile import hold
from fuseline._validation import Commit, ns
from fuseline._wiring import (
    check_clock,
    check_commit,
    check_count,
    check_message,
    check_messages,
    check_name,
    check_range,
    check_reserve,
    check_timeout,
    check_trace,
    fix_arguments,
)
from fuseline.deadline import Situation, compiled

if TYPE_CHECKING:
    from fuseline._judge import Duration

M = TypeVar("M")
V = TypeVar("V")
Req = TypeVar("Req")
Res = TypeVar("Res")

_log = logging.getLogger("fuseline")
_running_loop = asyncio._get_running_loop


@fix_arguments
class Operator(Setup[M, V], Generic[M, V]):
    """Computes each message on board and in clouds, and forwards the best result that is in time.

    Each message written leads to exactly one `Item`; under progressive it leads to one or more, and
    the last one is marked. Use the operator as a context manager, in one event loop. At the end of
    the block it accepts no more messages and waits until all are answered; after an exception it
    `stop`s. It waits at most a second for calls that continue although they were cancelled, and
    logs how many are left.

    Its methods belong to the thread of its loop, except `write_threadsafe`. In another thread they
    raise a RuntimeError.

    Args:
        local: Computes each message on board. It is a `Local`, or a function of a message and its
            timestamp. A plain function runs in a thread of its own, an ``async def`` in a task.
        name: The operator's name in logs and traces.
        window: The greatest number of messages that may be open at once, 1 to 1024. A further
            message is refused as ``full`` (F1).
        commit: Decides when a result is sent although a better one is pending (F6, F9).
        output_len: The number of items that the reader may lag behind. While it lags further
            behind, the operator accepts no message, and finishes those that are open. The reader
            gets the newest item of a message.
        trace: The file that the run is recorded to. An existing file is overwritten, and each
            operator needs its own.
        clock: Returns whole nanoseconds that never go back.
        lag_warning: A timer that is served later than this, or a handler that blocks the loop for
            longer, is counted and logged as a warning.
        greatest_deadline: The longest deadline of a request or of local, and the greatest that a
            policy may choose. A longer deadline, such as milliseconds read as seconds, is refused.
            Local's raises a ConfigError. An offer's is refused as ``deadline``, with a warning for
            each cloud's first.
        reserve: The latencies of the operators downstream. That part of an end-to-end deadline is
            kept for them (E3).
        latency: Records how long this operator takes, for the reserve of the operators upstream.
        carry_messages: If True, each item carries its message, as ``item.message``.
        copy_messages: If True, each message is copied when it is written, and so is each result of
            local. A buffer that is used again then changes no waiting message. Arrays, Python's
            containers, dataclasses and their contents are copied. An object of another class is
            shared, so do not change it. False saves the copies if nobody changes anything.

    Raises:
        ConfigError: if an argument is of the wrong kind or out of its range. The start raises it if
            no operator can be made with the clouds.

    >>> import asyncio
    >>> async def double(n, call):  # a cloud: any async def
    ...     return 2 * n
    >>> async def main():
    ...     operator = Operator(lambda n, t: f"{n} on board", name="doubler")
    ...     operator.use_cloud(double, lambda n, t: (n, 0.5), "{} by the cloud".format, 1)
    ...     async with operator:
    ...         operator.feed([20, 21])
    ...         return [item.value async for item in operator]
    >>> asyncio.run(main())
    ['40 by the cloud', '42 by the cloud']
    """

    def __init__(
        self,
        local: Local[M, V] | Callable[[M, int], Awaitable[V]] | Callable[[M, int], V],
        *,
        name: str = "operator",
        window: int = 16,
        commit: Commit | Literal["eager", "patient", "progressive"] = Commit.EAGER,
        output_len: int = 16,
        trace: str | os.PathLike[str] | None = None,
        clock: Clock = time.monotonic_ns,
        lag_warning: Duration = 0.02,
        greatest_deadline: Duration = 60.0,
        reserve: Sequence[Latency] = (),
        latency: Latency | None = None,
        carry_messages: bool = False,
        copy_messages: bool = True,
    ) -> None:
        check_name(name, "an operator")
        check_range(window, 1, 1024, "a window")
        check_count(output_len, 1, "an output_len")
        check_commit(commit)
        check_trace(trace)
        check_reserve(reserve)
        check_clock(clock)
        if latency is not None and not isinstance(latency, Latency):
            raise ConfigError(f"a latency is a Latency, not {latency!r}")
        self.name = name
        self._local: Local[M, V] = local_of(local)
        self._window, self._commit = window, commit
        self._path = None if trace is None else os.fsdecode(trace)
        self._clock, self._lag_warning = clock, nanoseconds(lag_warning)
        self._greatest_deadline = nanoseconds(greatest_deadline)
        deadline = self._local.deadline
        if deadline is not None and deadline > self._greatest_deadline:
            raise ConfigError(
                f"local's deadline of {deadline / 1e9} s is above the greatest; give a shorter "
                "one, or a greater greatest_deadline"
            )
        self._home = Home()
        self._arrivals = Arrivals(self, window)
        self._reserve = list(reserve)
        super().__init__(
            OutputHandlers(
                latency=latency, carry_messages=carry_messages, copy_messages=copy_messages
            )
        )
        self._copies = copy_messages
        self._driver: Driver[M, V] | None = None
        self._output = Output[V](output_len, name)
        self._feeds = Feeds(self)
        self._count = 0
        self._is_last = self._is_over = self._is_handling = False
        #: True if `stop` ended it.
        self._is_stopped = False

    def __repr__(self) -> str:
        clouds = [it.cloud.name for it in self._clouds]
        state = "over" if self._is_over else "running" if self._driver else "not started"
        return f"<Operator {self.name!r} clouds={clouds} {state}, {self._count} messages>"

    async def start(self) -> None:
        """Starts the operator; ``async with`` does that.

        Raises:
            ConfigError: if there is no operator with these clouds, it was started before, or
                another operator writes its trace.
            OSError: if its trace cannot be written.
        """
        if self._driver is not None:
            raise ConfigError("this operator was started before; make another")
        local = self._local
        trace = hold(self._path)
        try:
            engine = self._engine()
            await local._start()
        except BaseException:
            if trace is not None:
                trace.give_up()
            raise
        self._home.enter()
        self._driver = Driver(
            self.name,
            engine,
            local,
            self._clouds,
            self._handlers,
            self._clock,
            self._output.put,
            self._end_if_idle,
            self._output.writers.waiters,
            self._lag_warning,
            trace,
        )

    def _engine(self) -> Engine:
        """Makes the engine of what was registered."""
        local = self._local
        return Engine(
            [it.cloud for it in self._clouds],
            [
                (it.calls, it.max_age, it.linger, it.policy and compiled(it.policy))
                for it in self._clouds
            ],
            (
                local.at_once,
                local.waiting,
                local.skip_answered,
                local.may_lose_results,
                local.replaceable,
            ),
            self._window,
            self._commit,
            self.name,
            self._path,
            self._reserve,
            self._handlers.latency,
            self._handlers.substitute is not None,
            self._lag_warning,
            self._greatest_deadline,
        )

    def __enter__(self) -> None:
        raise ConfigError(
            "an Operator runs within asyncio: use `async with`, or give it to a BlockingOperator"
        )

    def __exit__(self, *_: object) -> None:
        """Never called: `__enter__` raises."""

    async def __aenter__(self) -> Operator[M, V]:
        await self.start()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        where: TracebackType | None,
    ) -> None:
        try:
            if error is None:
                await self._feeds.end()
                self.close()
                while not self._is_over:
                    await self._output.readers.wait()
        finally:
            self.stop()
            await wait_for_cancelled(self.name, "feeds", list(self._feeds.tasks))
            if self._driver is not None:
                await self._driver.finish()
        if error is None:
            if isinstance(self._feeds.error, asyncio.CancelledError):
                raise RuntimeError(
                    "the messages that were fed ended in CancelledError: something that they wait "
                    "for was cancelled"
                ) from self._feeds.error
            if self._feeds.error is not None:
                raise self._feeds.error
            if self.recording_error is not None:
                raise TraceError(
                    f"the trace ends early: {self.recording_error}"
                ) from self.recording_error

    # Messages.

    def write(self, message: M, lineage: Lineage | None = None) -> int:
        """Accepts a message, and returns its timestamp. It never waits.

        Args:
            message: The message.
            lineage: The origin of the message: a `Lineage`, or the lineage of another operator's
                item.

        Raises:
            Full: if the reader of the items lags by ``output_len``. The message is not accepted.
            Closed: if the operator takes no more messages.
            TimeError: if the lineage's capture lies more than a second in the future, because it
                was then read from another clock. The message is not accepted.
            RuntimeError: in another thread than the loop's: use `write_threadsafe` there.
        """
        driver, home = self._driver, self._home
        if driver is None or _running_loop() is not home.loop or get_ident() != home.thread:
            driver = self._running("write")
        if self._is_last:
            raise Closed("the operator takes no more messages")
        output = self._output
        if len(output.items) >= output.limit:
            raise Full(f"{len(output.items)} items wait to be read; read them first")
        if self._is_handling:
            raise RuntimeError("a handler must not write to its own operator")
        if lineage is not None and not isinstance(lineage, Lineage):
            raise ConfigError(f"a lineage is a Lineage, not {lineage!r}")
        if type(message) not in UNCHANGEABLE:
            check_message(message)
            if self._copies:
                message = snapshot(message)
        t = self._count
        self._is_handling = True
        try:
            if self._situation is not None:
                self._assess(driver, self._situation, message, t)
                if self._is_last:
                    raise Closed("the situation's handler ended the operator")
            now = driver.now()
            fields = None if lineage is None else driver.fields_of(now, lineage)
            # From here on the message has its timestamp.
            self._count += 1
            driver.open(now, t, message, lineage, fields)
        finally:
            self._is_handling = False
        return t

    def write_threadsafe(self, message: M, lineage: Lineage | None = None) -> Future[int]:
        """Writes a message from any thread, such as a camera's callback; it never waits.

        The message is accepted when the loop has its next turn. At most ``window`` messages may be
        on their way.

        Returns:
            A future of the message's timestamp, or of the exception that `write` raises. An
            exception that nobody retrieves is counted in ``counts[name, "message", "not taken"]``
            and logged.

        Raises:
            Full: if too many are on their way because the loop is blocked. The message is not
                accepted.
            Closed: if the operator has ended.
        """
        if self._home.loop is None:
            raise ConfigError("the operator has not started; use it with `async with`")
        return self._arrivals.send(self._home.loop, message, lineage)

    async def write_all(self, messages: AsyncIterable[M] | Iterable[M]) -> int:
        """Writes each message as soon as there is room, and returns the number of messages.

        There is room while the reader of the items does not lag and the window is not full. An
        `Item` of another operator and a `Joined` set of a join pass their lineage on.

        Raises:
            Closed: if the operator takes no more messages.
            ConfigError: if these are no messages, such as a str.
        """
        check_messages(messages)
        return await self._feeds.write_each(messages, [0])

    def feed(self, messages: AsyncIterable[M] | Iterable[M]) -> None:
        """Writes each message in a task of its own, and closes the operator after the last stream.

        Several streams may be fed at once. If one ends in an exception, the operator is closed, and
        the exception is raised at the end of its block. If the block ends first, a list is fed to
        its end as long as there is room for its items. Any other stream is cut off, which is
        logged, and raises an error if nobody has read an item by then.

        Raises:
            Closed: if the operator takes no more messages.
            ConfigError: if these are no messages, such as a str.
        """
        self._running("feed")
        check_messages(messages)
        source: object = messages
        if source is self:
            raise ConfigError("an operator cannot be fed its own items; read them")
        if self._is_last:
            raise Closed("the operator takes no more messages; feed all streams before one ends")
        self._feeds.begin(messages)

    def close(self) -> None:
        """Accepts no more messages. The items end once all messages are answered."""
        self._home.check("close", is_over=self._is_over)
        self._is_last = True
        if self._driver is not None:
            self._driver.close()
        self._output.writers.wake()
        self._end_if_idle()

    def stop(self) -> None:
        """Ends the operator at once: aborts its calls, and leaves open messages unanswered.

        Handlers and policies may call it too. The message or result for which they were called is
        then the last one that is processed.
        """
        self._home.check("stop", is_over=self._is_over)
        self._is_stopped = self._is_stopped or not self._is_over
        self._end()

    def _end(self) -> None:
        if self._is_over or self._driver is None:
            return
        self._is_last = self._is_over = True
        self._feeds.stop()
        self._driver.stop()
        self._output.writers.wake()
        self._output.readers.wake()

    # Items.

    def __aiter__(self) -> AsyncIterator[Item[V]]:
        return self

    async def __anext__(self) -> Item[V]:
        """Returns the next item. Ends once no more messages come and all are answered."""
        if self._driver is None or get_ident() != self._home.thread:
            self._running("read")
        output = self._output
        while not output.items:
            if self._is_over:
                raise StopAsyncIteration
            await output.readers.wait()
        return output.take()

    async def read(self, timeout: float | None = None) -> Item[V] | None:
        """Returns the next item, or None after ``timeout`` seconds or after the last item."""
        self._running("read")
        timeout = check_timeout(timeout)
        loop = asyncio.get_running_loop()
        until = None if timeout is None else loop.time() + timeout
        output = self._output
        timer = None if until is None else loop.call_at(until, output.readers.wake)
        try:
            while not output.items:
                if self._is_over or (until is not None and loop.time() >= until):
                    return None
                await output.readers.wait()
        finally:
            if timer is not None:
                timer.cancel()
        return output.take()

    @property
    def counts(self) -> Counts[tuple[str, str, str]]:
        """Returns the counts so far, by source or operator, subject and outcome.

        For instance, ``counts["west", "result", "forwarded"]`` counts the outputs of ``west``.

        - ``"message"``: ``"accepted"``, ``"missed"``, ``"refused full"`` and so on, and
          ``"not taken"`` for messages from another thread or a stream that were lost.
        - ``"request"``: ``"admitted"``, ``"refused queue"`` and so on, and ``"lost"`` for local's
          computations that ran past their deadline.
        - ``"failed because"``: each of a source's last eight reasons, and ``"other reasons"``.
        - ``"handler"``: ``"failed"`` and ``"held up the loop"``; ``"policy"``: ``"failed"``.
        - ``"timer"``: ``"late"``.
        - ``"side request"``: ``"requested"``, ``"answered"``, ``"expired"`` and so on.

        A key that nothing is ever counted by raises `KeyError`, once the operator has started.
        """
        if self._driver is None:
            return Counts()
        counted = self._driver.counting.counts()
        for side in self._handlers.sides:
            of_side = dict.fromkeys(SIDE_OUTCOMES, 0) | side.counts
            counted += [((side.name, "side request", it), n) for it, n in of_side.items()]
        counted.append(((self.name, "message", "not taken"), self._arrivals.not_taken))
        counts: Counts[tuple[str, str, str]] = Counts(known=(key for key, _ in counted))
        for key, count in counted:
            if count:
                # Two sources may have one name.
                counts[key] += count
        return counts

    @property
    def greatest_lag(self) -> float:
        """Returns the longest block of the loop in seconds; 0 if none exceeded ``lag_warning``."""
        return 0.0 if self._driver is None else self._driver.counting.greatest_lag / 1e9

    @property
    def deadlines(self) -> dict[str, CurrentDeadline]:
        """Returns the latest deadline of each cloud and its reason, by the cloud's name."""
        if self._driver is None:
            return {}
        in_force = self._driver.counting.deadlines()
        return {name: CurrentDeadline(ns(deadline), why) for name, deadline, why in in_force}

    @property
    def recording_error(self) -> OSError | None:
        """Returns the error that ended the recording early, such as a trace that was removed."""
        return None if self._driver is None else self._driver.recording.recording_error

    def _running(self, method: str) -> Driver[M, V]:
        if self._driver is None:
            raise ConfigError("the operator has not started; use it with `async with`")
        self._home.check(method, is_over=self._is_over)
        return self._driver

    def _has_room(self) -> bool:
        driver = self._driver
        is_open = driver is not None and driver.has_room(self._window)
        return is_open and len(self._output.items) < self._output.limit

    def _end_if_idle(self) -> None:
        driver = self._driver
        if self._output.writers.waiters and self._has_room():
            self._output.writers.wake()
        if self._is_last and driver is not None and driver.is_idle:
            self._end()

    def _assess(
        self,
        driver: Driver[M, V],
        situation: Callable[[M, int], Situation],
        message: M,
        t: int,
    ) -> None:
        try:
            driver.set_situation(situation(message, t))
        except (Exception, asyncio.CancelledError):
            _log.exception(
                "%s: the situation's handler failed, so the situation is unknown", self.name
            )
            driver.counting.handler_failed(None)
            driver.set_situation(Situation())
