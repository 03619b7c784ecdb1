"""The paper's vehicle, from two cameras to control, under one end-to-end deadline of 500 ms.

Two cameras and a localization, detection with two clouds, tracking with one and a state that goes
along, prediction, planning with contingency plans beside, and control at 20 Hz. Boxes, the runtimes
of detection and the networks are recorded, all else is emulated. Time is virtual: equal options
give equal lines, and those of `cargo run -p fuseline-evaluation --example paper_vehicle`.

    python examples/paper_vehicle --kill west-detector
"""

from __future__ import annotations

import argparse
import asyncio
import logging
from collections import Counter
from collections.abc import AsyncIterator, Iterable
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass, field
from itertools import count, takewhile
from pathlib import Path
from typing import Any

from fuseline import Ending, Full, Item, Items, Join, JoinInput, Latency, Lineage
from fuseline.testing import VirtualLoop
from operators import (
    RULES,
    Frame,
    Scene,
    Vehicle,
    control,
    detection,
    planning,
    prediction,
    tracking,
)
from score import Command, Recording, captured
from world import PARTS, Kill, Network

#: From capture to control, in milliseconds.
END_TO_END = 500
#: Control is due between two steps of all that happens before it; in milliseconds.
FIRST_TICK, TICK = 1, 50


@dataclass
class Drive:
    """The outcome of a drive."""

    #: The number of times that control was due, and its outputs.
    ticks: int = 0
    commands: list[Command] = field(default_factory=list)
    #: The number of items of each source of detection.
    detected_by: Counter[str] = field(default_factory=Counter)
    #: The number of items of the operators before control that are substitutes.
    substitutes: int = 0
    #: For one frame: the operator, its age when it was opened and answered, and the source.
    life: list[tuple[str, float, float, str]] = field(default_factory=list)


class Drivers:
    """The sensors of one drive, which lasts for this many seconds."""

    def __init__(self, vehicle: Vehicle, seconds: float) -> None:
        self._loop, self._kill, self._frames = vehicle.loop, vehicle.kill, len(vehicle.recording)
        self._start, self._seconds = vehicle.loop.time(), seconds

    async def film(self, camera: JoinInput[Frame], part: str) -> None:
        """The recorded frames. Somebody walks towards the road for half of each 10 s."""
        async for number in self._at(captured(it) / 1000 for it in range(self._frames)):
            if not self._kill.hits(part):
                now = self._loop.time_ns()
                # A frame that finds no room is not taken: the next one is worth more.
                with suppress(Full):
                    frame = Frame(number, number % 70 < 35)
                    camera.write(frame, Lineage(part, number, now, within=END_TO_END / 1000))
        camera.close()

    async def localize(self, places: JoinInput[int]) -> None:
        """Places at 20 Hz."""
        async for seq in self._at(it / 20 for it in count()):
            if not self._kill.hits("localization"):
                places.write(seq, Lineage("localization", seq, self._loop.time_ns()))

    async def tick(self, ticks: JoinInput[int]) -> int:
        """Sends the ticks, each to be answered before the next one. Returns their number."""
        tick_count = 0
        async for seq in self._at((FIRST_TICK + TICK * it) / 1000 for it in count()):
            ticks.write(seq, Lineage("control", seq, self._loop.time_ns(), within=0.04))
            tick_count += 1
        ticks.close()
        return tick_count

    async def _at(self, instants: Iterable[float]) -> AsyncIterator[int]:
        """Counts at these instants of the drive, until it ends."""
        for seq, at in enumerate(takewhile(lambda it: it < self._seconds, instants)):
            await asyncio.sleep(max(self._start + at - self._loop.time(), 0.0))
            yield seq


async def drive(vehicle: Vehicle, seconds: float, frame: int) -> Drive:
    """Drives once."""
    clock = vehicle.loop.time_ns
    track, predict, plan = (Latency.measured(90, ms / 1000) for ms in (30, 20, 46))
    after = [Latency.stated(0.052)]  # of control, and until its next tick
    reserve = [track, predict, plan, *after]
    cameras = Join(name="cameras", wait=0.02, reserve=reserve, clock=clock)
    left, right = cameras.aligned("left"), cameras.aligned("right")
    places = cameras.latest("localization", 0.2)
    detecting = detection(vehicle, reserve)
    detected = Items(detecting)
    # Under progressive an old frame's better boxes may come after a newer frame's.
    if vehicle.rule == "progressive":
        boxes = Items(newest(detected.new_reader()))
    else:
        boxes = detected.new_reader().in_order(0.1, 0.2, clock=clock)
    trackers = tracking(vehicle, [predict, plan, *after], track)
    tracked = Items(trackers)
    tracks = tracked.new_reader().in_order(0.1, 0.15, clock=clock)
    predictors = prediction(vehicle, [plan, *after], predict)
    predicted = Items(predictors)
    planner = planning(vehicle, after, plan)
    planned = Items(planner)
    orders = Join(name="orders", clock=clock)
    ticks = orders.aligned("tick")
    orders.latest("plan", 1.0, planned.new_reader())
    orders.origin_of("plan")
    controller = control(vehicle)
    driven, sensors = Drive(), Drivers(vehicle, seconds)
    async with AsyncExitStack() as stack:
        for join in (cameras, orders):
            await stack.enter_async_context(join)
        for operator in vehicle.operators:
            await stack.enter_async_context(operator)
        detecting.feed(cameras)
        trackers.feed(boxes)
        predictors.feed(tracks)
        planner.feed(predicted.new_reader())
        controller.feed(orders)
        watched: list[tuple[str, Items[Item[Any]]]] = [
            ("detection", detected),
            ("tracking", tracked),
            ("prediction", predicted),
            ("planning", planned),
        ]
        tasks = [
            asyncio.create_task(it)
            for it in (
                sensors.film(left, "left-camera"),
                sensors.film(right, "right-camera"),
                sensors.localize(places),
                *(watch(vehicle, name, items, frame, driven) for name, items in watched),
            )
        ]
        ticking = asyncio.create_task(sensors.tick(ticks))
        async for item in controller:
            seen = item.value.seen if isinstance(item.value, Scene) else None
            tick = FIRST_TICK + TICK * item.timestamp
            driven.commands.append(Command(tick, item.latency, seen))
            if all(name != "control" for name, *_ in driven.life):
                by = "safe stop" if seen is None else "local"
                note(vehicle, "control", item, frame, by, driven)
        await asyncio.gather(*tasks)
        driven.ticks = await ticking
    driven.life.sort(key=lambda stage: stage[2])
    return driven


