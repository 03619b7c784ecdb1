"""Chunks: replies with the actions of several ticks, and how one follows the other."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

from fuseline._errors import ConfigError
from fuseline._fuseline import nanoseconds
from fuseline._item import StampedValue
from fuseline._wiring import check_count

if TYPE_CHECKING:
    from fuseline._remote import RemoteThread
    from fuseline.robot import Chunk

#: Blends an earlier chunk's action, or None, and a later one's; given also how many ticks ago the
#: later chunk began, and the action sent last, or None.
Blend: TypeAlias = Callable[[Any, Any, int, Any], Any]


def fade(ticks: int, max_jump: float | None = None) -> Blend:
    """Goes over from a chunk to the next within so many ticks.

    Args:
        ticks: In how many ticks the weight of the later chunk rises to 1. While it is less, the
            value is of the earlier chunk's message, the oldest (D2).
        max_jump: How far each number of an action may be from that of the action sent last.

    >>> blend = fade(2, max_jump=1.0)
    >>> blend([0.0], [3.0], 0, [0.5])  # the mean is 1.5
    [1.5]
    >>> blend([0.0], [3.0], 1, [1.5])
    [2.5]
    """
    check_count(ticks, 1, "a fade's ticks")

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
    """A chunk's actions, of the observation of tick ``of``, and the tick that the first is for."""

    def __init__(self, of: int, first: int, actions: Sequence[Any]) -> None:
        self.of, self.first, self.actions = of, first, actions
        #: The tick at which one of them was planned first.
        self.begun: int | None = None

    def action(self, t: int, max_age: int) -> Any:
        """What it has for a tick, unless that would be too old."""
        place = t - self.first
        if 0 <= place < len(self.actions) and 0 <= t - self.of <= max_age:
            return self.actions[place]
        return None


class ChunkPlan:
    """Requests chunks in time, and has the action of each tick."""

    def __init__(self, remote: RemoteThread, chunk: Chunk) -> None:
        check_count(chunk.every, 1, "ticks between chunks")
        if chunk.skip not in ("executed", "none"):
            raise ConfigError(f"skip is 'executed' or 'none', not {chunk.skip!r}")
        self.chunk = chunk
        self._remote = remote
        self._within = nanoseconds(chunk.within) / 1e9
        #: The later one and the one before it.
        self._chunks: deque[ArrivedChunk] = deque(maxlen=2)
        self._request: asyncio.Task[None] | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._episode = self._tick = 0
        self._next = 0

    def request(self, observation: Any, t: int) -> None:
        """Request a chunk for a tick's observation, if it is time and none is under way."""
        self._tick = t
        is_free = self._request is None or self._request.done()
        if is_free and t >= self._next and self._remote.is_ready():
            self._next = t + self.chunk.every
            self._loop = asyncio.get_running_loop()
            self._request = self._loop.create_task(self._take(observation, t, self._episode))

    def planned(self, t: int, last: Any) -> StampedValue[Any] | None:
        """The action of a tick, if a chunk has one that is not too old."""
        max_age = self.chunk.max_age
        has = [(it, it.action(t, max_age)) for it in self._chunks]
        has = [(it, action) for it, action in has if action is not None]
        if not has:
            return None
        later, action = has[-1]
        if later.begun is None:
            later.begun = t
        of = later.of
        if self.chunk.blend is not None:
            earlier = has[0] if len(has) > 1 else None
            age = t - later.begun
            blended = self.chunk.blend(earlier and earlier[1], action, age, last)
            # Of a blend the oldest message's (D2); what nothing was changed of is of its own.
            if earlier is not None and _differs(blended, action):
                of = earlier[0].of
            action = blended
        return StampedValue(action, of)

    def clear(self) -> None:
        """Forget all actions, also those of a chunk that is under way."""
        self._episode += 1
        self._chunks.clear()

    def close(self) -> None:
        """End the request under way."""
        if self._request is not None and self._loop is not None:
            self._loop.call_soon_threadsafe(self._request.cancel)

    async def _take(self, observation: Any, t: int, episode: int) -> None:
        try:
            reply = await asyncio.wait_for(self._remote.infer(observation), self._within)
            actions = list((self.chunk.split or _split)(reply))
        except Exception:  # on board acts until the next chunk
            self._next = self._tick + 1
            return
        if episode == self._episode:
            first = t if self.chunk.skip == "executed" else self._tick + 1
            self._chunks.append(ArrivedChunk(t, first, actions))


def _split(reply: Any) -> Sequence[Any]:
    """The actions of a list, or of a dictionary of arrays, which is how openpi's servers reply."""
    if not isinstance(reply, dict):
        return list(reply)
    arrays = {key: value for key, value in reply.items() if hasattr(value, "shape") and value.ndim}
    arrays |= {key: value for key, value in reply.items() if isinstance(value, list)}
    if not arrays:
        raise ConfigError("a reply without arrays; give the chunk a split=")
    ticks = min(len(value) for value in arrays.values())
    return [reply | {key: value[k] for key, value in arrays.items()} for k in range(ticks)]


def _each(combine: Callable[[Any, Any], Any], a: Any, b: Any) -> Any:
    """The numbers or arrays of two actions of one form, combined one by one; others are b's."""
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
    return max(-most, min(most, step))


def _differs(a: Any, b: Any) -> bool:
    if isinstance(a, dict):
        return any(_differs(a[key], b[key]) for key in a)
    if isinstance(a, (list, tuple)):
        return any(map(_differs, a, b))
    differs = a != b
    return bool(differs.any()) if hasattr(differs, "any") else bool(differs)
