"""Reads an operator's clock, sets its timer and runs its calls. No other module does."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Coroutine, Iterable, Iterator
from typing import Any, Generic, TypeAlias, TypeVar

from fuseline._encoding import EncodedRequest, Encoder, share_encoded
from fuseline._errors import in_one_line
from fuseline._fuseline import Calls, Engine
from fuseline._item import Call, Ending, Item, Lineage, check_capture
from fuseline._local import Local
from fuseline._loop import LONGEST_SLEEP
from fuseline._recording import GRACE, Recording
from fuseline._sources import (
    OutputHandlers,
    RegisteredCloud,
    SourceTasks,
    awaited_value,
    response_of,
    value_of,
)
from fuseline._tracefile import TraceFile
from fuseline._validation import ns
from fuseline._wiring import (
    WiringError,
    check_read,
    check_value,
    no_value,
)
from fuseline.deadline import Situation

M = TypeVar("M")
V = TypeVar("V")

#: A source as the extension takes it: its priority, its tasks, their greatest number, its handle,
#: its response handler, True if its requests are encoded, the name of its tasks, and True if its
#: results are copied.
_Source: TypeAlias = (
    "tuple[int, SourceTasks, int, Callable[..., Any], Callable[[Any], Any] | None, bool, str, bool]"
)

#: A lineage as the engine takes it: with its age instead of the capture.
LineageFields: TypeAlias = "tuple[str | None, int | None, int | None, Any, list[str]]"

#: An operator's clock: whole nanoseconds that never go back.
Clock = Callable[[], int]

# Reading a member of an enumeration takes several times as long as reading a module's global.
_FORWARDED, _PRELIMINARY = Ending.FORWARDED, Ending.PRELIMINARY
_FINAL = Ending.FINAL

#: A source gets no more requests once this many of its tasks continue beyond its bound (D8).
OVERDUE_TASKS = 1024

_log = logging.getLogger("fuseline")


class Driver(Generic[M, V]):
    """Drives an engine on an event loop. The engine's clock starts at 0.

    Args:
        name: The operator's name.
        engine: The engine.
        local: Computes on board. It has been started.
        clouds: The engine's clouds.
        handlers: The handlers of items and messages.
        clock: Reads whole nanoseconds.
        output: Takes each item, in the order of the decisions.
        acted: Called after an input whose effects were carried out, if anybody is in `waiting` or
            `close` was called.
        waiting: The tasks that wait for room.
        lag_warning: The longest time in nanoseconds for which a handler may block the loop without
            being counted.
        trace: The file of the recording.
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
        waiting: list[Any],
        lag_warning: int,
        trace: TraceFile | None,
    ) -> None:
        self.name = name
        self.counting = engine.counting
        self._engine = engine
        self._local = local
        self._clouds, self._handlers = list(clouds), handlers
        #: The open messages, if items carry them.
        self._messages: dict[int, M] | None = {} if handlers.carry_messages else None
        #: The latest message that was accepted.
        self._taken_on: int | None = None
        self._sources = {0: SourceTasks(local.at_once + OVERDUE_TASKS, None)}
        for cloud in self._clouds:
            limit = 2 * cloud.calls + OVERDUE_TASKS
            encoder = None
            if cloud.encode is not None:
                encoder = Encoder(name, cloud, cloud.encode, self.counting, clock)
            self._sources[cloud.cloud.p] = SourceTasks(limit, cloud, encoder)
        #: The sources whose wiring was reported as wrong.
        self._miswired_sources: set[int] = set()
        #: The lineages of the open messages that have one.
        self._lineages: dict[int, Lineage] = {}
        self._read_clock, self._lag_warning = clock, lag_warning
        self._output = output
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._calls = Calls(
            engine,
            self,
            clock,
            self._lag_warning,
            self.counting,
            local.deadline,
            [self._source_of(p, source) for p, source in self._sources.items()],
            self._loop.create_task,
            output,
            acted,
            waiting,
            self._lineages,
            handlers.states,
            handlers.carry_messages,
        )
        self.recording = Recording(name, engine, self._calls, trace)

    @property
    def is_idle(self) -> bool:
        """Returns True if no message is open and nothing is being decided."""
        return self._calls.is_idle

    def has_room(self, window: int) -> bool:
        """Returns True if fewer messages than `window` are open, as far as is known now."""
        return self._calls.has_room(window)

    def close(self) -> None:
        """Accepts no more messages."""
        self._calls.close()

    def set_situation(self, situation: Situation) -> None:
        """Sets the vehicle's situation for policies from now on."""
        if not self._calls.is_over:
            self._engine.set_situation(situation)

    def now(self) -> int:
        """Returns the instant, in nanoseconds since the start."""
        return self._calls.now()

    def fields_of(self, now: int, lineage: Lineage) -> LineageFields:
        """Returns the fields of a lineage that the engine takes.

        Raises:
            TimeError: if the capture was read from another clock.
        """
        if (captured := lineage.captured) is not None:
            check_capture(captured, self._calls.start + now)
        age, missing = self._age(now, lineage), list(lineage.missing)
        return lineage.origin, lineage.seq, age, lineage.within, missing

    def open(
        self, now: int, t: int, message: M, lineage: Lineage | None, fields: LineageFields | None
    ) -> None:
        """Opens a message. Its offers have one instant, so equal deadlines end together."""
        calls = self._calls
        if self._messages is not None:
            self._messages[t] = message
        if lineage is not None:
            self._lineages[t] = lineage
        calls.open(now, t, message, self._offers(t, message), fields)
        if self._handlers.sides and self._taken_on == t and not calls.is_over:
            call = Call(t, 0.0, lineage, None if fields is None else _seconds(fields[2]))
            for side in self._handlers.sides:
                side.on_message(message, call)

    def stop(self) -> None:
        """Ends at once: aborts calls, and completes the trace up to here.

        A handler or a policy may call it while an input is handled. That input is then the last
        one, and it starts no calls.
        """
        if not self._calls.stop():
            return
        if self._timer is not None:
            self._timer.cancel()
        for source in self._sources.values():
            for t in list(source.in_flight):
                source.abort(t)
            if source.encoder is not None:
                source.encoder.stop()
        for side in self._handlers.sides:
            for task in side.stop():
                aborted = self._sources[0].aborted
                aborted.add(task)
                task.add_done_callback(aborted.discard)
        self._local._stop()
        self.recording.end(self._loop)

    async def finish(self) -> None:
        """Waits until the trace is written, and a while for aborted calls to end."""
        aborted = [task for source in self._sources.values() for task in source.aborted]
        await wait_for_cancelled(self.name, "aborted calls", aborted)
        await self.recording.finish()

    def _age(self, now: int, lineage: Lineage) -> int | None:
        """Returns the nanoseconds since the capture, or 0 if the capture is in the future."""
        captured = lineage.captured
        return None if captured is None else max(self._calls.start + now - captured, 0)

    def _source_of(self, p: int, source: SourceTasks) -> _Source:
        """Returns a source as the extension takes it."""
        cloud = source.cloud
        if cloud is None:
            named = f"{self.name}: local"
            copies = self._handlers.copy_messages
            return p, source, source.limit, self._local._run, None, False, named, copies
        encodes, named = source.encoder is not None, f"{self.name}: {cloud.cloud.name}"
        return p, source, source.limit, cloud.handle, cloud.response_handler, encodes, named, False

    # The extension calls these methods.

    def _call_of(self, now: int, t: int, left: float) -> Call:
        """Returns the `Call` of a message that may have a lineage."""
        lineage = self._lineages.get(t)
        return Call(
            t, left, lineage, None if lineage is None else _seconds(self._age(now, lineage))
        )

    def _abort(self, p: int, t: int) -> None:
        self._sources[p].abort(t)

    def _replace(self, t: int) -> None:
        self._local._replace(t)

    def _give(self, item: Item[V]) -> None:
        """Completes an item and outputs it."""
        t = item.timestamp
        if self._lineages:
            lineages = self._lineages
            item.lineage = lineages.pop(t, None) if item.last else lineages.get(t)
        if (messages := self._messages) is not None:
            item.message = messages.pop(t, None) if item.last else messages.get(t)
        self._complete(item)
        self._output(item)

    def _complete(self, item: Item[V]) -> None:
        """Takes over the state of a result, and adds the substitute where there is no result."""
        handlers, ending = self._handlers, item.ending
        try:
            if ending is _FORWARDED or ending is _PRELIMINARY:
                t = item.timestamp if item.of is None else item.of
                for state, state_of in handlers.states:
                    read = state_of(item.value)
                    check_read(read, "state_of")
                    state.sent(t, read)
            elif ending is not _FINAL and handlers.substitute is not None:
                # Every message leads to something to send (E4).
                substitute = handlers.substitute(item)
                check_value(substitute, "the substitute's handler", "make it a plain function")
                item.value = item.substitute = substitute
                if item.substitute is not None:
                    # Only the handler knows the substitute's age (E7).
                    item.age = None
        except (Exception, asyncio.CancelledError):
            _log.exception("%s: a handler of message %d failed", self.name, item.timestamp)
            self.counting.handler_failed(None)

    def _arm(self, due: int, now: int) -> None:
        """Sets the timer. It is never moved later, which would cost more than it saves."""
        if self._timer is not None:
            self._timer.cancel()
        left = min(max(due - now, 0), LONGEST_SLEEP)
        self._timer = self._loop.call_at(self._loop.time() + left / 1e9, self._wake_up)

    def _wake_up(self) -> None:
        self._timer = None
        self._calls.wake_up()

    def _offers(self, t: int, message: M) -> Iterator[tuple[int, Any, ns]]:
        """Yields the offers to clouds for a message that was accepted."""
        encoded: list[EncodedRequest] = []
        for it in self._clouds:
            begin = self._read_clock()
            try:
                wanted = it.message_handler(message, t)
                if wanted is None:
                    continue
                request, deadline = wanted
                if it.encode is not None:
                    request = share_encoded(it.encode, request, encoded)
                offer = it.cloud.p, request, it.deadline_of(deadline)
            except (Exception, asyncio.CancelledError):
                _log.exception("%s: the message handler of %s failed", self.name, it.cloud.name)
                self.counting.handler_failed(it.cloud.p)
                continue
            finally:
                took = self._read_clock() - begin
                if took > self._lag_warning:
                    self.counting.check_handler_time(it.cloud.p, took)
            yield offer
        self._taken_on = t

    def _awaiting(self, p: int, t: int, returned: Any) -> Coroutine[Any, Any, None]:
        """Returns the task for an awaitable of a handle or of local that is not a coroutine."""
        cloud = self._sources[p].cloud
        work = value_of(returned) if cloud is None else response_of(cloud, returned)
        return self._settled(p, t, work)

    def _encoded(self, p: int, request: EncodedRequest, call: Call) -> Coroutine[Any, Any, None]:
        """Returns the task for a call whose request is to be encoded."""
        encoder = self._sources[p].encoder
        assert encoder is not None
        return self._settled(p, call.timestamp, encoder.call(request, call))

    def _value_later(self, p: int, t: int, value: Awaitable[Any]) -> Coroutine[Any, Any, None]:
        """Returns the task for an awaitable that a response handler returned."""
        return self._settled(p, t, awaited_value(value))

    async def _settled(self, p: int, t: int, work: Awaitable[Any]) -> None:
        try:
            value = await work
        except BaseException as error:
            self._failed(p, t, error)
        else:
            self._calls.came(p, t, value)

    def _without_value(self, p: int, t: int) -> None:
        """Fails a call whose result is None, most likely because a ``return`` is missing."""
        cloud = self._sources[p].cloud
        what = "local" if cloud is None else "the handle or the response handler"
        self._failed(p, t, no_value(what))

    def _failed(self, p: int, t: int, error: BaseException) -> None:
        """Takes an error of a call or of local as a failure of its message alone (D7)."""
        is_cancelled = isinstance(error, asyncio.CancelledError)
        in_flight = self._sources[p].in_flight
        if t in in_flight:
            del in_flight[t]
            why = "cancelled" if is_cancelled else type(error).__name__
            try:
                why = why if is_cancelled else in_one_line(error)
            finally:
                # The call has failed, even if reading the error's text raises another error.
                self._calls.fail(self._calls.now(), t, p, why)
        elif is_cancelled:
            raise error
        if isinstance(error, WiringError):
            self._report_wiring_error(p, error)
        if not isinstance(error, Exception) and not is_cancelled:
            raise error

    def _report_wiring_error(self, p: int, error: WiringError) -> None:
        """Counts a mistake that each call will repeat, and logs it once for each source."""
        self.counting.handler_failed(p)
        if p not in self._miswired_sources:
            self._miswired_sources.add(p)
            cloud = self._sources[p].cloud
            name = "local" if cloud is None else cloud.cloud.name
            _log.error("%s: %s: %s", self.name, name, error)


def _seconds(nanos: int | None) -> float | None:
    return None if nanos is None else nanos / 1e9


async def wait_for_cancelled(
    name: str, what: str, tasks: Iterable[asyncio.Task[Any]], seconds: float = GRACE
) -> None:
    """Waits until tasks that were cancelled have ended, but no longer than ``seconds``."""
    left = set(tasks)
    if left:
        _, left = await asyncio.wait(left, timeout=seconds)
    if left:
        _log.warning("%s: %d %s have not ended in %s s: they go on", name, len(left), what, seconds)
