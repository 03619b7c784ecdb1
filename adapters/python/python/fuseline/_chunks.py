"""Plays chunks: replies that hold the actions of several ticks."""

from __future__ import annotations

import asyncio
import inspect
import logging
import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias

from fuseline._errors import CallError, ConfigError, in_one_line
from fuseline._fuseline import nanoseconds
from fuseline._item import Call, StampedValue
from fuseline._wiring import check_count, check_function

if TYPE_CHECKING:
    from fuseline._remote import RemoteThread
    from fuseline.robot import Chunk

_log = logging.getLogger("fuseline")
#: The classes that split a reply as a function would.
_CONTAINERS: tuple[Any, ...] = (list, tuple)

#: Blends an earlier chunk's action, or None, with a later chunk's. It also gets the number of ticks
#: since the later chunk began, and the last action, or None.
Blend: TypeAlias = Callable[[Any, Any, int, Any], Any]


def fade(ticks: int, max_jump: float | None = None) -> Blend:
    """Blends from one chunk into the next within a number of ticks.

    Args:
        ticks: The number of ticks in which the weight of the later chunk rises to 1. While it is
            less, the value counts as computed from the earlier chunk's message, because that is the
            oldest (D2).
        max_jump: The greatest difference between a number of an action and the same number of the
            last action.

    >>> blend = fade(2, max_jump=1.0)
    >>> blend([0.0], [3.0], 0, [0.5])  # the mean is 1.5
    [1.5]
    >>> blend([0.0], [3.0], 1, [1.5])
    [2.5]
    """
    check_count(ticks, 1, "a fade's ticks")
    if max_jump is not None:
        is_number = isinstance(max_jump, (int, float)) and not isinstance(max_jump, bool)
        if not is_number or not 0 < max_jump < math.inf:
            raise ConfigError(f"a max_jump of {max_jump!r}; it must be a number above 0, or None")

    def blend(earlier: Any, later: Any, age: int, last: Any) -> Any:
        action = later
        if earlier is not None and age < ticks:
            share = (age + 1) / ticks
            action = _each(lambda a, b: a + (b - a) * share, earlier, later)
        if max_jump is not None and last is not None:
            action = _each(lambda a, b: a + _clipped(b - a, max_jump), last, action)
        return action

    return blend


class ArrivedChunk:
    """Holds the actions of a chunk for the observation of tick ``of``, each with its own tick."""

    def __init__(self, of: int, first: int, actions: Sequence[Any]) -> None:
        self.of, self.first = of, first
        self.actions = [StampedValue(it, of, tick) for tick, it in enumerate(actions, first)]
        #: The tick at which one of its actions was first planned.
        self.begun: int | None = None

    def action(self, t: int, max_age: int) -> StampedValue[Any] | None:
        """Returns its action for a tick, unless that would be too old."""
        place = t - self.first
        if 0 <= place < len(self.actions) and 0 <= t - self.of <= max_age:
            return self.actions[place]
        return None


