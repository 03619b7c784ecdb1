"""The paper's vehicle, from two cameras to control, under one end-to-end deadline of 500 ms.

Two cameras and a localization, detection with two clouds, tracking with one and a state that goes
along, prediction, planning with contingency plans beside, and control at 20 Hz. Networks are
recorded ones, runtimes and values are emulated, time is virtual: equal options give equal lines.

    python examples/paper_vehicle --kill west-detector
"""

from __future__ import annotations

import argparse
import asyncio
import logging
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fuseline import Full, Item, Items, Join, JoinInput, Latency, Lineage
from fuseline.testing import VirtualLoop
from operators import Frame, Scene, Vehicle, control, detection, planning, prediction, tracking
from world import PARTS, Kill, Network

#: From capture to control, in seconds.
END_TO_END = 0.5


@dataclass
class Drive:
    """What came of a drive."""

    ticks: int = 0
    #: The seconds that each command took, and the age and accuracy of its plan; none is a stop.
    commands: list[tuple[float, tuple[float, float] | None]] = field(default_factory=list)
    detected_by: Counter[str] = field(default_factory=Counter)
    #: Of one frame: the operator, its age when it was taken in and answered, and by whom.
    life: list[tuple[str, float, float, str]] = field(default_factory=list)


class Drivers:
    """The sensors of one drive, which lasts for so many seconds."""

    def __init__(self, vehicle: Vehicle, seconds: float) -> None:
        self._loop, self._kill = vehicle.loop, vehicle.kill
        self._start, self._seconds = vehicle.loop.time(), seconds

    async def film(self, camera: JoinInput[Frame], part: str) -> None:
        """Frames at 10 Hz. Somebody walks towards the road for half of each 10 s."""
        async for seq in self._every(0.1):
            now = self._loop.time_ns()
            if not self._kill.hits(part):
                # A frame that finds no room is not taken: the next one is worth more.
                with suppress(Full):
                    frame = Frame(now, seq % 100 < 50)
                    camera.write(frame, Lineage(part, seq, now, within=END_TO_END))
        camera.close()

    async def localize(self, places: JoinInput[int]) -> None:
        """Places at 20 Hz."""
        async for seq in self._every(0.05):
            if not self._kill.hits("localization"):
                places.write(seq, Lineage("localization", seq, self._loop.time_ns()))

    async def tick(self, ticks: JoinInput[int]) -> int:
        """How many ticks there were. Each has to be answered before the next one."""
        count = 0
        async for seq in self._every(0.05):
            ticks.write(seq, Lineage("control", seq, self._loop.time_ns(), within=0.04))
            count += 1
        ticks.close()
        return count

    async def _every(self, period: float) -> AsyncIterator[int]:
        seq = 0
        while seq * period < self._seconds:
            await asyncio.sleep(max(self._start + seq * period - self._loop.time(), 0.0))
            yield seq
            seq += 1


async def drive(vehicle: Vehicle, seconds: float, frame: int) -> Drive:
    """Drives once."""
    clock = vehicle.loop.time_ns
    track, predict, plan = (Latency.measured(90, ms / 1000) for ms in (30, 20, 45))
    after = [Latency.stated(0.051)]  # of control, and until its next tick
    reserve = [track, predict, plan, *after]
    cameras = Join(name="cameras", wait=0.02, reserve=reserve, clock=clock)
    left, right = cameras.aligned("left"), cameras.aligned("right")
    places = cameras.latest("localization", 0.2)
    detecting = detection(vehicle, reserve)
    detected = Items(detecting)
    in_order = detected.another().in_order(0.1, 0.2, clock=clock)
    trackers = tracking(vehicle, [predict, plan, *after], track)
    tracked = Items(trackers)
    predictors = prediction(vehicle, [plan, *after], predict)
    predicted = Items(predictors)
    planner = planning(vehicle, after, plan)
    planned = Items(planner)
    orders = Join(name="orders", clock=clock)
    ticks = orders.aligned("tick")
    orders.latest("plan", 1.0, planned.another())
    orders.origin_of("plan")
    controller = control(vehicle)
    driven, sensors = Drive(), Drivers(vehicle, seconds)
    async with AsyncExitStack() as stack:
        for join in (cameras, orders):
            await stack.enter_async_context(join)
        for operator in vehicle.operators:
            await stack.enter_async_context(operator)
        detecting.feed(cameras)
        trackers.feed(in_order)
        predictors.feed(tracked.another())
        planner.feed(predicted.another())
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
            scene = item.value
            plan_of = (
                ((clock() - scene.captured) / 1e9, scene.accuracy)
                if isinstance(scene, Scene)
                else None
            )
            driven.commands.append((item.took, plan_of))
            if all(name != "control" for name, *_ in driven.life):
                note(vehicle, "control", item, frame, driven)
        await asyncio.gather(*tasks)
        driven.ticks = await ticking
    driven.life.sort(key=lambda stage: stage[2])
    return driven


