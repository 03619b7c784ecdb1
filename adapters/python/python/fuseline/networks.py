"""Puts recorded networks in front of calls, and compares policies over the same arrivals.

A `RecordedNetwork` delays the calls of a handle by the round trips of a drive, in the loop's time.
A test in the virtual time of `fuseline.testing` therefore drives for hours within milliseconds.

>>> from fuseline import Operator, testing
>>> async def detect(frame, call):
...     return f"{frame} by the cloud"
>>> async def main(loop):
...     network = RecordedNetwork("vnperf/highway:sprint", start=150.0)
...     operator = Operator(lambda frame, t: f"{frame} on board", clock=loop.time_ns)
...     operator.use_cloud(network.handle(detect), lambda frame, t: (frame, 0.5), str, 1)
...     async with operator:
...         operator.feed(["frame"])
...         return [(item.value, round(item.latency, 3)) async for item in operator]
>>> testing.run(main)
[('frame by the cloud', 0.117)]

Between processes, ``fuseline serve --forward URL --drive DRIVE`` puts a drive in front of a server.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf
from os import PathLike, fspath
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from fuseline import _fuseline

if TYPE_CHECKING:
    from fuseline._item import Call
    from fuseline._judge import Duration, Traced

__all__ = [
    "DRIVES",
    "Drive",
    "PolicyScore",
    "Quantile",
    "RecordedNetwork",
    "Responses",
    "compare",
    "compare_responses",
]

#: The names of the drives inside the wheel. The command has the same.
DRIVES: tuple[str, ...] = tuple(_fuseline.drives())

Req = TypeVar("Req")
Res = TypeVar("Res")


class Drive:
    """Returns the round trips of one recorded drive, by the moment of sending.

    Args:
        name: A built-in drive, or a CSV file as ``fuseline run --help`` describes it. If the
            recording has several networks, add ``:network``. At its end the drive starts again.

    Raises:
        OSError: if there is no such drive and no such file.
        ValueError: if the file is not a drive. The error names the line.

    >>> drive = Drive("cicv5g/rural_n8_v10")
    >>> drive.round_trip(0.055)
    0.025
    """

    def __init__(self, name: str | PathLike[str]) -> None:
        self._drive = _fuseline.Drive(fspath(name))

    def __repr__(self) -> str:
        return f"Drive({self.name!r})"

    def __reduce__(self) -> tuple[type[Drive], tuple[str]]:
        return Drive, (self.name,)

    @property
    def name(self) -> str:
        """Returns the drive's name, with the network."""
        return self._drive.name

    @property
    def length(self) -> float:
        """Returns the seconds until it starts again."""
        return self._drive.length / 1e9

    @cached_property
    def samples(self) -> list[tuple[float, float | None]]:
        """Returns each round trip and the second from which it holds; None means no network."""
        return [
            (at / 1e9, None if trip is None else trip / 1e9) for at, trip in self._drive.samples()
        ]

    def round_trip(self, at: Duration) -> float | None:
        """Returns the round trip of a message sent at second ``at``; None if it never returns.

        While the network is unavailable, a message waits for it.
        """
        trip = self._drive.round_trip(at)
        return None if trip is None else trip / 1e9


class RecordedNetwork:
    """Emulates a network between an operator and a cloud, or several.

    A call takes the round trip of the moment at which it is made, one half on the way there and the
    other on the way back. A call that never returns waits until it is cancelled. The network's time
    is the running loop's, and begins with the first call or with `begin`.

    Args:
        drive: A `Drive`, or the name of one.
        start: The second of the drive at which it begins.
    """

    def __init__(self, drive: Drive | str | PathLike[str], start: Duration = 0.0) -> None:
        self.drive = drive if isinstance(drive, Drive) else Drive(drive)
        self._start = _fuseline.nanoseconds(start) / 1e9
        if self._start >= self.drive.length:
            raise ValueError(
                f"a start at {self._start:g} s is beyond {self.drive.name}, which lasts "
                f"{self.drive.length:g} s"
            )
        self._begun: float | None = None

    def begin(self) -> None:
        """Starts the network's time now, unless it has started."""
        if self._begun is None:
            self._begun = asyncio.get_running_loop().time()

    def round_trip(self) -> float | None:
        """Returns the round trip of a message sent now; None if it never returns."""
        self.begin()
        assert self._begun is not None
        return self.drive.round_trip(self._start + asyncio.get_running_loop().time() - self._begun)

    def handle(
        self, handle: Callable[[Req, Call], Awaitable[Res]]
    ) -> Callable[[Req, Call], Awaitable[Res]]:
        """Returns a handle behind this network. The time on the way reduces its deadline."""

        async def delayed(request: Req, call: Call) -> Res:
            trip = self.round_trip()
            if trip is None:
                await asyncio.get_running_loop().create_future()
                raise asyncio.CancelledError
            there = trip / 2
            await asyncio.sleep(there)
            left = replace(call, deadline=max(call.deadline - there, 0.0))
            try:
                response = await handle(request, left)
            except Exception:
                await asyncio.sleep(trip - there)
                raise
            await asyncio.sleep(trip - there)
            return response

        return delayed


