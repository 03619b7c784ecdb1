"""An operator within asyncio: it owns the clock, the payloads and the calls."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import threading
import time
import weakref
from collections import Counter, deque
from collections.abc import (
    AsyncGenerator,
    AsyncIterable,
    AsyncIterator,
    Awaitable,
    Callable,
    Iterable,
    Sequence,
    Sized,
)
from concurrent.futures import Future
from types import TracebackType
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

from fuseline._drive import Clock, Driver, wait_for_cancelled
from fuseline._errors import Closed, ConfigError, Full, TraceError, in_one_line
from fuseline._fuseline import Engine, Latency, check_linger, nanoseconds
from fuseline._item import Call, CurrentDeadline, Item, Lineage, StampedValue
from fuseline._join import Joined
from fuseline._local import Local, local_of
from fuseline._loop import WaiterList, each
from fuseline._setup import PipelineSetup
from fuseline._snapshot import UNCHANGEABLE, snapshot
from fuseline._sources import OutputHandlers, RegisteredCloud
from fuseline._tracefile import hold
from fuseline._wiring import (
    check_clock,
    check_commit,
    check_count,
    check_function,
    check_handle,
    check_message,
    check_messages,
    check_name,
    check_own_policy,
    check_policy,
    check_priority,
    check_range,
    check_reserve,
    check_response_handler,
    check_takes,
    check_timeout,
    check_trace,
)
from fuseline._words import Cloud, Commit, ns
from fuseline.deadline import Policy, Situation, compiled, policy_of

if TYPE_CHECKING:
    from fuseline._judge import Duration

M = TypeVar("M")
V = TypeVar("V")
Req = TypeVar("Req")
Res = TypeVar("Res")

_log = logging.getLogger("fuseline")
_running_loop = asyncio._get_running_loop

#: After how many seconds it is reported that nobody reads the items, and messages wait.
UNREAD_SECONDS = 5.0
#: What stands for the thread of an operator in a process that was forked.
_FORKED = -1
#: What to do about it.
_UNREAD = "and nobody has read one: read them within the block, `async for item in operator`"


class Operator(PipelineSetup[M, V], Generic[M, V]):
    """Computes each message on board and in clouds, and forwards the best result that is in time.

    Each message written leads to exactly one `Item`; under progressive to one or more, the last one
    marked. Use it as a context manager, in one event loop: the end of the block takes no more
    messages and waits until all are answered, or `stop`s after an exception. Calls that go on
    although they were cancelled are waited for a second at most; the log says how many are left.

    Args:
        local: Computes each message on board: a `Local`, an ``async def`` of a message and its
            timestamp, or a plain function of them, which runs in a thread of its own.
        name: The operator's name in logs and traces.
        window: How many messages may be open at once, 1 to 1024; one more is refused ``full`` (F1).
        commit: When a result is sent although a better one is pending (F6, F9).
        output_len: How many items the reader may lag behind. While it lags further, no message is
            taken in; what is open goes on. Of the items of one message it is given the newest.
        trace: The file that the run is recorded to; it is overwritten. Each operator has its own.
        clock: Reads whole nanoseconds that never go back.
        lag_warning: How late a timer may be served, and how long a handler may hold up the loop,
            before it is counted and logged as a warning.
        greatest_deadline: The longest deadline of a request or of local, and the most that a policy
            may choose. A longer one, such as milliseconds read as seconds, is refused: of local
            with a ConfigError, of an offer as ``deadline``, with a warning at the first.
        reserve: How long those downstream take; so much of an end-to-end deadline is kept (E3).
        latency: What records how long this operator takes, for those upstream.
        carry_messages: Whether each item carries its message, as ``item.message``.
        copy_messages: Whether each message is copied when it is written, and each result of local,
            so that a buffer that is used again changes none that waits. What is copied are arrays,
            Python's containers, dataclasses and what is in them; an object of another class is
            shared and must not be changed. False saves the copies where nobody changes anything.

    Its methods belong to the thread of its loop, but for `write_threadsafe`; elsewhere they raise a
    RuntimeError.

    Raises:
        ConfigError: if there is no such operator; when it starts, if its clouds make none.

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
        self._output_len = output_len
        self._path = None if trace is None else os.fsdecode(trace)
        self._clock, self._lag_warning = clock, nanoseconds(lag_warning)
        self._greatest_deadline = nanoseconds(greatest_deadline)
        deadline = self._local.deadline
        if deadline is not None and deadline > self._greatest_deadline:
            raise ConfigError(
                f"local's deadline of {deadline / 1e9} s is above the greatest; give a shorter "
                "one, or a greater greatest_deadline"
            )
        #: The loop's thread, once it has started, and messages on their way to it.
        self._thread: int | None = None
        self._on_their_way = 0
        self._way = threading.Lock()
        self._not_taken = 0
        self._clouds: list[RegisteredCloud] = []
        self._reserve = list(reserve)
        super().__init__(
            OutputHandlers(
                latency=latency, carry_messages=carry_messages, copy_messages=copy_messages
            )
        )
        self._loop: asyncio.AbstractEventLoop | None = None
        self._situation: Callable[[M, int], Situation] | None = None
        self._copies = copy_messages
        self._driver: Driver[M, V] | None = None
        self._items: deque[Item[V]] = deque()
        #: Who waits for an item, and who waits for room.
        self._readers, self._writers = WaiterList(), WaiterList()
        #: What writes messages, and whether it is known to end.
        self._feeds: dict[asyncio.Task[None], bool] = {}
        self._feed_error: BaseException | None = None
        self._count = 0
        #: How many items were read, and how many of them when the output was last found full.
        self._read_count = self._read_before = 0
        self._unread_timer: asyncio.TimerHandle | None = None
        self._is_last = self._is_over = self._is_handling = self._is_ending = False
        #: Whether `stop` ended it.
        self._is_stopped = False

    def __repr__(self) -> str:
        clouds = [it.cloud.name for it in self._clouds]
        state = "over" if self._is_over else "running" if self._driver else "not started"
        return f"<Operator {self.name!r} clouds={clouds} {state}, {self._count} messages>"

    # Before the start.

    def use_cloud(
        self,
        handle: Callable[[Req, Call], Awaitable[Res]],
        message_handler: Callable[[M, int], tuple[Req, Duration] | None],
        response_handler: Callable[[Res], V | StampedValue[V]]
        | Callable[[Res], Awaitable[V | StampedValue[V]]],
        priority: int,
        *,
        encode: Callable[[Any], Req] | None = None,
        name: str | None = None,
        limit: int | None = None,
        resume: int = 0,
        calls: int = 8,
        policy: Policy | Callable[[Situation, ns], Duration] | None = None,
        linger: Duration = 0.0,
        max_age: int = 0,
    ) -> None:
        """Register a cloud; up to 15, before the operator starts.

        Args:
            handle: Makes the call: an ``async def`` of a request and its `Call`, in a task on the
                loop, which it must not block. It is cancelled when its timer fires or another
                result goes (F5, F7). An exception is a failure (F4).
            message_handler: Looks at each message that was taken on, and its timestamp; returns the
                request and how long the cloud may take, or None for no request, as if it fails. It
                must not block and is no ``async def``: an offer is of its message's instant.
            response_handler: Turns the response into the result, in the call's task; may be an
                ``async def``; the result arrives when it is done. It returns a `StampedValue` if
                the response says of which message it is.
            encode: Makes the handle's request of the message handler's in a thread, as for JPEG;
                once for all clouds whose handlers return the same object to the same function.
            priority: 1 to 65535, different for each cloud; the greater wins.
            name: For people, counts and traces; no two clouds have one name. By default it is
                ``cloud-`` and the priority.
            limit: The gate shuts when this many requests wait to be sent (F2g); by default as many
                as ``calls`` (A15).
            resume: The shut gate opens when this many or fewer wait.
            calls: How many calls may be under way; further requests wait.
            policy: Chooses how long each request may take, at most what the message handler says,
                and learns how each ended: see `fuseline.deadline`. Each cloud has a policy of its
                own. A plain function of a `Situation` and the most will do.
            linger: How long a call may run on after it was due, so that the policy learns how long
                it really takes. What comes then is still dropped (F3).
            max_age: Of how many messages before its own a `StampedValue` may be; what is older, or
                of a later message, is a failure (F4).

        Durations are seconds as a float, a timedelta, or nanoseconds as `fuseline.ns`.

        Raises:
            ConfigError: if the operator has started, or what was given cannot be what it is given
                for: a class for an instance, a handle that is not async, a number out of its range.
        """
        self._check_not_started("a cloud")
        check_handle(handle)
        check_function(message_handler, "a message handler")
        check_response_handler(response_handler)
        check_takes(handle, "a handle", "request", "call")
        check_takes(message_handler, "a message handler", "message", "timestamp")
        check_takes(response_handler, "a response handler", "response")
        check_priority(priority, [it.cloud.p for it in self._clouds])
        name = f"cloud-{priority}" if name is None else name
        check_name(name, "a cloud", self._names())
        check_count(calls, 1, "calls at once")
        limit = calls if limit is None else limit
        check_count(limit, 1, "a limit")
        check_count(resume, 0, "a resume")
        check_count(max_age, 0, "a max_age")
        if encode is not None:
            check_function(encode, "what encodes")
        if policy is not None:
            check_policy(policy)
            policy = policy_of(policy)
            check_own_policy(policy, [it.policy for it in self._clouds], name)
            check_linger(name, compiled(policy), nanoseconds(linger))
        cloud = Cloud(priority, limit, resume, name)
        self._clouds.append(
            RegisteredCloud(
                cloud,
                handle,
                message_handler,
                response_handler,
                encode,
                calls,
                nanoseconds(linger),
                policy,
                max_age,
            )
        )

    def use_situation(self, situation: Callable[[M, int], Situation]) -> None:
        """Set what policies learn of the vehicle with each message taken in, above all its speed.

        Without it they know nothing, and the guard risks nothing. If it fails, nothing is known.
        """
        check_function(situation, "a situation's handler")
        self._situation = situation

    async def start(self) -> None:
        """Start; ``async with`` does that.

        Raises:
            ConfigError: if there is no operator with these clouds, it was started before, or
                another operator writes its trace.
            OSError: if its trace cannot be written.
        """
        if self._driver is not None:
            raise ConfigError("an operator is started once; make another")
        local = self._local
        trace = hold(self._path)
        try:
            engine = self._engine()
            await local._start()
        except BaseException:
            if trace is not None:
                trace.give_up()
            raise
        self._loop = asyncio.get_running_loop()
        self._thread = threading.get_ident()
        _STARTED.add(self)
        self._driver = Driver(
            self.name,
            engine,
            local,
            self._clouds,
            self._handlers,
            self._clock,
            self._put,
            self._end_if_idle,
            self._writers.waiters,
            self._lag_warning,
            trace,
        )

    def _engine(self) -> Engine:
        """The engine of what was registered."""
        local = self._local
        return Engine(
            [it.cloud for it in self._clouds],
            [
                (it.calls, it.max_age, it.linger, it.policy and compiled(it.policy))
                for it in self._clouds
            ],
            (local.at_once, local.waiting, local.skip_answered, local.lossy, local.replaceable),
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
                await self._end_feeds()
                self.close()
                while not self._is_over:
                    await self._readers.wait()
        finally:
            self.stop()
            await wait_for_cancelled(self.name, "feeds", list(self._feeds))
            if self._driver is not None:
                await self._driver.finish()
        if error is None:
            if isinstance(self._feed_error, asyncio.CancelledError):
                raise RuntimeError(
                    "the messages that were fed ended in CancelledError: something that they wait "
                    "for was cancelled"
                ) from self._feed_error
            if self._feed_error is not None:
                raise self._feed_error
            if self.unrecorded is not None:
                raise TraceError(f"the trace ends early: {self.unrecorded}") from self.unrecorded

    # Messages.

    def write(self, message: M, lineage: Lineage | None = None) -> int:
        """Take a message in; return its timestamp. It never waits.

        Args:
            message: The message.
            lineage: What it comes from: a `Lineage`, or that of another operator's item.

        Raises:
            Full: if the reader of the items lags by ``output_len``: the message was not taken.
            Closed: if the operator takes no more messages.
            TimeError: if the lineage's capture is to come, by more than a second: it is of another
                clock, and the message was not taken.
            RuntimeError: in another thread than the loop's: use `write_threadsafe` there.
        """
        driver = self._driver
        if driver is None or threading.get_ident() != self._thread:
            driver = self._running("write")
        if _running_loop() is not self._loop:
            self._check_loop("write")
        if self._is_last:
            raise Closed("the operator takes no more messages")
        if len(self._items) >= self._output_len:
            raise Full(f"{len(self._items)} items wait to be read; read them first")
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
        """Write a message from any thread, such as a camera's callback; it never waits.

        The message is taken in when the loop has its next turn. As many may be on their way as the
        window has room for.

        Returns:
            A future of the message's timestamp, or of what `write` raises. If nobody looks, it is
            counted all the same, as ``counts[name, "message", "not taken"]``, and logged.

        Raises:
            Full: if too many are on their way, since the loop is held up: it was not taken.
            Closed: if the operator has ended.
        """
        if self._driver is None or self._loop is None:
            raise ConfigError("the operator has not started; use it with `async with`")
        with self._way:
            if self._on_their_way >= self._window:
                self._not_taken += 1
                raise Full(f"{self._on_their_way} messages are on their way; the loop is held up")
            self._on_their_way += 1
        future: Future[int] = Future()
        try:
            self._loop.call_soon_threadsafe(self._take, message, lineage, future)
        except RuntimeError as error:
            with self._way:
                self._on_their_way -= 1
                self._not_taken += 1
            raise Closed("the operator's loop has ended") from error
        return future

    def _take(self, message: M, lineage: Lineage | None, future: Future[int]) -> None:
        """A message came from another thread."""
        with self._way:
            self._on_their_way -= 1
        try:
            future.set_result(self.write(message, lineage))
        except Exception as error:
            with self._way:
                self._not_taken += 1
                times = self._not_taken
            future.set_exception(error)
            if times & (times - 1) == 0:
                why = in_one_line(error)
                _log.warning("%s: a message was not taken: %s (%d so far)", self.name, why, times)

    async def write_all(self, messages: AsyncIterable[M] | Iterable[M]) -> int:
        """Write each message as soon as there is room; return how many.

        There is room while the reader of the items does not lag and the window is not full. What
        comes from another operator or a join, its `Item`s or `Joined` sets, has its lineage.

        Raises:
            Closed: if the operator takes no more messages.
            ConfigError: if these are no messages, such as a str.
        """
        check_messages(messages)
        return await self._write_each(messages, [0])

    async def _write_each(
        self, messages: AsyncIterable[M] | Iterable[M], written: list[int]
    ) -> int:
        async with contextlib.AsyncExitStack() as stack:
            if isinstance(messages, AsyncGenerator):
                await stack.enter_async_context(contextlib.aclosing(messages))
            async for message in each(messages):
                while not self._has_room() and not self._is_last:
                    self._watch_unread()
                    await self._writers.wait()
                lineage = message.lineage if isinstance(message, (Item, Joined)) else None
                self.write(message, lineage)
                written[0] += 1
        return written[0]

    def feed(self, messages: AsyncIterable[M] | Iterable[M]) -> None:
        """Write each message in a task of the operator's own; `close` once all that is fed ended.

        Several streams may be fed at once. If one ends in an exception, the operator is closed, and
        the exception is raised at the end of its block. If the block ends first, a list is fed to
        its end as long as there is room for its items, and any other stream is cut off, which is
        logged; it is an error if nobody has read an item by then.

        Raises:
            Closed: if the operator takes no more messages.
            ConfigError: if these are no messages, such as a str.
        """
        self._running("feed")
        check_messages(messages)
        source: object = messages
        if source is self:
            raise ConfigError("an operator is not fed with its own items; read them")
        if self._is_last:
            raise Closed("the operator takes no more messages; feed all streams before one ends")
        task = asyncio.get_running_loop().create_task(self._feed(messages))
        task.set_name(f"{self.name}: feed")
        self._feeds[task] = isinstance(messages, Sized)
        task.add_done_callback(self._fed)

    def close(self) -> None:
        """Take no more messages; the items end once all are answered."""
        self._check_thread("close")
        self._is_last = True
        if self._driver is not None:
            self._driver.close()
        self._writers.wake()
        self._end_if_idle()

    def stop(self) -> None:
        """End at once: calls are aborted, open messages stay unanswered, the items end.

        Handlers and policies may call it too: the message or result that they are called about is
        the last that happens.
        """
        self._check_thread("stop")
        self._is_stopped = self._is_stopped or not self._is_over
        self._end()

    def _end(self) -> None:
        if self._is_over or self._driver is None:
            return
        self._is_last = self._is_over = True
        if self._unread_timer is not None:
            self._unread_timer.cancel()
        for task in self._feeds:
            task.cancel()
        self._driver.stop()
        self._writers.wake()
        self._readers.wake()

    # Items.

    def __aiter__(self) -> AsyncIterator[Item[V]]:
        return self

    async def __anext__(self) -> Item[V]:
        """The next item; the end once no more messages come and all are answered."""
        if self._driver is None or threading.get_ident() != self._thread:
            self._running("read")
        while not self._items:
            if self._is_over:
                raise StopAsyncIteration
            await self._readers.wait()
        return self._take_item()

    async def read(self, timeout: float | None = None) -> Item[V] | None:
        """The next item; None if none comes within so many seconds, or none will come any more."""
        self._running("read")
        timeout = check_timeout(timeout)
        loop = asyncio.get_running_loop()
        until = None if timeout is None else loop.time() + timeout
        timer = None if until is None else loop.call_at(until, self._readers.wake)
        try:
            while not self._items:
                if self._is_over or (until is not None and loop.time() >= until):
                    return None
                await self._readers.wait()
        finally:
            if timer is not None:
                timer.cancel()
        return self._take_item()

    def _take_item(self) -> Item[V]:
        item = self._items.popleft()
        self._read_count += 1
        if self._writers.waiters and len(self._items) < self._output_len:
            self._writers.wake()
        return item

    def _give_back(self, item: Item[V]) -> None:
        """An item that whoever read it did not get."""
        self._items.appendleft(item)
        self._read_count -= 1
        self._readers.wake()

    @property
    def counts(self) -> Counter[tuple[str, str, str]]:
        """What happened so far: source or operator, what it is about, and what became of it.

        For instance ``counts["west", "result", "forwarded"]``. They are those of the Rust
        operator's `Tally`: ``counts[name, "message", "accepted"]`` are the messages taken on,
        those refused are not among them. A source also has ``"request", "lost"``, computations
        that counted as lost, and ``"failed because"`` with each of its first eight reasons;
        failures of other reasons are counted as ``"other reasons"``. ``"handler"`` and
        ``"policy"`` are ``"failed"``, a handler ``"held up the loop"``, the operator's
        ``"timer"`` is ``"late"`` and a ``"message"`` that came from another thread ``"not taken"``.
        """
        counts: Counter[tuple[str, str, str]] = Counter()
        if self._driver is not None:
            # Two sources may have one name.
            for key, count in self._driver.counting.counts():
                counts[key] += count
        for side in self._handlers.sides:
            for outcome, count in side.counts.items():
                counts[side.name, "side request", outcome] = count
        if self._not_taken:
            counts[self.name, "message", "not taken"] = self._not_taken
        return counts

    @property
    def greatest_lag(self) -> float:
        """The seconds that the loop was held up at most; 0 if never longer than ``lag_warning``."""
        return 0.0 if self._driver is None else self._driver.counting.greatest_lag / 1e9

    @property
    def deadlines(self) -> dict[str, CurrentDeadline]:
        """The deadline in force of each cloud, by its name: that of its latest offer, and why."""
        if self._driver is None:
            return {}
        in_force = self._driver.counting.deadlines()
        return {name: CurrentDeadline(ns(deadline), why) for name, deadline, why in in_force}

    @property
    def unrecorded(self) -> OSError | None:
        """The error that ended the recording early, or what became of its file, if that is lost."""
        return None if self._driver is None else self._driver.unrecorded

    def _running(self, method: str) -> Driver[M, V]:
        if self._driver is None:
            raise ConfigError("the operator has not started; use it with `async with`")
        self._check_thread(method)
        return self._driver

    def _check_thread(self, method: str) -> None:
        if self._thread is None or threading.get_ident() == self._thread:
            self._check_loop(method)
            return
        if self._thread == _FORKED:
            raise RuntimeError(
                f"{method} in a process that was forked; the operator runs in the one that started "
                "it: make one here"
            )
        if method == "write":
            remedy = "use write_threadsafe"
        else:
            remedy = f"let its loop do it: loop.call_soon_threadsafe(operator.{method})"
        raise RuntimeError(f"{method} in another thread than the operator's loop; {remedy}")

    def _check_loop(self, method: str) -> None:
        running = _running_loop()
        if self._loop is None or running is self._loop:
            return
        if self._loop.is_closed() and not self._is_over:
            raise Closed(f"{method} after the operator's loop has ended; an operator has one loop")
        if running is not None and not self._is_over:
            raise RuntimeError(f"{method} in another loop than the operator's; it has one loop")

    def _names(self) -> list[str]:
        """What has a name of its own in counts."""
        sides = [side.name for side in self._handlers.sides]
        return [self.name, *sides, *(it.cloud.name or "" for it in self._clouds)]

    def _has_room(self) -> bool:
        driver = self._driver
        is_open = driver is not None and driver.has_room(self._window)
        return is_open and len(self._items) < self._output_len

    def _put(self, item: Item[V]) -> None:
        if item.revision > 0:
            for place, earlier in enumerate(self._items):
                if earlier.timestamp == item.timestamp:
                    # F9, D8: nobody has read it, and nobody needs it any more.
                    item._takes_the_place_of(earlier)
                    del self._items[place]
                    break
        self._items.append(item)
        if self._readers.waiters:
            self._readers.wake()
        elif self._is_ending and self._writers.waiters:
            # What is fed may have to give up.
            self._writers.wake()

    def _end_if_idle(self) -> None:
        driver = self._driver
        if self._writers.waiters and self._has_room():
            self._writers.wake()
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
            _log.exception("%s: the situation's handler failed: nothing is known", self.name)
            driver.counting.handler_failed(None)
            driver.set_situation(Situation())

    async def _feed(self, messages: AsyncIterable[M] | Iterable[M]) -> None:
        written = [0]
        try:
            await self._write_each(messages, written)
        except Closed:
            self._cut_off(messages, written[0])
        except BaseException as error:
            # Whatever ends the stream, also the cancellation of a task that it waits for, nobody
            # is to wait for its messages.
            if not self._is_over:
                self._feed_error = self._feed_error or error
                self.close()
            elif not self._is_stopped:
                self._cut_off(messages, written[0])
            if not isinstance(error, Exception):
                raise

    def _fed(self, task: asyncio.Task[None]) -> None:
        """A stream has ended; with the last one no more messages come."""
        del self._feeds[task]
        if not task.cancelled():
            # It is raised at the end of the block.
            task.exception()
        if not self._feeds and not self._is_last:
            self.close()

    def _cut_off(self, messages: AsyncIterable[M] | Iterable[M], written: int) -> None:
        """The operator was closed while messages were fed, so many of which were written."""
        if not isinstance(messages, Sized):
            _log.info("%s: closed while a stream was fed, after %d messages", self.name, written)
        elif (left := len(messages) - written) > 0:
            with self._way:
                self._not_taken += left
            _log.warning(
                "%s: closed while messages were fed: %d were taken, %d were not",
                self.name,
                written,
                left,
            )

    async def _end_feeds(self) -> None:
        """The block ends while messages are fed: if nobody read an item, that is a mistake."""
        if not self._feeds or self._is_last or self._read_count or self._readers.waiters:
            return
        self._is_ending = True
        self._writers.wake()
        if finite := [task for task, is_finite in self._feeds.items() if is_finite]:
            await asyncio.wait(finite)
        if self._feeds and self._feed_error is None:
            self._feed_error = Closed(f"the block ended while messages were fed, {_UNREAD}")

    def _watch_unread(self) -> None:
        """A stream waits for room: if nobody reads the items, that is reported."""
        if len(self._items) < self._output_len or self._loop is None:
            return
        if self._is_ending and not self._readers.waiters:
            raise Full(f"{len(self._items)} items wait to be read, {_UNREAD}")
        if self._unread_timer is None:
            self._read_before = self._read_count
            self._unread_timer = self._loop.call_later(UNREAD_SECONDS, self._report_unread)

    def _report_unread(self) -> None:
        self._unread_timer = None
        if not self._writers.waiters:
            return
        is_unread = self._read_count == self._read_before
        self._watch_unread()
        if is_unread:
            _log.warning(
                "%s: %d items wait to be read, and none was read for %s s: no message is taken",
                self.name,
                len(self._items),
                UNREAD_SECONDS,
            )


#: Operators that were started, for processes that are forked: they go on where they were started.
_STARTED: weakref.WeakSet[Operator[Any, Any]] = weakref.WeakSet()


def _forked() -> None:
    for operator in list(_STARTED):
        operator._thread = _FORKED


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)
