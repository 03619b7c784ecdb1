"""The only place that reads an operator's clock, sets its timer and runs its calls."""

from __future__ import annotations

import asyncio
import logging
import os
from collections import deque
from collections.abc import Awaitable, Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from types import CoroutineType
from typing import Any, Generic, TypeVar

from fuseline._encoding import EncodedRequest
from fuseline._errors import in_one_line
from fuseline._fuseline import Engine, Latency, TimedSteps, nanoseconds
from fuseline._item import Call, Effect, Ending, Item, Lineage, StampedValue
from fuseline._local import Local
from fuseline._side import SideRequest
from fuseline._state import CarriedState
from fuseline._threads import DaemonThreads
from fuseline._wiring import (
    PLAIN_TYPES,
    WiringError,
    check_awaitable,
    check_value,
    is_awaitable,
)
from fuseline._words import Cloud, ns
from fuseline.deadline import Policy, Situation

M = TypeVar("M")
V = TypeVar("V")

#: An operator's clock: whole nanoseconds that never go back.
Clock = Callable[[], int]

# An enumeration takes several times as long to give a member as a module.
_FORWARDED, _PRELIMINARY = Ending.FORWARDED, Ending.PRELIMINARY
_FINAL, _REFUSED = Ending.FINAL, Ending.REFUSED

#: The longest sleep, in nanoseconds: a day.
_DAY = 86_400_000_000_000
#: How many tasks of a source that should have ended may go on, before it gets no more (D8).
OVERDUE_TASKS = 1024
#: How many seconds an operator that ends waits for tasks that it has cancelled.
GRACE = 1.0

_log = logging.getLogger("fuseline")


@dataclass(slots=True)
class RegisteredCloud:
    """A cloud, and what its requests are made of and go to."""

    cloud: Cloud
    handle: Callable[[Any, Call], Awaitable[Any]]
    message_handler: Callable[[Any, int], tuple[Any, Any] | None]
    response_handler: Callable[[Any], Any]
    #: Makes the request of what the message handler returns, in a thread.
    encode: Callable[[Any], Any] | None
    calls: int
    linger: ns
    policy: Policy | None
    max_age: int
    #: The last deadline that was a float, and its nanoseconds: mostly it is the same object.
    last_deadline: tuple[float, ns] = (0.0, ns(0))

    def deadline_of(self, deadline: Any) -> ns:
        """What the message handler returned for a deadline, in nanoseconds."""
        last = self.last_deadline
        if deadline is last[0]:
            return last[1]
        nanos = nanoseconds(deadline)
        if type(deadline) is float:
            self.last_deadline = deadline, nanos
        return nanos


@dataclass(slots=True)
class OutputHandlers:
    """What is done with items beside sending them, and with messages beside computing them."""

    #: E4: gives what is sent for a message that is missed or refused.
    substitute: Callable[[Item[Any]], Any] | None = None
    #: E10: states, each with what reads it from a result that is sent.
    states: list[tuple[CarriedState[Any], Callable[[Any], Any]]] = field(default_factory=list)
    sides: list[SideRequest] = field(default_factory=list)
    #: What records how long messages take.
    latency: Latency | None = None
    #: Whether items carry their messages.
    carry_messages: bool = False


@dataclass(slots=True)
class SourceTasks:
    """The calls or computations of one source."""

    #: The most that may go on, those included that should have ended.
    limit: int
    cloud: RegisteredCloud | None
    #: For requests that are to be encoded.
    encoders: DaemonThreads | None = None
    #: By timestamp; those that linger too. None for a task that is about to be made.
    in_flight: dict[int, asyncio.Task[None] | None] = field(default_factory=dict)
    #: Those that were cancelled and have not ended.
    aborted: set[asyncio.Task[None]] = field(default_factory=set)

    def abort(self, t: int) -> None:
        """Cancel a task; what it still returns is of no use."""
        task = self.in_flight.pop(t, None)
        if task is not None:
            self.aborted.add(task)
            task.add_done_callback(self.aborted.discard)
            task.cancel()


