"""Joins several streams, aligned by the origin of their messages (E5, E6, E7)."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Sequence
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from dataclasses import dataclass
from enum import Enum
from types import TracebackType
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from fuseline._counts import Counts
from fuseline._errors import Closed, ConfigError, Full
from fuseline._fuseline import Aligner, Latency, nanoseconds
from fuseline._item import Ending, Item, Lineage, check_capture, fields_of
from fuseline._loop import LONGEST_SLEEP, ReaderList, WaiterList
from fuseline._snapshot import snapshot
from fuseline._wiring import (
    check_clock,
    check_count,
    check_function,
    check_reserve,
    check_text,
    check_value,
)

if TYPE_CHECKING:
    from fuseline._judge import Duration
    from fuseline._validation import ns

T = TypeVar("T")

_log = logging.getLogger("fuseline")
#: The number of seconds that a message from another thread may wait for the loop.
HANDOVER = 1.0


class JoinCause(Enum):
    """Says why a set was given."""

    #: Each input that has not ended has a message in the set.
    COMPLETE = "complete"
    #: The set's wait, or the end-to-end deadline of one of its messages, ended.
    DUE = "due"
    #: There was no room for a new set.
    FULL = "full"


class JoinDropReason(Enum):
    """Says why a message was not joined."""

    #: Its origin has no timestamp.
    NO_KEY = "no key"
    #: Its set was given before, or is older than the last 1,024 sets.
    LATE = "late"
    #: The input's last message of this set has come.
    DUPLICATE = "duplicate"


#: The possible outcomes of an input's message that is not in a set.
INPUT_OUTCOMES = ("missing", *(f"dropped {it.value}" for it in JoinDropReason))


@dataclass(frozen=True)
class Joined:
    """Holds a set of messages that come from one origin."""

    #: The key that its messages share: the origin's timestamp by default.
    key: int
    #: The messages, by input.
    set: dict[str, Any]
    #: The inputs from which nothing came.
    missing: list[str]
    #: The reason why it was given.
    cause: JoinCause
    #: The lineage of the first input that is present, with the oldest capture and the earliest
    #: end-to-end deadline of all inputs that are present. If one capture is unknown, the set's
    #: capture is unknown.
    lineage: Lineage | None


@dataclass(frozen=True)
class JoinDrop:
    """Names a message that a join did not use."""

    #: The name of the input.
    input: str
    #: The key by which it would have been joined.
    key: int | None
    #: The reason why it was dropped.
    why: JoinDropReason


class JoinInput(Generic[T]):
    """Accepts the messages of one input. `Join.aligned` and `Join.latest` make it."""

    def __init__(
        self,
        join: Join,
        name: str,
        key: Callable[[T, Lineage | None], int | None] | None,
        max_age: ns | None,
    ) -> None:
        self.name = name
        self.is_open = True
        #: The greatest age, only for a latest-value input.
        self._join, self._key, self._max_age = join, key, max_age
        #: Its place among the inputs of its kind.
        self._index = 0

    def write(self, message: T, lineage: Lineage | None = None) -> None:
        """Writes a message. In another thread it waits until the loop takes it.

        A message is copied as `Operator` copies its messages.

        Raises:
            Full: if the reader of the sets lags by ``output_len``, or the loop is blocked for a
                second. The message is not accepted.
            Closed: if the input accepts no more messages.
            TimeError: if the lineage's capture lies more than a second in the future, because it
                was then read from another clock. The message is not accepted.
        """
        message = snapshot(message)
        self._join._in_loop(lambda: self._join._written(self, message, lineage))

    def close(self) -> None:
        """Ends this input: no set waits for it any longer."""
        self._join._in_loop(lambda: self._join._ended(self))


class Join:
    """Collects the messages of several inputs that come from one origin timestamp in a set.

    A set is given when each aligned input that has not ended has a message in it, or when the set
    is due. A set that is due names the inputs that are missing. No second set has the same key. Use
    the join as a context manager, in the operators' loop. At the end of the block its inputs are
    closed.

    Args:
        name: Its name in logs.
        wait: The time that a set waits after its first message.
        window: The number of sets that may wait. If another one begins, the oldest is given
            incomplete.
        reserve: The latency of the operators downstream. A set is given at the latest when only
            this time is left of an end-to-end deadline.
        output_len: The number of sets that the reader may lag behind. While it lags further behind,
            no message is accepted.
        clock: The operators' clock.

    >>> import asyncio
    >>> async def main():
    ...     join = Join(wait=0.02)
    ...     left, right = join.aligned("left"), join.aligned("right")
    ...     async with join:
    ...         left.write("west", Lineage("left", 7))
    ...         right.write("east", Lineage("right", 7))
    ...         return (await join.read()).set
    >>> asyncio.run(main())
    {'left': 'west', 'right': 'east'}
    """

    def __init__(
        self,
        *,
        name: str = "join",
        wait: Duration = 0.05,
        window: int = 16,
        reserve: Sequence[Latency] = (),
        output_len: int = 16,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        check_text(name, "a join")
        check_count(window, 1, "a window")
        check_count(output_len, 1, "an output_len")
        check_clock(clock)
        check_reserve(reserve)
        self.name = name
        #: The numbers of sets by cause, of inputs missing in them, and of messages dropped by
        #: reason.
        self.counts: Counts[tuple[str, str, str]] = Counts(
            known=((name, "set", it.value) for it in JoinCause)
        )
        self._wait, self._window, self._reserve = nanoseconds(wait), window, list(reserve)
        self._output_len, self._clock = output_len, clock
        self._inputs: list[JoinInput[Any]] = []
        self._sources: list[tuple[JoinInput[Any], AsyncIterator[Item[Any]]]] = []
        self._origin: str | None = None
        self._on_drop: Callable[[JoinDrop], None] | None = None
        self._aligner: Aligner | None = None
        self._sets: deque[Joined] = deque()
        self._tasks: set[asyncio.Task[None]] = set()
        self._timer: asyncio.TimerHandle | None = None
        self._given, self._room = ReaderList(name), WaiterList()
        #: The loop and its thread, once it has started.
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: int | None = None
        self._is_ending = False

    # Before the start.

    def aligned(
        self, name: str, *, key: Callable[[Any, Lineage | None], int | None] | None = None
    ) -> JoinInput[Any]:
        """Adds an input whose messages are aligned by `Lineage.seq`, or by a key of your own.

        Sensors that are triggered together give the same numbers to their messages. A message
        without a key is dropped.

        Args:
            name: The input's name in sets, counts and logs.
            key: Gets a message and its lineage, and returns the key by which it is joined: an int
                or None.

        Raises:
            ConfigError: if the join has started, or another input has the name.
        """
        if key is not None:
            check_function(key, "a key")
        return self._add(JoinInput(self, name, key, None))

    def items(self, name: str, items: AsyncIterator[Item[Any]]) -> None:
        """Adds an operator's output as an input, aligned by the timestamp of its origin.

        A set holds the `Item`, even for a message that was missed. If a message has several items,
        the set holds the last one with a value, or the last one so far if the set is due.
        """
        self._sources.append((self.aligned(name), items))

    def latest(
        self, name: str, max_age: Duration, items: AsyncIterator[Item[Any]] | None = None
    ) -> JoinInput[Any]:
        """Adds an input that gives each set its latest message, such as the vehicle's position.

        No set waits for this input. It is missing if its latest message is older than ``max_age``.
        The age counts from the capture, or from the arrival if the capture is unknown. With
        ``items``, the input is an operator's output, and a set holds its latest item.
        """
        latest: JoinInput[Any] = self._add(JoinInput(self, name, None, nanoseconds(max_age)))
        if items is not None:
            self._sources.append((latest, items))
        return latest

    def origin_of(self, latest: str) -> None:
        """Declares that each set belongs to this latest-value input's message, if present.

        A set's lineage then has that message's origin and capture, and the end-to-end deadline of
        the aligned inputs. So a control command belongs to the frame behind its plan, and is as old
        as that frame.

        Raises:
            ConfigError: if no latest-value input has this name.
        """
        if not any(it.name == latest and it._max_age is not None for it in self._inputs):
            raise ConfigError(
                f"{latest!r} is not a latest-value input of this join; name one that is"
            )
        self._origin = latest

    def on_drop(self, on_drop: Callable[[JoinDrop], None]) -> None:
        """Sets the function that is called with each dropped message. It must not block."""
        check_function(on_drop, "on_drop")
        self._on_drop = on_drop

    async def __aenter__(self) -> Join:
        if self._aligner is not None:
            raise ConfigError("this join was started before; make another")
        names: list[str] = []
        latest: list[tuple[str, ns, bool]] = []
        for it in self._inputs:
            it._index = len(names if it._max_age is None else latest)
            if it._max_age is None:
                names.append(it.name)
            else:
                latest.append((it.name, it._max_age, it.name == self._origin))
        self._aligner = Aligner(names, self._wait, self._window, self._clock(), latest)
        self._loop = loop = asyncio.get_running_loop()
        self._thread = threading.get_ident()
        for it, items in self._sources:
            task = loop.create_task(self._read_items(it, items))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        where: TracebackType | None,
    ) -> None:
        tasks, self._is_ending = list(self._tasks), True
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for it in self._inputs:
            self._ended(it)
        if self._timer is not None:
            self._timer.cancel()

    # Sets.

    def __aiter__(self) -> AsyncIterator[Joined]:
        return self

    async def __anext__(self) -> Joined:
        """Returns the next set. Ends once the aligned inputs have ended and all sets were given."""
        while not self._sets:
            if self._running.is_over:
                raise StopAsyncIteration
            await self._given.wait()
        joined = self._sets.popleft()
        if len(self._sets) < self._output_len:
            self._room.wake()
        return joined

    async def read(self) -> Joined | None:
        """Returns the next set, or None after the last one."""
        with contextlib.suppress(StopAsyncIteration):
            return await self.__anext__()
        return None

    @property
    def _running(self) -> Aligner:
        if self._aligner is None:
            raise ConfigError("the join has not started; use it with `async with`")
        return self._aligner

    def _add(self, joined: JoinInput[T]) -> JoinInput[T]:
        if self._aligner is not None:
            raise ConfigError("an input cannot be added after the start; add it before")
        check_text(joined.name, "an input")
        if any(it.name == joined.name for it in self._inputs):
            raise ConfigError(f"two inputs are named {joined.name!r}; give each its own name")
        self._inputs.append(joined)
        self.counts.know((joined.name, "message", it) for it in INPUT_OUTCOMES)
        return joined

    def _in_loop(self, step: Callable[[], None]) -> None:
        """Does something in the loop's thread, and waits until it is done."""
        if self._thread is None or threading.get_ident() == self._thread or self._loop is None:
            step()
            return
        done: Future[None] = Future()
        try:
            self._loop.call_soon_threadsafe(_settle, done, step)
        except RuntimeError as error:
            raise Closed("the join's loop has ended") from error
        try:
            done.result(HANDOVER)
        except (TimeoutError, FutureTimeoutError) as error:
            if done.cancel():
                raise Full(
                    f"the loop is held up: it has not taken the message for {HANDOVER} s"
                ) from error
            done.result()

    def _written(self, joined: JoinInput[T], message: T, lineage: Lineage | None) -> None:
        if lineage is not None:
            if not isinstance(lineage, Lineage):
                raise ConfigError(f"a lineage is a Lineage, not {lineage!r}")
            if lineage.captured is not None:
                check_capture(lineage.captured, self._clock())
        self._arrived(joined, message, lineage, is_last=True)

    def _arrived(
        self,
        joined: JoinInput[T],
        message: T,
        lineage: Lineage | None,
        *,
        is_last: bool,
        has_value: bool = True,
    ) -> None:
        aligner, now = self._running, self._clock()
        if not joined.is_open:
            raise Closed(f"the input {joined.name} takes no more messages")
        if joined._max_age is not None:
            aligner.set_latest(now, joined._index, fields_of(lineage), message)
            return
        if len(self._sets) >= self._output_len:
            raise Full(f"{len(self._sets)} sets wait to be read; read them first")
        key = None if lineage is None else lineage.seq
        if joined._key is not None:
            key = joined._key(message, lineage)
            check_value(key, f"the key of {joined.name}", "make it a plain function")
        aligner.set_reserve(self._reserve)
        value = (message,) if has_value else None
        why = aligner.arrive(now, joined._index, key, fields_of(lineage), value, is_last)
        self._give()
        if why is not None:
            self._drop(JoinDrop(joined.name, key, JoinDropReason(why)))

    def _ended(self, joined: JoinInput[Any]) -> None:
        if not joined.is_open:
            return
        joined.is_open = False
        if joined._max_age is None and self._aligner is not None:
            self._aligner.end(self._clock(), joined._index)
            self._give()

    def _drop(self, dropped: JoinDrop) -> None:
        key = dropped.input, "message", f"dropped {dropped.why.value}"
        self.counts[key] += 1
        times = self.counts[key]
        if dropped.why is JoinDropReason.NO_KEY and times & (times - 1) == 0:
            _log.warning(
                "%s: %d messages of %s have no key to be joined by: write them with a Lineage that "
                "has a seq, or give the input a key",
                self.name,
                times,
                dropped.input,
            )
        if self._on_drop is None:
            return
        try:
            check_value(self._on_drop(dropped), "on_drop", "make it plain")
        except (Exception, asyncio.CancelledError):
            _log.exception("%s: the handler of drops failed", self.name)

    def _give(self) -> None:
        """Passes on the sets that are ready."""
        aligner = self._running
        while (given := aligner.next_set(self._clock())) is not None:
            key, messages, missing, cause, fields = given
            self.counts[self.name, "set", cause] += 1
            for name in missing:
                self.counts[name, "message", "missing"] += 1
            lineage = None if fields is None else Lineage._of(fields)
            self._sets.append(Joined(key, messages, missing, JoinCause(cause), lineage))
        self._arm(aligner)
        self._given.wake()

    def _arm(self, aligner: Aligner) -> None:
        if self._timer is not None:
            self._timer.cancel()
        due = aligner.next_due
        if due is not None:
            loop = asyncio.get_running_loop()
            left = min(max(due - self._clock(), 0), LONGEST_SLEEP)
            self._timer = loop.call_at(loop.time() + left / 1e9, self._tick)

    def _tick(self) -> None:
        self._running.tick(self._clock())
        self._give()

    async def _read_items(self, joined: JoinInput[Any], items: AsyncIterator[Item[Any]]) -> None:
        try:
            async for item in items:
                while joined._max_age is None and len(self._sets) >= self._output_len:
                    await self._room.wait()
                # The set already has a final item's value.
                has_value = item.ending is not Ending.FINAL
                if joined._max_age is None or has_value:
                    lineage, is_last = item.lineage, item.last
                    self._arrived(joined, item, lineage, is_last=is_last, has_value=has_value)
        except asyncio.CancelledError:
            if self._is_ending:
                raise
            # The source of the items was cancelled, not this task.
            _log.exception("%s: the input %s ends", self.name, joined.name)
        except Exception:
            _log.exception("%s: the input %s ends", self.name, joined.name)
        finally:
            # No set waits for the input any longer, whatever ended it.
            joined.close()


def _settle(done: Future[None], step: Callable[[], None]) -> None:
    """Runs the step that another thread waits for, unless that thread has given up."""
    if not done.set_running_or_notify_cancel():
        return
    try:
        step()
    except BaseException as error:
        done.set_exception(error)
    else:
        done.set_result(None)
