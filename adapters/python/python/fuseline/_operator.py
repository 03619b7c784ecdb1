"""An operator within asyncio: it owns the clock, the payloads and the calls."""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import os
import time
from collections import Counter, deque
from collections.abc import (
    AsyncGenerator,
    AsyncIterable,
    AsyncIterator,
    Awaitable,
    Callable,
    Iterable,
)
from types import TracebackType
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

from fuseline._engine import Abort, Clock, Engine, Start, words
from fuseline._errors import Closed, ConfigError, Full, TraceError
from fuseline._fuseline import Fusion, nanoseconds
from fuseline._item import Call, Ending, Item, Source
from fuseline._lane import Flight, Handlers, Lane
from fuseline._local import Local, local_of
from fuseline._tape import Tape
from fuseline._words import Cloud, Commit
from fuseline.deadline import Policy, Situation, policy_of

if TYPE_CHECKING:
    from fuseline._judge import Duration

M = TypeVar("M")
V = TypeVar("V")
Req = TypeVar("Req")
Res = TypeVar("Res")

#: The longest sleep, in nanoseconds: a day.
_DAY = 86_400_000_000_000
#: How long what was recorded waits before it is written, in seconds.
_GATHER = 0.5


class Operator(Generic[M, V]):
    """Computes each message on board and in clouds, and forwards the best result that is in time.

    Each message written leads to exactly one `Item`. Use it as a context manager, in one event
    loop: at the end of the block it takes no more messages and waits until all are answered; if
    the block is left by an exception, it `stop`s.

    Args:
        local: Computes each message on board: a `Local`, an ``async def`` of a message and its
            timestamp, or a plain function of them, which runs in a thread of its own.
        name: The operator's name in logs and traces.
        window: How many messages may be open at once, 1 to 1024; one more is refused ``full`` (F1).
        commit: When the best result in hand goes although a better one is pending (F6).
        output_len: How many items the reader may lag behind. While it lags further, no message is
            taken in; what is open goes on.
        trace: The file that the run is recorded to; it is overwritten.
        clock: Reads whole nanoseconds that never go back.

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
        commit: Commit | Literal["eager", "patient"] = Commit.EAGER,
        output_len: int = 16,
        trace: str | os.PathLike[str] | None = None,
        clock: Clock = time.monotonic_ns,
    ) -> None:
        if output_len < 1:
            raise ConfigError(f"room for {output_len} items; the output needs at least 1")
        self.name = name
        #: The error that ended the recording early, if one did.
        self.unrecorded: OSError | None = None
        self._local: Local[M, V] = local_of(local)
        self._window, self._commit = window, commit
        self._output_len = output_len
        self._path = trace
        self._read_clock = clock
        self._clouds: list[tuple[Cloud, Lane[Any]]] = []
        self._situation: Callable[[M, int], Situation] | None = None
        self._engine: Engine[M, V] | None = None
        self._items: deque[Item[V]] = deque()
        self._readers: deque[asyncio.Future[None]] = deque()
        self._writers: deque[asyncio.Future[None]] = deque()
        self._tasks: set[asyncio.Task[Any]] = set()
        self._feeds: set[asyncio.Task[None]] = set()
        self._feed_error: BaseException | None = None
        self._count = 0
        self._is_last = self._is_over = self._is_acting = False
        self._timer: asyncio.TimerHandle | None = None
        self._armed = 0
        self._gather: asyncio.TimerHandle | None = None
        self._tape: Tape | None = None

    def __repr__(self) -> str:
        clouds = [cloud.name for cloud, _ in self._clouds]
        state = "over" if self._is_over else "running" if self._engine else "not started"
        return f"<Operator {self.name!r} clouds={clouds} {state}, {self._count} messages>"

    # Before the start.

    def use_cloud(
        self,
        handle: Callable[[Req, Call], Awaitable[Res]],
        message_handler: Callable[[M, int], tuple[Req, Duration] | None],
        response_handler: Callable[[Res], V] | Callable[[Res], Awaitable[V]],
        priority: int,
        *,
        name: str | None = None,
        limit: int = 31,
        resume: int = 0,
        calls: int = 8,
        policy: Policy | Callable[[Situation, int], Duration] | None = None,
        linger: Duration = 0,
    ) -> None:
        """Register a cloud; up to 15, before the operator starts.

        Args:
            handle: Makes the call: an ``async def`` of a request and its `Call`, in a task of its
                own. It is cancelled when its timer fires or another result goes (F5, F7). An
                exception is a failure (F4).
            message_handler: Looks at each message that was taken on, and its timestamp; returns the
                request and how long the cloud may take, or None not to ask it. It must not block
                and is no ``async def``: the offer belongs to the instant of its message, and costly
                encoding to the handle. If it fails, the cloud is not asked.
            response_handler: Turns the response into the result, in the call's task; may be an
                ``async def``. The result counts as arrived when it is done.
            priority: 1 to 65535, different for each cloud; the greater wins.
            name: For people and traces; ``cloud-`` and the priority by default.
            limit: The gate shuts when this many requests wait to be sent (F2g).
            resume: The shut gate opens when this many or fewer wait.
            calls: How many calls may be under way; further requests wait.
            policy: Chooses how long each request may take, at most what the message handler says,
                and learns how each ended: see `fuseline.deadline`. A plain function of a
                `Situation` and the most, in nanoseconds, will do.
            linger: How long a call may run on after it was due, so that the policy learns how long
                it really takes. What comes then is still dropped (F3).

        Durations are whole nanoseconds as an int, seconds as a float, or a timedelta.

        Raises:
            ConfigError: if the operator has started, or ``calls`` is below 1, or the message
                handler is an ``async def``.
        """
        if self._engine is not None:
            raise ConfigError("a cloud after the start; register it before")
        if calls < 1:
            raise ConfigError(f"{calls} calls at once; a cloud needs at least 1")
        if inspect.iscoroutinefunction(message_handler):
            raise ConfigError(
                "a message handler is a plain function; costly encoding belongs in the handle"
            )
        name = name or f"cloud-{priority}"
        cloud = Cloud(priority, limit, resume, name)
        lane: Lane[Any] = Lane(Source(priority, name), calls)
        lane.handlers = Handlers(handle, message_handler, response_handler)
        lane.linger = nanoseconds(linger)
        lane.policy = None if policy is None else policy_of(policy)
        self._clouds.append((cloud, lane))

    def use_situation(self, situation: Callable[[M, int], Situation]) -> None:
        """Set what policies learn of the vehicle with each message taken in, above all its speed.

        Without it they know nothing, and the guard risks nothing. If it fails, nothing is known.
        """
        self._situation = situation

    async def start(self) -> None:
        """Start; ``async with`` does that.

        Raises:
            ConfigError: if there is no operator with these clouds, or it was started before.
            OSError: if its trace cannot be written.
        """
        if self._engine is not None:
            raise ConfigError("an operator is started once; make another")
        clouds = [cloud for cloud, _ in self._clouds]
        fusion = Fusion(
            clouds,
            window=self._window,
            commit=self._commit,
            operator=self.name,
            record=self._path is not None,
        )
        if self._path is not None:
            self._tape = Tape(self._path)
        local = self._local
        waiting = self._window if local.waiting is None else local.waiting
        # Clouds in ascending priority: the order of the paper's total order.
        self._engine = Engine(
            self.name,
            fusion,
            Lane(Source(0, "local"), local.at_once),
            [lane for _, lane in self._clouds],
            local.deadline,
            waiting,
            local.skip_answered,
        )
        self._loop = asyncio.get_running_loop()
        self._new_task = self._loop.create_task
        await local._start()
        self._start = self._read_clock()
        self._now = 0

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
                self.close()
                await self._until_over()
        finally:
            self.stop()
            await self._finish()
        if error is None:
            if self._feed_error is not None:
                raise self._feed_error
            if self.unrecorded is not None:
                raise TraceError(f"the trace ends early: {self.unrecorded}") from self.unrecorded

    # Messages.

    def write(self, message: M) -> int:
        """Take a message in; return its timestamp. It never waits.

        Raises:
            Full: if the reader of the items lags by ``output_len``: the message was not taken.
            Closed: if the operator takes no more messages.
        """
        engine = self._running()
        if self._is_last:
            raise Closed("the operator takes no more messages")
        if len(self._items) >= self._output_len:
            raise Full(f"{len(self._items)} items wait to be read; read them first")
        if self._is_acting:
            raise RuntimeError("a handler must not write to its own operator")
        t = self._count
        self._count += 1
        # One instant for the open and all offers: equal deadlines end together.
        now = self._clock()
        self._is_acting = True
        try:
            if self._situation is not None:
                engine.situation = self._assess(message, t)
            engine.open(now, t, message)
        finally:
            self._is_acting = False
        self._act(now)
        return t

    async def write_all(self, messages: AsyncIterable[M] | Iterable[M]) -> int:
        """Write each message as soon as the reader of the items has room; return how many.

        Raises:
            Closed: if the operator takes no more messages.
        """
        count = 0
        async with contextlib.AsyncExitStack() as stack:
            if isinstance(messages, AsyncGenerator):
                await stack.enter_async_context(contextlib.aclosing(messages))
            async for message in _each(messages):
                while len(self._items) >= self._output_len and not self._is_last:
                    await self._room()
                self.write(message)
                count += 1
        return count

    def feed(self, messages: AsyncIterable[M] | Iterable[M]) -> None:
        """Write each message in a task of the operator's own, then `close`.

        If the messages end in an exception, it is raised at the end of the operator's block.
        """
        self._running()
        task = self._loop.create_task(self._feed(messages))
        self._feeds.add(task)
        task.add_done_callback(self._feeds.discard)

    def close(self) -> None:
        """Take no more messages; the items end once all are answered."""
        self._is_last = True
        self._wake(self._writers)
        self._end_if_idle()

    def stop(self) -> None:
        """End at once: calls are aborted, open messages stay unanswered, the items end."""
        if self._is_over or self._engine is None:
            return
        self._is_last = self._is_over = True
        for timer in (self._timer, self._gather):
            if timer is not None:
                timer.cancel()
        for task in (*self._tasks, *self._feeds):
            task.cancel()
        for lane in self._engine.lanes.values():
            for flight in (*lane.flying.values(), *lane.lingering.values()):
                flight.is_aborted = True
        self._local._stop()
        self._record()
        self._wake(self._writers)
        self._wake(self._readers)

    # Items.

    def __aiter__(self) -> AsyncIterator[Item[V]]:
        return self

    async def __anext__(self) -> Item[V]:
        """The next item; the end once no more messages come and all are answered."""
        self._running()
        while not self._items:
            if self._is_over:
                raise StopAsyncIteration
            await self._wait(self._readers)
        item = self._items.popleft()
        if self._writers and len(self._items) < self._output_len:
            self._wake(self._writers)
        return item

    @property
    def counts(self) -> Counter[tuple[str, str, str]]:
        """What happened so far: source or operator, what it is about, and what became of it.

        For instance ``counts["west", "result", "forwarded"]``.
        """
        return Counter() if self._engine is None else Counter(self._engine.counts)

    # The loop.

    def _running(self) -> Engine[M, V]:
        if self._engine is None:
            raise ConfigError("the operator has not started; use it with `async with`")
        return self._engine

    def _clock(self) -> int:
        """Nanoseconds since the start; a clock that goes back stands still."""
        now = self._read_clock() - self._start
        if now < self._now:
            return self._now
        self._now = now
        return now

    def _act(self, now: int) -> None:
        """Do what the engine says."""
        assert self._engine is not None
        engine = self._engine
        orders = engine.orders
        is_told = False
        while orders:
            order = orders.popleft()
            if isinstance(order, Start):
                self._begin(order.lane, order.flight, now)
            elif isinstance(order, Abort):
                self._abort(order.lane, order.flight)
            else:
                self._items.append(order)
                is_told = is_told or order.ending is not Ending.FORWARDED
                if self._readers:
                    self._wake(self._readers)
        due = engine.next_due()
        if due is not None and (self._timer is None or due < self._armed) and not self._is_over:
            self._arm(due, now)
        if self._tape is not None and not self._is_over:
            if is_told:
                self._record()
            elif self._gather is None:
                self._gather = self._loop.call_later(_GATHER, self._record)
        if self._is_last:
            self._end_if_idle()

    def _arm(self, due: int, now: int) -> None:
        """Set the timer; it is never moved further away, which would cost more than it saves."""
        if self._timer is not None:
            self._timer.cancel()
        left = min(max(due - now, 0), _DAY)
        self._timer = self._loop.call_at(self._loop.time() + left / 1e9, self._wake_up)
        self._armed = due

    def _wake_up(self) -> None:
        self._timer = None
        if self._is_over or self._engine is None:
            return
        now = self._clock()
        due = self._engine.next_due()
        if due is not None and due <= now:
            self._engine.tick(now)
        self._act(now)

    def _begin(self, lane: Lane[Any], flight: Flight[Any], now: int) -> None:
        if self._is_over:
            return
        if lane.p == 0:
            task = self._new_task(self._compute(lane, flight))
        else:
            until = (flight.due or 0) + lane.linger
            # D5: the time left, not the time given.
            call = Call(flight.t, max(until - now, 0) / 1e9)
            task = self._new_task(self._call(lane, flight, call))
        flight.task = task
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _abort(self, lane: Lane[Any], flight: Flight[Any]) -> None:
        """D6: end a call that is no longer wanted."""
        flight.is_aborted = True
        lane.aborted()
        task: asyncio.Task[Any] = flight.task

        def ended(_: asyncio.Task[Any]) -> None:
            lane.ended()
            if lane.waiting and not self._is_over:
                engine = self._running()
                engine.send()
                self._act(self._clock())

        task.add_done_callback(ended)
        task.cancel()

    async def _compute(self, lane: Lane[Any], flight: Flight[Any]) -> None:
        try:
            value = await self._local._run(flight.request, flight.t)
        except BaseException as error:
            self._failed(lane, flight, error)
        else:
            self._came(lane, flight, value)

    async def _call(self, lane: Lane[Any], flight: Flight[Any], call: Call) -> None:
        handlers = lane.handlers
        assert handlers is not None
        try:
            value = handlers.response_handler(await handlers.handle(flight.request, call))
            if inspect.isawaitable(value):
                value = await value
        except BaseException as error:
            self._failed(lane, flight, error)
        else:
            self._came(lane, flight, value)

    def _came(self, lane: Lane[Any], flight: Flight[Any], value: V) -> None:
        if flight.is_aborted or self._is_over:
            return
        now = self._clock()
        self._running().result(now, flight.t, lane, value)
        self._act(now)

    def _failed(self, lane: Lane[Any], flight: Flight[Any], error: BaseException) -> None:
        """D7: an error of a call or of local is a failure, and no other message notices."""
        if flight.is_aborted or self._is_over:
            if not isinstance(error, Exception):
                raise error
            return
        now = self._clock()
        why = "cancelled" if isinstance(error, asyncio.CancelledError) else words(error)
        self._running().fail(now, flight.t, lane, why)
        self._act(now)
        if not isinstance(error, Exception | asyncio.CancelledError):
            raise error

    def _assess(self, message: M, t: int) -> Situation:
        assert self._situation is not None
        try:
            return self._situation(message, t)
        except Exception:
            from fuseline._engine import _log

            _log.exception("%s: the situation's handler failed: nothing is known", self.name)
            return Situation()

    async def _feed(self, messages: AsyncIterable[M] | Iterable[M]) -> None:
        try:
            await self.write_all(messages)
        except asyncio.CancelledError:
            raise
        except Closed:
            # Somebody closed it meanwhile.
            return
        except Exception as error:
            self._feed_error = error
        self.close()

    def _end_if_idle(self) -> None:
        if self._engine is not None and self._is_last and not len(self._engine.fusion):
            self.stop()

    def _record(self) -> None:
        self._gather = None
        tape = self._tape
        if tape is None or self._engine is None:
            return
        tape.write(self._engine.fusion.take_trace())
        if tape.error is not None:
            self.unrecorded = tape.error

    async def _until_over(self) -> None:
        while not self._is_over:
            await self._wait(self._readers)

    async def _finish(self) -> None:
        """Wait until aborted calls have ended and the trace is written."""
        if self._tasks:
            await asyncio.wait(set(self._tasks))
        tape, self._tape = self._tape, None
        if tape is not None:
            await asyncio.get_running_loop().run_in_executor(None, tape.close)
            self.unrecorded = tape.error

    async def _room(self) -> None:
        await self._wait(self._writers)

    async def _wait(self, waiters: deque[asyncio.Future[None]]) -> None:
        waiter = self._loop.create_future()
        waiters.append(waiter)
        try:
            await waiter
        finally:
            with contextlib.suppress(ValueError):
                waiters.remove(waiter)

    @staticmethod
    def _wake(waiters: deque[asyncio.Future[None]]) -> None:
        while waiters:
            waiter = waiters.popleft()
            if not waiter.done():
                waiter.set_result(None)


async def _each(messages: AsyncIterable[M] | Iterable[M]) -> AsyncIterator[M]:
    """Messages of either kind, with a turn for others between two of a plain one."""
    if isinstance(messages, AsyncIterable):
        async for message in messages:
            yield message
        return
    for message in messages:
        yield message
        await asyncio.sleep(0)
