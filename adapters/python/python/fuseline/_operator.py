"""An operator within asyncio: it owns the clock, the payloads and the calls."""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import logging
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
from typing import TYPE_CHECKING, Generic, Literal, TypeVar

from fuseline._drive import Clock, Driver, RegisteredCloud, wait_for_cancelled
from fuseline._errors import Closed, ConfigError, Full, TraceError
from fuseline._fuseline import Engine, nanoseconds
from fuseline._item import Call, CurrentDeadline, Item, Lineage, StampedValue
from fuseline._local import Local, local_of
from fuseline._words import Cloud, Commit, ns
from fuseline.deadline import Policy, Situation, assumes_one_output, compiled, policy_of

if TYPE_CHECKING:
    from fuseline._judge import Duration

M = TypeVar("M")
V = TypeVar("V")
Req = TypeVar("Req")
Res = TypeVar("Res")

_log = logging.getLogger("fuseline")


class Operator(Generic[M, V]):
    """Computes each message on board and in clouds, and forwards the best result that is in time.

    Each message written leads to exactly one `Item`; under progressive to one or more, the last one
    marked. Use it as a context manager, in one event
    loop: at the end of the block it takes no more messages and waits until all are answered; if
    the block is left by an exception, it `stop`s. Calls that go on although they were cancelled are
    waited for no longer than a second; a line of the log says how many are left.

    Args:
        local: Computes each message on board: a `Local`, an ``async def`` of a message and its
            timestamp, or a plain function of them, which runs in a thread of its own.
        name: The operator's name in logs and traces.
        window: How many messages may be open at once, 1 to 1024; one more is refused ``full`` (F1).
        commit: When a result is sent although a better one is pending (F6, F9).
        output_len: How many items the reader may lag behind. While it lags further, no message is
            taken in; what is open goes on. Of the items of one message it is given the newest.
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
        commit: Commit | Literal["eager", "patient", "progressive"] = Commit.EAGER,
        output_len: int = 16,
        trace: str | os.PathLike[str] | None = None,
        clock: Clock = time.monotonic_ns,
    ) -> None:
        if output_len < 1:
            raise ConfigError(f"room for {output_len} items; the output needs at least 1")
        self.name = name
        self._local: Local[M, V] = local_of(local)
        self._window, self._commit = window, commit
        self._output_len = output_len
        self._path = trace
        self._clock = clock
        self._clouds: list[RegisteredCloud] = []
        self._situation: Callable[[M, int], Situation] | None = None
        self._driver: Driver[M, V] | None = None
        self._items: deque[Item[V]] = deque()
        #: Who waits for an item, and who waits for room; each is set and cleared at once.
        self._readers, self._writers = asyncio.Event(), asyncio.Event()
        self._feeds: set[asyncio.Task[None]] = set()
        self._feed_error: Exception | None = None
        self._count = 0
        self._is_last = self._is_over = self._is_handling = False

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
        name: str | None = None,
        limit: int = 31,
        resume: int = 0,
        calls: int = 8,
        policy: Policy | Callable[[Situation, ns], Duration] | None = None,
        linger: Duration = 0.0,
        max_age: int = 0,
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
                ``async def``. The result counts as arrived when it is done. If the response says of
                which message it is, return a `StampedValue`.
            priority: 1 to 65535, different for each cloud; the greater wins.
            name: For people and traces; ``cloud-`` and the priority by default.
            limit: The gate shuts when this many requests wait to be sent (F2g).
            resume: The shut gate opens when this many or fewer wait.
            calls: How many calls may be under way; further requests wait.
            policy: Chooses how long each request may take, at most what the message handler says,
                and learns how each ended: see `fuseline.deadline`. A plain function of a
                `Situation` and the most will do.
            linger: How long a call may run on after it was due, so that the policy learns how long
                it really takes. What comes then is still dropped (F3).
            max_age: Of how many messages before the one that it is for a `StampedValue` may be.
                What is older, or of a later message, is a failure (F4).

        Durations are seconds as a float, a timedelta, or nanoseconds as `fuseline.ns`.

        Raises:
            ConfigError: if the operator has started, or ``calls`` is below 1, or ``max_age`` below
                0, or the message handler is an ``async def``.
        """
        if self._driver is not None:
            raise ConfigError("a cloud after the start; register it before")
        if calls < 1:
            raise ConfigError(f"{calls} calls at once; a cloud needs at least 1")
        if not 0 <= max_age < 2**64:
            raise ConfigError(f"values of {max_age} messages before; it must be 0 or more")
        if inspect.iscoroutinefunction(message_handler):
            raise ConfigError(
                "a message handler is a plain function; costly encoding belongs in the handle"
            )
        cloud = Cloud(priority, limit, resume, name or f"cloud-{priority}")
        self._clouds.append(
            RegisteredCloud(
                cloud,
                handle,
                message_handler,
                response_handler,
                calls,
                nanoseconds(linger),
                None if policy is None else policy_of(policy),
                max_age,
            )
        )

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
        if self._driver is not None:
            raise ConfigError("an operator is started once; make another")
        local = self._local
        engine = Engine(
            [it.cloud for it in self._clouds],
            [(it.calls, it.max_age) for it in self._clouds],
            (local.at_once, local.waiting, local.skip_answered, local.lossy),
            self._window,
            self._commit,
            self.name,
            self._path,
        )
        for it in self._clouds:
            engine.set_linger(it.cloud.p, it.linger)
            if it.policy is not None:
                if self._commit == Commit.PROGRESSIVE and assumes_one_output(it.policy):
                    raise ConfigError(
                        f"the guard of {it.cloud.name} promises what holds for one output a "
                        "message, and under progressive there may be more; give another policy, or "
                        "commit patient"
                    )
                engine.set_policy(it.cloud.p, compiled(it.policy))
        await local._start()
        self._driver = Driver(
            self.name, engine, local, self._clouds, self._clock, self._put, self._end_if_idle
        )

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
                while not self._is_over:
                    await self._readers.wait()
        finally:
            self.stop()
            await wait_for_cancelled(self.name, "feeds", self._feeds)
            if self._driver is not None:
                await self._driver.finish()
        if error is None:
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
        """
        driver = self._running()
        if self._is_last:
            raise Closed("the operator takes no more messages")
        if len(self._items) >= self._output_len:
            raise Full(f"{len(self._items)} items wait to be read; read them first")
        if self._is_handling:
            raise RuntimeError("a handler must not write to its own operator")
        t = self._count
        self._is_handling = True
        try:
            if self._situation is not None:
                self._assess(driver, self._situation, message, t)
                if self._is_last:
                    raise Closed("the situation's handler ended the operator")
            self._count += 1
            driver.open(t, message, lineage)
        finally:
            self._is_handling = False
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
                    await self._writers.wait()
                self.write(message)
                count += 1
        return count

    def feed(self, messages: AsyncIterable[M] | Iterable[M]) -> None:
        """Write each message in a task of the operator's own, then `close`.

        If the messages end in an exception, it is raised at the end of the operator's block.
        """
        self._running()
        task = asyncio.get_running_loop().create_task(self._feed(messages))
        self._feeds.add(task)
        task.add_done_callback(self._feeds.discard)

    def close(self) -> None:
        """Take no more messages; the items end once all are answered."""
        self._is_last = True
        _wake(self._writers)
        self._end_if_idle()

    def stop(self) -> None:
        """End at once: calls are aborted, open messages stay unanswered, the items end.

        Handlers and policies may call it too: the message or result that they are called about is
        the last that happens.
        """
        if self._is_over or self._driver is None:
            return
        self._is_last = self._is_over = True
        for task in self._feeds:
            task.cancel()
        self._driver.stop()
        _wake(self._writers)
        _wake(self._readers)

    # Items.

    def __aiter__(self) -> AsyncIterator[Item[V]]:
        return self

    async def __anext__(self) -> Item[V]:
        """The next item; the end once no more messages come and all are answered."""
        self._running()
        while not self._items:
            if self._is_over:
                raise StopAsyncIteration
            await self._readers.wait()
        item = self._items.popleft()
        if len(self._items) < self._output_len:
            _wake(self._writers)
        return item

    @property
    def counts(self) -> Counter[tuple[str, str, str]]:
        """What happened so far: source or operator, what it is about, and what became of it.

        For instance ``counts["west", "result", "forwarded"]``. They are those of the Rust
        operator's `Tally`: ``counts[name, "message", "accepted"]`` are the messages taken on,
        those refused are not among them. A source also has ``"request", "lost"``, computations
        that counted as lost, and ``"failed because"`` with each of its first eight reasons;
        failures of other reasons are counted as ``"other reasons"``.
        """
        counts: Counter[tuple[str, str, str]] = Counter()
        if self._driver is not None:
            # Two sources may have one name.
            for key, count in self._driver.counting.counts():
                counts[key] += count
        return counts

    @property
    def deadlines(self) -> dict[str, CurrentDeadline]:
        """The deadline in force of each cloud, by its name: that of its latest offer, and why."""
        if self._driver is None:
            return {}
        in_force = self._driver.counting.deadlines()
        return {name: CurrentDeadline(ns(deadline), why) for name, deadline, why in in_force}

    @property
    def unrecorded(self) -> OSError | None:
        """The error that ended the recording early, if one did."""
        return None if self._driver is None else self._driver.unrecorded

    def _running(self) -> Driver[M, V]:
        if self._driver is None:
            raise ConfigError("the operator has not started; use it with `async with`")
        return self._driver

    def _put(self, item: Item[V]) -> None:
        if item.revision > 0:
            for place, earlier in enumerate(self._items):
                if earlier.timestamp == item.timestamp:
                    # F9, D8: nobody has read it, and nobody needs it any more.
                    item._takes_the_place_of(earlier)
                    del self._items[place]
                    break
        self._items.append(item)
        _wake(self._readers)

    def _end_if_idle(self) -> None:
        driver = self._driver
        if self._is_last and driver is not None and driver.is_idle:
            self.stop()

    def _assess(
        self,
        driver: Driver[M, V],
        situation: Callable[[M, int], Situation],
        message: M,
        t: int,
    ) -> None:
        try:
            driver.set_situation(situation(message, t))
        except Exception:
            _log.exception("%s: the situation's handler failed: nothing is known", self.name)
            driver.set_situation(Situation())

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


def _wake(event: asyncio.Event) -> None:
    """Wake all who wait for it now."""
    event.set()
    event.clear()


async def _each(messages: AsyncIterable[M] | Iterable[M]) -> AsyncIterator[M]:
    """Messages of either kind, with a turn for others between two of a plain one."""
    if isinstance(messages, AsyncIterable):
        async for message in messages:
            yield message
        return
    for message in messages:
        yield message
        await asyncio.sleep(0)
