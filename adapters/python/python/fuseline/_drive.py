"""The only place that reads an operator's clock, sets its timer and runs its calls."""

from __future__ import annotations

import asyncio
import inspect
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from fuseline._engine import Clock, Engine, Order, words
from fuseline._item import Call, Ending, Item
from fuseline._lane import Flight, Lane
from fuseline._local import Local
from fuseline._tape import Tape

M = TypeVar("M")
V = TypeVar("V")

#: The longest sleep, in nanoseconds: a day.
_DAY = 86_400_000_000_000
#: How long what was recorded waits before it is written, in seconds.
_GATHER = 0.5


class Driver(Generic[M, V]):
    """An engine with its loop; it starts with its clock at 0.

    Args:
        engine: The engine.
        local: What computes on board; it was started.
        tape: Where the trace goes, if anywhere.
        clock: Reads whole nanoseconds.
        output: Takes each item, in the order of the decisions.
        idle: Called when no message is open any more.
    """

    def __init__(
        self,
        engine: Engine[M, V],
        local: Local[M, V],
        tape: Tape | None,
        clock: Clock,
        output: Callable[[Item[V]], None],
        idle: Callable[[], None],
    ) -> None:
        self.engine = engine
        self.is_over = False
        #: Whether an input is being decided about or carried out, and whether it is the last one.
        self._is_deciding = self._is_last = False
        #: The error that ended the recording early, if one did.
        self.unrecorded: OSError | None = None
        self._local = local
        self._tape = tape
        self._read_clock = clock
        self._output, self._idle = output, idle
        self._loop = asyncio.get_running_loop()
        self._start, self._now = clock(), 0
        self._timer: asyncio.TimerHandle | None = None
        #: What the timer is set to.
        self._armed = 0
        self._gather: asyncio.TimerHandle | None = None
        #: Aborted calls that have not ended yet.
        self._ending: set[asyncio.Task[Any]] = set()

    def open(self, t: int, message: M) -> None:
        """A message came."""
        # One instant for the open and all offers: equal deadlines end together.
        now = self._clock()
        self._decide(self.engine.open, now, t, message)

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
        for timer in (self._timer, self._gather):
            if timer is not None:
                timer.cancel()
        for lane in self.engine.lanes.values():
            for flight in (*lane.flying.values(), *lane.lingering.values()):
                flight.is_aborted = True
                if flight.task is not None:
                    flight.task.cancel()
                    self._ending.add(flight.task)
        self._local._stop()
        self._record()

    async def finish(self) -> None:
        """Wait until aborted calls have ended and the trace is written."""
        if self._ending:
            await asyncio.wait(set(self._ending))
        tape, self._tape = self._tape, None
        if tape is not None:
            await self._loop.run_in_executor(None, tape.close)
            self.unrecorded = tape.error

    def _clock(self) -> int:
        """Nanoseconds since the start; a clock that goes back stands still."""
        now = self._read_clock() - self._start
        if now < self._now:
            return self._now
        self._now = now
        return now

    def _decide(self, apply: Callable[..., None], now: int, *of: Any) -> None:
        """Apply an input, and do what the engine says."""
        self._is_deciding = True
        try:
            apply(now, *of)
            self._act(now)
        finally:
            self._is_deciding = False
            if self._is_last:
                self.stop()

    def _act(self, now: int) -> None:
        """Do what the engine says."""
        engine = self.engine
        orders = engine.orders
        is_told = False
        while orders:
            order = orders.popleft()
            if isinstance(order, Item):
                is_told = is_told or order.ending is not Ending.FORWARDED
                self._output(order)
            elif order[0] is Order.START:
                self._begin(order[1], order[2], now)
            else:
                self._abort(order[1], order[2])
        if self.is_over:
            return
        due = engine.next_due()
        if due is not None and (self._timer is None or due < self._armed):
            self._arm(due, now)
        if self._tape is not None:
            # What was missed or refused can be read along at once.
            if is_told:
                self._record()
            elif self._gather is None:
                self._gather = self._loop.call_later(_GATHER, self._record)
        if not engine.stories:
            self._idle()

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
        due = self.engine.next_due()
        if due is not None and due <= now:
            self._decide(self.engine.tick, now)
        else:
            self._act(now)

    def _begin(self, lane: Lane[Any], flight: Flight[Any], now: int) -> None:
        if self.is_over or self._is_last:
            return
        if lane.p == 0:
            task = self._loop.create_task(self._compute(lane, flight))
        else:
            until = (flight.due or 0) + lane.linger
            # D5: the time left, not the time given.
            call = Call(flight.t, max(until - now, 0) / 1e9)
            task = self._loop.create_task(self._call(lane, flight, call))
        # Its lane holds it until it has ended.
        flight.task = task

    def _abort(self, lane: Lane[Any], flight: Flight[Any]) -> None:
        """D6: end a call that is no longer wanted."""
        flight.is_aborted = True
        lane.aborted()
        task: asyncio.Task[Any] = flight.task
        self._ending.add(task)

        def ended(task: asyncio.Task[Any]) -> None:
            self._ending.discard(task)
            lane.ended()
            if lane.waiting and not self.is_over:
                self.engine.send()
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
        if flight.is_aborted or self.is_over:
            return
        now = self._clock()
        self._decide(self.engine.result, now, flight.t, lane, value)

    def _failed(self, lane: Lane[Any], flight: Flight[Any], error: BaseException) -> None:
        """D7: an error of a call or of local is a failure, and no other message notices."""
        is_cancelled = isinstance(error, asyncio.CancelledError)
        if not flight.is_aborted and not self.is_over:
            now = self._clock()
            why = "cancelled" if is_cancelled else words(error)
            self._decide(self.engine.fail, now, flight.t, lane, why)
        elif is_cancelled:
            raise error
        if not isinstance(error, Exception) and not is_cancelled:
            raise error

    def _record(self) -> None:
        self._gather = None
        tape = self._tape
        if tape is None:
            return
        tape.write(self.engine.fusion.take_trace())
        self.unrecorded = self.unrecorded or tape.error
