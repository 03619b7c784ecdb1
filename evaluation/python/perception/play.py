"""Plays policies over stored detections in virtual time. The wheel's own operator decides."""

from __future__ import annotations

import asyncio
import statistics
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property

from fuseline import Call, Local, Operator, testing
from fuseline.deadline import Accuracy, BoxDetector, Expected, Policy, Streaming

from detections import SOURCES, KeptDetections
from emulation import delay, typical_delay
from forecast import Forecast
from metrics import match, mean_overlap, precision

#: The deadline of a result, in seconds.
DEADLINE = 0.5
#: How long a call may run on, so that a policy learns its true response time.
LINGER = 30.0
#: The price of waiting for `Expected`, in points of AP50 a millisecond.
PRICE_PER_MS = 0.1
CLOUDS = SOURCES[1:]


@dataclass(frozen=True, order=True)
class SentBoxes:
    """An output: the source and the frame of the boxes, and when they were sent."""

    #: Seconds after the first frame.
    at: float
    frame: int
    source: str = field(compare=False)


@dataclass(frozen=True)
class Playthrough:
    """The outcome of one approach from one start."""

    #: The outputs in the order in which they were sent.
    outputs: list[SentBoxes]
    #: The bytes that were sent to clouds.
    byte_count: int


class KeptDrive:
    """The stored detections over the networks from one start.

    `speed_share` is the share of the boxes' speeds that `Streaming` learns. It is less than 1 if
    the consumer itself moves boxes on.
    """

    def __init__(self, kept: KeptDetections, start: int, speed_share: float = 1.0) -> None:
        self.kept, self.start, self.speed_share = kept, start, speed_share

    def captured(self, frame: int) -> float:
        """Returns when a frame is captured."""
        return frame / self.kept.rate

    def response(self, source: str, frame: int) -> float:
        """Returns how long after its capture a source's result comes."""
        taken = self.kept.seconds[source][frame]
        if source == "local":
            return taken
        return delay(source, self.start, self.captured(frame)) + taken

    def alone(self, source: str) -> Playthrough:
        """Plays one source, which sends each result when it comes."""
        outputs = [
            SentBoxes(self.captured(frame) + self.response(source, frame), frame, source)
            for frame in range(len(self.kept))
        ]
        return Playthrough(sorted(outputs), 0 if source == "local" else sum(self.kept.jpeg_bytes))

    def first_response(self) -> Playthrough:
        """Plays the approach that sends the first result of each frame."""
        choices = zip(*(self._by_frame(source) for source in SOURCES), strict=True)
        return Playthrough(
            sorted(min(each) for each in choices), len(CLOUDS) * sum(self.kept.jpeg_bytes)
        )

    def _by_frame(self, source: str) -> list[SentBoxes]:
        return sorted(self.alone(source).outputs, key=lambda it: it.frame)

    def fused(
        self, commit: str, policy: Callable[[str], Policy] | None = None, trace: str | None = None
    ) -> Playthrough:
        """Plays an operator, with a policy for each cloud or else a constant deadline.

        Returns what it sends.
        """
        return testing.run(lambda loop: self._fuse(loop, commit, policy, trace))

    async def _fuse(
        self,
        loop: testing.VirtualLoop,
        commit: str,
        policy: Callable[[str], Policy] | None,
        trace: str | None,
    ) -> Playthrough:
        sent = [0]
        policies = {cloud: policy(cloud) for cloud in CLOUDS} if policy else {}

        async def local(frame: int, _: int) -> str:
            await asyncio.sleep(self.response("local", frame))
            return "local"

        operator = Operator(
            Local.task(local), name="camera", window=64, commit=commit, trace=trace,  # type: ignore[arg-type]
            clock=loop.time_ns,
        )  # fmt: skip
        for priority, cloud in enumerate(CLOUDS, 1):
            operator.use_cloud(
                self._cloud(cloud, sent),
                lambda frame, _: (frame, DEADLINE),
                lambda source: source,
                priority,
                name=cloud,
                calls=64,
                policy=policies.get(cloud),
                linger=LINGER if policies else 0.0,
            )
        outputs, forecast = [], Forecast()
        # Under progressive, waiting makes no output older.
        speed_share = 0.0 if commit == "progressive" else self.speed_share
        begin = loop.time()
        async with operator:
            operator.feed(self._camera(loop, begin))
            async for item in operator:
                if item.value is None:
                    continue
                outputs.append(SentBoxes(item.decided / 1e9, item.timestamp, item.value))
                boxes = self.kept.found[item.value][item.timestamp]
                speeds = forecast.update(self.captured(item.timestamp), boxes.tolist())
                for it in policies.values():
                    if isinstance(it, Streaming):
                        it.moved(speed_share * speed for speed in speeds)
        return Playthrough(outputs, sent[0])

    def _cloud(self, cloud: str, sent: list[int]) -> Callable[[int, Call], Awaitable[str]]:
        async def infer(frame: int, _: Call) -> str:
            sent[0] += self.kept.jpeg_bytes[frame]
            await asyncio.sleep(self.response(cloud, frame))
            return cloud

        return infer

    async def _camera(self, loop: testing.VirtualLoop, begin: float) -> AsyncIterator[int]:
        for frame in range(len(self.kept)):
            await asyncio.sleep(max(0.0, begin + self.captured(frame) - loop.time()))
            yield frame


class MeasuredPolicies:
    """Makes policies from how well the sources do on these frames."""

    def __init__(self, kept: KeptDetections) -> None:
        self._kept = kept

    @cached_property
    def detectors(self) -> dict[str, BoxDetector]:
        """Returns the accuracy of each source."""
        kept = self._kept
        return {
            source: BoxDetector(
                precision(map(match, kept.found[source], kept.reference)).ap50,
                mean_overlap(kept.found[source], kept.reference),
            )
            for source in SOURCES
        }

    def response(self, source: str) -> float:
        """Returns how long a source usually takes, in seconds."""
        computes = statistics.median(self._kept.seconds[source])
        return computes + (typical_delay(source) if source in CLOUDS else 0.0)

    def expected(self, cloud: str) -> Expected:
        """Chooses by accuracy and a price of waiting, against the source below."""
        below = SOURCES[SOURCES.index(cloud) - 1]
        local, better = (self.detectors[it].accuracy for it in (below, cloud))
        return Expected(Accuracy(local, better, PRICE_PER_MS), self.response(below), None)

    def streaming(self, cloud: str) -> Streaming:
        """Chooses by accuracy and how far the world moves, against the source below."""
        below = SOURCES[SOURCES.index(cloud) - 1]
        local, better = (self.detectors[it] for it in (below, cloud))
        return Streaming(local, better, 1 / self._kept.rate, self.response(below), None)

    def named(self) -> Iterator[tuple[str, Callable[[str], Policy] | None]]:
        """Yields each policy with its name."""
        yield f"{DEADLINE * 1e3:.0f} ms", None
        yield "Expected", self.expected
        yield "Streaming", self.streaming