async def watch(
    vehicle: Vehicle, name: str, items: Items[Item[Any]], frame: int, driven: Drive
) -> None:
    """Who answered how many messages, and how this operator answered the frame."""
    async for item in items:
        by = "substitute" if item.source is None else item.source.name
        if name == "detection":
            driven.detected_by[by] += 1
        note(vehicle, name, item, frame, driven)


def note(vehicle: Vehicle, name: str, item: Item[Any], frame: int, driven: Drive) -> None:
    """How this operator answered the frame, if the item is of that."""
    lineage = item.lineage
    if lineage is None or lineage.seq != frame or not str(lineage.origin).endswith("-camera"):
        return
    if lineage.captured is not None:
        by = "substitute" if item.source is None else item.source.name
        answered = (vehicle.loop.time_ns() - lineage.captured) / 1e9
        driven.life.append((name, answered - item.took, answered, by))


def row(name: str, driven: Drive) -> str:
    """A line of the table."""
    plans = [plan for _, plan in driven.commands if plan is not None]
    ages = sorted(age for age, _ in plans) or [0.0]
    at = [1000 * ages[len(ages) * percent // 100] for percent in (50, 99)]
    accuracy = sum(accuracy for _, accuracy in plans) / driven.ticks
    slowest = 1000 * max((took for took, _ in driven.commands), default=0.0)
    stops = len(driven.commands) - len(plans)
    return (
        f"{name:24} {len(driven.commands):4} of {driven.ticks:4} {slowest:8.0f} ms "
        f"{at[0]:5.0f} ms {at[1]:4.0f} ms {accuracy:5.1f} {stops:5}"
    )


def run(seconds: int, mode: str, kill: str | None, frame: int, traces: Path | None) -> Drive:
    """One drive, in which this part dies halfway."""
    loop = VirtualLoop()
    start = loop.time()
    vehicle = Vehicle(
        loop,
        mode,
        Kill(kill, start + seconds / 2),
        west=Network("vnperf/highway.csv", 1.0, 2, start),
        east=Network("cicv5g/rural_n8_v10.csv", 0.001, 1, start),
        near=Network("cicv5g/urban_n78_v40.csv", 0.001, 1, start),
        traces=traces if mode == "fusion" else None,
    )
    try:
        return loop.run_until_complete(drive(vehicle, seconds, frame))
    finally:
        loop.run_until_complete(loop.shutdown_asyncgens())
        loop.close()


def main() -> None:
    """The table, and the life of one frame."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=int, default=60, help="how long each drive is")
    parser.add_argument("--kill", choices=(*PARTS, "each"), help="this part dies halfway")
    parser.add_argument("--frame", type=int, default=121, help="tell the life of this frame")
    parser.add_argument("--traces", type=Path, help="a folder for the traces of the last drive")
    arguments = parser.parse_args()
    if not 10 <= arguments.seconds <= 3600:
        parser.error("--seconds: from 10 to 3600")
    # What is missed and hangs is what is shown here.
    logging.getLogger("fuseline").setLevel(logging.CRITICAL)
    kills: list[str | None] = list(PARTS) if arguments.kill == "each" else [arguments.kill]
    print("runtimes and values are emulated; networks are recorded")
    head = (f"{'':24} {'commands':>12} {'within':>11} {'age p50':>8} {'p99':>7}", "AP", "stops")
    print(f"{head[0]} {head[1]:>5} {head[2]:>5}")
    for kill in kills:
        traces = arguments.traces
        if traces is not None:
            traces = traces / kill if kill is not None and len(kills) > 1 else traces
            traces.mkdir(parents=True, exist_ok=True)
        for mode in ("local", "cloud", "fusion"):
            driven = run(arguments.seconds, mode, kill, arguments.frame, traces)
            print(row(f"{mode} {kill or ''}", driven))
        by = ", ".join(f"{name} {count}" for name, count in sorted(driven.detected_by.items()))
        print(f"    detected by: {by}")
        for operator, taken_in, answered, source in driven.life:
            print(
                f"    frame {arguments.frame}: {operator:12} {1000 * taken_in:5.0f} to "
                f"{1000 * answered:5.0f} ms, by {source}"
            )


if __name__ == "__main__":
    main()