class ChunkPlan:
    """Requests chunks in time, and returns the action of each tick."""

    def __init__(
        self,
        remote: RemoteThread,
        chunk: Chunk,
        ended: Callable[[str | None], None] = lambda _: None,
        check: Callable[[Any], None] = lambda _: None,
    ) -> None:
        """Makes a plan.

        Args:
            remote: Makes the calls. A reply is a list of actions.
            chunk: The settings for chunks.
            ended: Called with the reason why a call failed, or with None if it returned a chunk.
            check: Raises an error if an action cannot be sent.
        """
        if not hasattr(chunk, "every"):
            raise ConfigError(f"a chunk of {chunk!r}; give Chunk(every=…, max_age=…)")
        check_count(chunk.every, 1, "ticks between chunks")
        check_count(chunk.max_age, 0, "a max_age")
        if chunk.max_age < chunk.every:
            raise ConfigError(
                f"a max_age of {chunk.max_age} ticks is less than the {chunk.every} ticks between "
                "chunks, so most ticks would have no action that is young enough; give a greater "
                "max_age"
            )
        if chunk.split is not None and chunk.split not in _CONTAINERS:
            check_function(chunk.split, "a split")
        if chunk.blend is not None:
            check_function(chunk.blend, "a blend")
            if chunk.blend == fade:  # type: ignore[comparison-overlap]
                raise ConfigError(
                    "the blend is the function fade itself; call it with the ticks, as in fade(5)"
                )
        if chunk.skip not in ("executed", "none"):
            raise ConfigError(f"skip is 'executed' or 'none', not {chunk.skip!r}")
        self.chunk = chunk
        self._remote = remote
        self._ended, self._check = ended, check
        #: The error of the latest failed call, until a call returns a chunk.
        self.why: str | None = None
        self._within = nanoseconds(chunk.within) / 1e9
        if not self._within:
            raise ConfigError(
                "the chunk's within is 0 s, so every call would be given up at once; give more"
            )
        #: The latest chunk and the one before it.
        self._chunks: deque[ArrivedChunk] = deque(maxlen=2)
        self._request: asyncio.Task[None] | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._episode = self._tick = 0
        self._next = 0
        #: The number of ticks that came so late that all chunks were dropped.
        self._stalls = 0
        #: True once a chunk was reported that has too few actions.
        self._is_short = False

    def request(self, observation: Any, t: int) -> None:
        """Requests a chunk for a tick's observation, if it is time and none is under way."""
        self._tick = t
        is_free = self._request is None or self._request.done()
        if is_free and t >= self._next and self._remote.is_ready():
            self._next = t + self.chunk.every
            self._loop = asyncio.get_running_loop()
            self._request = self._loop.create_task(self._take(observation, t, self._episode))

    def planned(self, t: int, last: Any) -> StampedValue[Any] | None:
        """Returns the action of a tick, if a chunk has one that is not too old."""
        max_age = self.chunk.max_age
        has = [(it, it.action(t, max_age)) for it in self._chunks]
        planned = [(it, action) for it, action in has if action is not None]
        if not planned:
            return None
        chunk, later = planned[-1]
        if chunk.begun is None:
            chunk.begun = t
        if self.chunk.blend is None:
            return later
        earlier = planned[0][1] if len(planned) > 1 else None
        age = t - chunk.begun
        action = self.chunk.blend(earlier and earlier.value, later.value, age, last)
        self._check(action)
        # An unchanged action belongs to its own message. A blend belongs to the oldest message
        # (D2).
        if earlier is None or not _differs(action, later.value):
            return replace(later, value=action)
        # A blend is meant for this tick only if both actions are (D18).
        meant_for = later.meant_for if earlier.meant_for == t else earlier.meant_for
        return StampedValue(action, earlier.of, meant_for)

    def check_gap(self, periods: float) -> None:
        """Drops the chunks if a tick comes so late that all their actions are too old.

        Actions are meant for ticks. After a stall, the next ticks come at other instants than those
        for which the actions were computed.

        Args:
            periods: The number of periods since the last tick.
        """
        if periods <= self.chunk.max_age + 1:
            return
        self.clear()
        self._next = 0
        self._stalls += 1
        if self._stalls & (self._stalls - 1) == 0:
            _log.warning(
                "a tick came %.3g periods after the one before, and max_age is %d ticks: actions "
                "of earlier observations are not sent (%d such ticks so far)",
                periods,
                self.chunk.max_age,
                self._stalls,
            )

    def clear(self) -> None:
        """Forgets all actions, even those of a chunk that is under way."""
        self._episode += 1
        self._chunks.clear()

    def close(self) -> None:
        """Ends the request under way."""
        if self._request is not None and self._loop is not None:
            self._loop.call_soon_threadsafe(self._request.cancel)

    async def _take(self, observation: Any, t: int, episode: int) -> None:
        call = Call(t, self._within)
        try:
            actions = await asyncio.wait_for(self._remote.infer(observation, call), self._within)
        except asyncio.CancelledError:
            raise
        except asyncio.TimeoutError:
            self._failed(f"no chunk within {self._within:g} s")
            return
        except Exception as error:
            self._failed(in_one_line(error))
            return
        age = self._tick + 1 - t
        first = 0 if self.chunk.skip == "none" else age
        if episode == self._episode and (age > self.chunk.max_age or first >= len(actions)):
            self.why = (
                f"the chunk came {age} ticks after its observation, when none of its "
                f"{len(actions)} actions may be sent any more (max_age={self.chunk.max_age})"
            )
            self._ended(self.why)
            return
        self.why = None
        self._ended(None)
        self._report_short(len(actions))
        if episode == self._episode:
            first = t if self.chunk.skip == "executed" else self._tick + 1
            self._chunks.append(ArrivedChunk(t, first, actions))

    def _report_short(self, ticks: int) -> None:
        """Logs the first chunk that ends before the next one is requested."""
        if ticks < self.chunk.every and not self._is_short:
            self._is_short = True
            _log.warning(
                "a chunk has %d actions, and the next one is requested every %d ticks: between "
                "them the policy on board acts; give Chunk a smaller every=",
                ticks,
                self.chunk.every,
            )

    def _failed(self, why: str) -> None:
        """Notes a failure, and requests the next chunk soon. Until it comes, on board acts."""
        self._next = self._tick + 1
        self.why = why
        self._ended(why)