class Driver(Generic[M, V]):
    """An engine with its loop; it starts with its clock at 0.

    Args:
        name: The operator's name.
        engine: The engine.
        local: What computes on board; it was started.
        clouds: Those of the engine.
        handlers: What goes with items and messages.
        clock: Reads whole nanoseconds.
        output: Takes each item, in the order of the decisions.
        acted: Called after each input that led to something, once that is done.
        lag_warning: How many nanoseconds a handler may hold up the loop and is not counted.
    """

    def __init__(
        self,
        name: str,
        engine: Engine,
        local: Local[M, V],
        clouds: Iterable[RegisteredCloud],
        handlers: OutputHandlers,
        clock: Clock,
        output: Callable[[Item[V]], None],
        acted: Callable[[], None],
        lag_warning: int,
    ) -> None:
        self.name = name
        self.counting = engine.counting
        self.is_over = False
        #: Whether an input is being decided about or carried out, and whether it is the last one.
        self._is_deciding = self._is_last = False
        self._engine = engine
        self._local = local
        self._clouds, self._handlers = list(clouds), handlers
        #: The open messages, if items carry them.
        self._messages: dict[int, M] | None = {} if handlers.carry_messages else None
        #: The latest message that was taken on.
        self._taken_on: int | None = None
        self._sources = {0: SourceTasks(local.at_once + OVERDUE_TASKS, None)}
        for cloud in self._clouds:
            limit = 2 * cloud.calls + OVERDUE_TASKS
            encoders = None
            if cloud.encode is not None:
                threads = min(cloud.calls, os.cpu_count() or 1)
                encoders = DaemonThreads(partial(_same, cloud.encode), threads, "fuseline-encode")
            self._sources[cloud.cloud.p] = SourceTasks(limit, cloud, encoders)
        #: The sources whose wiring was reported as wrong.
        self._miswired_sources: set[int] = set()
        self._effects: deque[Effect] = deque()
        #: Of the open messages that have one.
        self._lineages: dict[int, Lineage] = {}
        self._read_clock, self._lag_warning = clock, lag_warning
        self._output, self._acted = output, acted
        self._loop = asyncio.get_running_loop()
        self._create_task: Callable[..., asyncio.Task[None]] = self._loop.create_task
        self._start, self._now = clock(), 0
        self._timer: asyncio.TimerHandle | None = None
        #: What the timer is set to.
        self._armed = 0
        #: Done once the trace is written.
        self._finished: asyncio.Future[None] | None = None
        self._error: OSError | None = None

    @property
    def is_idle(self) -> bool:
        """Whether no message is open, and nothing is being decided."""
        return self.is_over or (not self._is_deciding and self._engine.is_idle)

    def has_room(self, window: int) -> bool:
        """Whether fewer messages are open, as far as that can be known now."""
        return self.is_over or (not self._is_deciding and self._engine.open_len < window)

    @property
    def unrecorded(self) -> OSError | None:
        """The error that ended the recording early, if one did."""
        why = self.counting.unrecorded
        return self._error if why is None else OSError(why)

    def set_situation(self, situation: Situation) -> None:
        """Set what policies know of the vehicle from now on."""
        if not self.is_over:
            self._engine.set_situation(situation)

    def open(self, t: int, message: M, lineage: Lineage | None) -> None:
        """A message came."""
        # One instant for the open and all offers: equal deadlines end together.
        now = self._clock()
        offers = self._offers(t, message)
        fields = None
        if self._messages is not None:
            self._messages[t] = message
        if lineage is not None:
            self._lineages[t] = lineage
            age, missing = self._age(now, lineage), list(lineage.missing)
            fields = lineage.origin, lineage.seq, age, lineage.within, missing
        self._decide(now, self._engine.open, t, self._local.deadline, message, offers, fields)
        if self._taken_on == t and not self.is_over:
            call = Call(t, 0.0, lineage, None if fields is None else _seconds(fields[2]))
            for side in self._handlers.sides:
                side.on_message(message, call)

    def stop(self) -> None:
        """End at once: calls are aborted, and the trace is whole up to here.

        A handler or a policy may call it in the midst of an input: then that is the last one, and
        no call begins of it.
        """
        if self.is_over:
            return
        if self._is_deciding:
            self._is_last = True
            return
        self.is_over = True
        if self._timer is not None:
            self._timer.cancel()
        for source in self._sources.values():
            for t in list(source.in_flight):
                source.abort(t)
            if source.encoders is not None:
                source.encoders.stop()
        for side in self._handlers.sides:
            for task in side.stop():
                aborted = self._sources[0].aborted
                aborted.add(task)
                task.add_done_callback(aborted.discard)
        self._local._stop()
        self._engine.end(self._clock())
        if not self._engine.is_recording:
            self._engine.finish()
            return
        # A thread of its own: the loop's may all be at work for calls that hang.
        writer = ThreadPoolExecutor(1, "fuseline-trace")
        self._finished = self._loop.run_in_executor(writer, self._engine.finish)
        writer.shutdown(wait=False)

    async def finish(self) -> None:
        """Wait until the trace is written, and a while for aborted calls to end."""
        aborted = [task for source in self._sources.values() for task in source.aborted]
        await wait_for_cancelled(self.name, "aborted calls", aborted)
        if self._finished is not None:
            try:
                await self._finished
            except OSError as error:
                self._error = error

    def _age(self, now: int, lineage: Lineage) -> int | None:
        """Nanoseconds since the capture; 0 if it is still to come."""
        captured = lineage.captured
        return None if captured is None else max(self._start + now - captured, 0)

    def _lineage_of(self, now: int, t: int) -> tuple[Lineage | None, float | None]:
        """What an open message comes from, and how many seconds old it is."""
        lineage = self._lineages.get(t)
        return lineage, None if lineage is None else _seconds(self._age(now, lineage))

    def _clock(self) -> int:
        """Nanoseconds since the start; a clock that goes back stands still."""
        now = self._read_clock() - self._start
        if now < self._now:
            return self._now
        self._now = now
        return now

    def _decide(self, now: int, apply: Callable[..., list[Effect]], *of: Any) -> None:
        """Apply an input, and do what the engine says."""
        self._is_deciding = True
        try:
            self._effects.extend(apply(now, *of))
            self._act(now)
        finally:
            self._is_deciding = False
            if self._is_last:
                self.stop()
        self._acted()

    def _act(self, now: int) -> None:
        """Do what the engine says."""
        effects = self._effects
        while effects:
            effect = effects.popleft()
            if effect[0] == "start":
                _, p, t, until, request = effect
                self._begin(now, p, t, until, request)
            elif effect[0] == "output":
                item = effect[1]
                if self._lineages:
                    t = item.timestamp
                    lineages = self._lineages
                    item.lineage = lineages.pop(t, None) if item.last else lineages.get(t)
                if (messages := self._messages) is not None:
                    t = item.timestamp
                    item.message = messages.pop(t, None) if item.last else messages.get(t)
                self._complete(item)
                self._output(item)
            elif effect[0] == "replace":
                self._local._replace(effect[1])
            else:
                self._sources[effect[1]].abort(effect[2])
        if self.is_over:
            return
        due = self._engine.next_due
        if due is not None and (self._timer is None or due < self._armed):
            self._arm(due, now)

    def _complete(self, item: Item[V]) -> None:
        """Take over the state of a result, and give what is sent without one."""
        handlers, ending = self._handlers, item.ending
        if handlers.latency is not None and item.last and ending is not _REFUSED:
            handlers.latency.record(ns(item.decided - item.opened))
        try:
            if ending is _FORWARDED or ending is _PRELIMINARY:
                t = item.timestamp if item.of is None else item.of
                for state, state_of in handlers.states:
                    state.sent(t, state_of(item.value))
            elif ending is not _FINAL and handlers.substitute is not None:
                # E4: something is sent for each message.
                item.value = item.substitute = handlers.substitute(item)
                if item.substitute is not None:
                    # E7: how old it is only the handler knows.
                    item.age = None
        except Exception:
            _log.exception("%s: a handler of message %d failed", self.name, item.timestamp)
            self.counting.handler_failed(None)

    def _arm(self, due: int, now: int) -> None:
        """Set the timer; it is never moved further away, which would cost more than it saves."""
        if self._timer is not None:
            self._timer.cancel()
        left = min(max(due - now, 0), _DAY)
        self._timer = self._loop.call_at(self._loop.time() + left / 1e9, self._wake_up)
        self._armed = due

    def _wake_up(self) -> None:
        self._timer = None
        if self.is_over:
            return
        now = self._clock()
        due = self._engine.next_due
        if due is not None and due <= now:
            self._decide(now, self._engine.tick)
        else:
            self._act(now)

    def _offers(self, t: int, message: M) -> Iterator[tuple[int, Any, ns]]:
        """What is offered to clouds for a message that was taken on."""
        encoded: list[EncodedRequest] = []
        for it in self._clouds:
            begin = self._read_clock()
            try:
                wanted = it.message_handler(message, t)
                if wanted is None:
                    continue
                request, deadline = wanted
                if it.encode is not None:
                    request = _to_encode(it.encode, request, encoded)
                offer = it.cloud.p, request, it.deadline_of(deadline)
            except Exception:
                _log.exception("%s: the message handler of %s failed", self.name, it.cloud.name)
                self.counting.handler_failed(it.cloud.p)
                continue
            finally:
                took = self._read_clock() - begin
                if took > self._lag_warning:
                    self.counting.ran(it.cloud.p, took)
            yield offer
        self._taken_on = t

    def _begin(self, now: int, p: int, t: int, until: int | None, request: Any) -> None:
        if self.is_over or self._is_last:
            return
        source = self._sources[p]
        overdue = len(source.in_flight) + len(source.aborted)
        if overdue >= source.limit:
            why = f"{overdue} calls have not ended, though they should have"
            self._effects.extend(self._engine.fail(now, t, p, why))
            return
        # A task may end while it is made, if the loop's tasks are eager.
        source.in_flight[t] = None
        if source.cloud is None:
            work = self._compute(source, t, request)
        else:
            # D5: the time left, not the time given.
            left = max((until or 0) - now, 0) / 1e9
            call = Call(t, left, *self._lineage_of(now, t)) if self._lineages else Call(t, left)
            work = self._call(source, source.cloud, request, call)
        task = self._create_task(
            TimedSteps(work, self._read_clock, self._lag_warning, self.counting, p)
        )
        if t in source.in_flight:
            source.in_flight[t] = task

    async def _compute(self, source: SourceTasks, t: int, message: M) -> None:
        try:
            value = await self._local._run(message, t)
            if type(value) not in PLAIN_TYPES:
                check_value(value, "local", "give an async def, which awaits it")
        except BaseException as error:
            self._failed(source, 0, t, error)
        else:
            self._came(source, 0, t, value)

    async def _call(
        self, source: SourceTasks, cloud: RegisteredCloud, request: Any, call: Call
    ) -> None:
        try:
            if cloud.encode is not None and source.encoders is not None:
                begin = self._read_clock()
                request = await request.get(source.encoders)
                check_value(request, "what encodes", "make it a plain function")
                took = (self._read_clock() - begin) / 1e9
                call = replace(call, deadline=max(call.deadline - took, 0.0))
            returned = cloud.handle(request, call)
            if type(returned) is not CoroutineType:
                check_awaitable(returned, "the handle")
            response = await returned
            if type(response) not in PLAIN_TYPES:
                check_value(response, "the handle", "await it there")
            value = cloud.response_handler(response)
            if type(value) not in PLAIN_TYPES and is_awaitable(value):
                value = await value
                check_value(value, "the response handler", "await it there")
        except BaseException as error:
            self._failed(source, cloud.cloud.p, call.timestamp, error)
        else:
            self._came(source, cloud.cloud.p, call.timestamp, value)

    def _came(self, source: SourceTasks, p: int, t: int, value: Any) -> None:
        if t not in source.in_flight:
            return
        del source.in_flight[t]
        of = None
        if isinstance(value, StampedValue):
            value, of = value.value, value.of
        now = self._clock()
        self._is_deciding = True
        try:
            effects = self._engine.result(now, t, p, value, of)
            # Without any nothing is due earlier than before.
            if effects:
                self._effects.extend(effects)
                self._act(now)
        finally:
            self._is_deciding = False
            if self._is_last:
                self.stop()
        if effects:
            self._acted()

    def _failed(self, source: SourceTasks, p: int, t: int, error: BaseException) -> None:
        """D7: an error of a call or of local is a failure, and no other message notices."""
        is_cancelled = isinstance(error, asyncio.CancelledError)
        if isinstance(error, WiringError):
            self._miswired(p, error)
        if t in source.in_flight:
            del source.in_flight[t]
            why = "cancelled" if is_cancelled else in_one_line(error)
            self._decide(self._clock(), self._engine.fail, t, p, why)
        elif is_cancelled:
            raise error
        if not isinstance(error, Exception) and not is_cancelled:
            raise error

    def _miswired(self, p: int, error: WiringError) -> None:
        """Every call will fail like that: counted, and logged at the first."""
        self.counting.handler_failed(p)
        if p not in self._miswired_sources:
            self._miswired_sources.add(p)
            cloud = self._sources[p].cloud
            name = "local" if cloud is None else cloud.cloud.name
            _log.error("%s: %s: %s", self.name, name, error)


def _seconds(nanos: int | None) -> float | None:
    return None if nanos is None else nanos / 1e9


def _to_encode(
    encode: Callable[[Any], Any], raw: Any, encoded: list[EncodedRequest]
) -> EncodedRequest:
    """That of another cloud of the message, if it is the same."""
    for other in encoded:
        if other.is_of(encode, raw):
            return other.share()
    encoded.append(EncodedRequest(encode, raw))
    return encoded[-1]


def _same(encode: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Encoding keeps no state: each thread has the same function."""
    return encode


async def wait_for_cancelled(
    name: str, what: str, tasks: Iterable[asyncio.Task[Any]], seconds: float = GRACE
) -> None:
    """Wait until tasks that were cancelled have ended, but no longer than this."""
    left = set(tasks)
    if left:
        _, left = await asyncio.wait(left, timeout=seconds)
    if left:
        _log.warning("%s: %d %s have not ended in %s s: they go on", name, len(left), what, seconds)