class Quantile(NamedTuple):
    """Holds a response time that a share of the messages does not exceed."""

    #: Infinite if too many have no output.
    seconds: float
    #: True if this is only a lower bound, because some response times are not known.
    is_bound: bool = False


@dataclass(frozen=True)
class PolicyScore:
    """Scores a policy. Figures are ranges, because some response times may be unknown."""

    #: ``local only``, ``cloud only: NAME``, ``first response wins``, ``progressive``; for a trace
    #: also ``fusion``, which is its operator.
    policy: str
    #: The mean accuracy. A missing or late output counts as 0. None without figures.
    accuracy: tuple[float, float] | None
    #: The number of outputs with a result before the deadline.
    in_time: tuple[int, int]
    #: The response time that half of the messages do not exceed. None without messages.
    p50: Quantile | None
    p90: Quantile | None
    p99: Quantile | None


@dataclass(frozen=True)
class Responses:
    """Holds the responses of one source."""

    #: The seconds until its result came, or None if none came, in the order of the messages.
    seconds: Sequence[Duration | None]
    #: 0 is local; clouds have 1 to 65535, the greater wins.
    priority: int
    #: The accuracy of its results, such as an AP.
    accuracy: float | None = None


def compare(
    trace: Traced,
    *,
    deadline: Duration,
    accuracies: Mapping[str, float] | None = None,
    name: str | None = None,
) -> list[PolicyScore]:
    """Scores the operator of a trace, and other policies over the same arrivals.

    If a call was ended before its result came, its response is unknown and the figures become
    bounds. Let calls linger to avoid this.

    Args:
        trace: The trace, as for `fuseline.check`.
        deadline: The time before which an output's result must come to be in time.
        accuracies: The accuracy of each source, by its name: ``local`` or the cloud's.
        name: The trace's name in errors; by default its path.

    Raises:
        ReadError: if it cannot be read to its end.
        OSError: if its file cannot be opened or read.
        ValueError: if the trace has no source of a name in ``accuracies``.
    """
    by_source = list((accuracies or {}).items())
    return _scores(_fuseline.compare_trace(trace, name, deadline, by_source))


def compare_responses(sources: Mapping[str, Responses], *, deadline: Duration) -> list[PolicyScore]:
    """Scores policies over responses that were measured or made up.

    Args:
        sources: The responses of each source by name: one of priority 0, which is local, and
            clouds.
        deadline: The time before which an output's result must come to be in time.

    Raises:
        ValueError: if local is missing, two sources have one priority, or they differ in length.

    >>> local = Responses([0.3, 0.3], 0, accuracy=43.5)
    >>> west = Responses([0.17, None], 1, accuracy=51.3)
    >>> for score in compare_responses({"local": local, "west": west}, deadline=0.5):
    ...     print(score.policy, score.in_time, score.accuracy)
    local only (2, 2) (43.5, 43.5)
    cloud only: west (1, 1) (25.65, 25.65)
    first response wins (2, 2) (47.4, 47.4)
    progressive (2, 2) (47.4, 47.4)
    """
    ordered = sorted(sources.items(), key=lambda it: it[1].priority)
    priorities = [it.priority for _, it in ordered]
    if priorities[:1] != [0]:
        raise ValueError("no source of priority 0, which is local")
    if len(set(priorities)) < len(priorities) or priorities[-1] > 65535:
        raise ValueError(f"priorities {priorities}; give each source its own, up to 65535")
    if len({len(it.seconds) for _, it in ordered}) > 1:
        raise ValueError("sources with responses for different numbers of messages")
    messages = list(zip(*(it.seconds for _, it in ordered), strict=True))
    named = [(name, it.priority, it.accuracy) for name, it in ordered]
    return _scores(_fuseline.compare_responses(named, messages, deadline))


def _scores(rows: Iterable[_fuseline._PolicyRow]) -> list[PolicyScore]:
    return [
        PolicyScore(policy, accuracy, in_time, *map(_quantile, quantiles))
        for policy, accuracy, in_time, quantiles in rows
    ]


def _quantile(quantile: tuple[str, int] | None) -> Quantile | None:
    if quantile is None:
        return None
    word, nanos = quantile
    return Quantile(inf if word == "never" else nanos / 1e9, word == "at least")