def actions_of(reply: Any, chunk: Chunk, check: Callable[[Any, str], None]) -> list[Any]:
    """Returns the actions of a chunk's reply.

    Raises:
        CallError: if it has no actions, or one of them is not an action.
    """
    actions = list((chunk.split or _split)(reply))
    if not actions:
        raise CallError("the chunk has no actions; return at least one")
    for number, action in enumerate(actions):
        check(action, f"chunk[{number}]")
    return actions


def _split(reply: Any) -> Sequence[Any]:
    """Returns the actions in a list, or in a dictionary of arrays as in openpi's replies."""
    if isinstance(reply, (str, bytes, bytearray)):
        text = reply if isinstance(reply, str) else bytes(reply[:200]).decode(errors="replace")
        raise CallError(f"the reply is text, but a chunk is a list of actions: {text[:200]}")
    if not isinstance(reply, dict):
        if not hasattr(reply, "__iter__") or inspect.isgenerator(reply):
            raise CallError(
                f"the reply is a {type(reply).__name__}; a chunk must be a list of actions"
            )
        return list(reply)
    arrays = {key: value for key, value in reply.items() if hasattr(value, "shape") and value.ndim}
    arrays |= {key: value for key, value in reply.items() if isinstance(value, list)}
    if not arrays:
        raise ConfigError("the reply has no arrays; give the chunk a split=")
    if "actions" in arrays:
        # A state in the same reply has a different length from the actions.
        ticks = len(arrays["actions"])
        arrays = {key: value for key, value in arrays.items() if len(value) == ticks}
    ticks = max(len(value) for value in arrays.values())
    if any(len(value) != ticks for value in arrays.values()):
        lengths = ", ".join(f"{key} {len(value)}" for key, value in arrays.items())
        raise ConfigError(f"the arrays have different lengths, {lengths}; give the chunk a split=")
    return [reply | {key: value[k] for key, value in arrays.items()} for k in range(ticks)]


def _each(combine: Callable[[Any, Any], Any], a: Any, b: Any) -> Any:
    """Combines numbers and arrays of two actions of one form. Takes everything else from b."""
    if isinstance(b, dict):
        return {key: _each(combine, a[key], b[key]) if key in a else b[key] for key in b}
    if isinstance(b, (list, tuple)):
        return type(b)(_each(combine, x, y) for x, y in zip(a, b, strict=True))
    if isinstance(b, (str, bytes, bool)) or b is None:
        return b
    return combine(a, b)


def _clipped(step: Any, most: float) -> Any:
    if hasattr(step, "clip"):
        return step.clip(-most, most)
    # A NaN stays NaN, because it must not become the longest step.
    return max(-most, min(most, step)) if step == step else step


def _differs(a: Any, b: Any) -> bool:
    if isinstance(a, dict):
        return any(_differs(a[key], b[key]) for key in a)
    if isinstance(a, (list, tuple)):
        return any(map(_differs, a, b))
    differs = a != b
    return bool(differs.any()) if hasattr(differs, "any") else bool(differs)