async def newest(items: Items[Item[Scene]]) -> AsyncIterator[Item[Scene]]:
    """Keeps the newest items, as a consumer does under progressive.

    No item of an earlier frame than one before it, nor of the same frame by a source that is no
    better.
    """
    last = (-1, 0)
    async for item in items:
        place = item.timestamp, 0 if item.source is None else item.source.priority
        if item.value is not None and last < place:
            last = place
            yield item


async def watch(
    vehicle: Vehicle, name: str, items: Items[Item[Any]], frame: int, driven: Drive
) -> None:
    """Counts the items of each source, and notes how this operator answered the frame."""
    async for item in items:
        if item.ending is Ending.FINAL:
            continue  # it was sent before
        by = "substitute" if item.source is None else item.source.name
        driven.substitutes += item.source is None
        if name == "detection":
            driven.detected_by[by] += 1
        note(vehicle, name, item, frame, by, driven)


def note(vehicle: Vehicle, name: str, item: Item[Any], frame: int, by: str, driven: Drive) -> None:
    """Notes how this operator answered the frame, if the item is of that frame."""
    lineage = item.lineage
    if lineage is None or lineage.seq != frame or not str(lineage.origin).endswith("-camera"):
        return
    if lineage.captured is not None:
        answered = (vehicle.loop.time_ns() - lineage.captured) / 1e9
        driven.life.append((name, answered - item.latency, answered, by))


def row(rule: str, driven: Drive, recording: Recording) -> str:
    """Returns a line of the table."""
    it = recording.figures(driven.commands, END_TO_END)
    return (
        f"| {rule} | {it.ap50:.1f} | {it.old:.1f} % | {it.p50} ms | {it.p99} ms "
        f"| {driven.substitutes} | {it.stops} |"
    )


def run(
    seconds: int, rule: str, recording: Recording, kill: str | None, frame: int, traces: Path | None
) -> Drive:
    """One drive, in which this part dies halfway."""
    loop = VirtualLoop()
    start = loop.time()
    vehicle = Vehicle(
        loop,
        rule,
        recording,
        Kill(kill, start, seconds * 500),
        networks={
            "west": Network("vnperf/highway.csv", 1000, 2, start),
            "east": Network("cicv5g/rural_n8_v10.csv", 1, 1, start),
            "near": Network("cicv5g/urban_n78_v40.csv", 1, 1, start),
        },
        traces=traces if rule == "eager" else None,
        start=start,
    )
    try:
        return loop.run_until_complete(drive(vehicle, seconds, frame))
    finally:
        loop.run_until_complete(loop.shutdown_asyncgens())
        loop.close()


def compare(
    seconds: int, recording: Recording, kill: str | None, frame: int, traces: Path | None
) -> None:
    """Prints the table, and the life of one frame."""
    print("all parts live\n" if kill is None else f"{kill} dies\n")
    print("| rule | AP50 | older | age p50 | p99 | substitutes | safe stops |")
    print("|---|---|---|---|---|---|---|")
    drives = {}
    for rule in RULES:
        drives[rule] = run(seconds, rule, recording, kill, frame, traces)
        print(row(rule, drives[rule], recording))
    print()
    for rule, driven in drives.items():
        slowest = 1000 * max((it.latency for it in driven.commands), default=0.0)
        by = ", ".join(f"{name} {number}" for name, number in sorted(driven.detected_by.items()))
        print(
            f"{rule}: {len(driven.commands)} of {driven.ticks} ticks within {slowest:.0f} ms; "
            f"boxes by {by}"
        )
        for operator, taken_in, answered, source in driven.life if rule == "eager" else ():
            print(
                f"  frame {frame}: {operator:10} from {1000 * taken_in:3.0f} "
                f"to {1000 * answered:3.0f} ms by {source}"
            )
    print()


def main() -> None:
    """The table, and the life of one frame."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=int, default=57, help="how long each drive is")
    parser.add_argument("--kill", choices=(*PARTS, "each"), help="this part dies halfway")
    parser.add_argument("--frame", type=int, help="tell the life of this frame")
    parser.add_argument("--traces", type=Path, help="a folder for the traces of the eager drive")
    arguments = parser.parse_args()
    if not 10 <= arguments.seconds <= 57:
        parser.error("--seconds: from 10 to 57")
    # What is missed and hangs is what is shown here.
    logging.getLogger("fuseline").setLevel(logging.CRITICAL)
    recording = Recording()
    kills: list[str | None] = list(PARTS) if arguments.kill == "each" else [arguments.kill]
    for kill in kills:
        traces = arguments.traces
        if traces is not None:
            traces = traces / kill if kill is not None and len(kills) > 1 else traces
            traces.mkdir(parents=True, exist_ok=True)
        followed = 12_000 if kill is None else arguments.seconds * 500 + 2000
        frame = recording.newest(followed) if arguments.frame is None else arguments.frame
        compare(arguments.seconds, recording, kill, frame, traces)


if __name__ == "__main__":
    main()
