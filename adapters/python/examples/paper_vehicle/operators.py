"""The vehicle's operators: what each computes, requests from clouds, and sends when it has nothing.

Runtimes are emulated, and so is what is computed.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from fuseline import Call, CarriedState, Item, Joined, Latency, Local, Operator
from fuseline.testing import VirtualLoop
from world import Kill, Network

#: A safe stop.
STOP = "stop"


@dataclass(frozen=True)
class Frame:
    """What a camera captured."""

    captured: int
    walker: bool


@dataclass(frozen=True)
class Scene:
    """What is known of the surroundings, and of which frame."""

    captured: int
    #: The box AP of the detector behind it; half with one camera.
    accuracy: float
    walker: bool
    tracked: int = 0


@dataclass(frozen=True)
class Prediction:
    """What may happen: trajectories, each with its probability, the likeliest first."""

    scene: Scene
    trajectories: tuple[tuple[str, float], ...] = (
        ("stays", 0.8),
        ("crosses", 0.15),
        ("turns back", 0.05),
    )


@dataclass
class Vehicle:
    """What all operators have in common."""

    loop: VirtualLoop
    #: ``local``, ``cloud`` or ``fusion``.
    mode: str
    kill: Kill
    west: Network
    east: Network
    near: Network
    traces: Path | None
    operators: list[Operator[Any, Any]] = field(default_factory=list)

    def operator(
        self,
        name: str,
        local: Local[Any, Any],
        after: Sequence[Latency] = (),
        own: Latency | None = None,
    ) -> Operator[Any, Any]:
        """An operator with its name, those downstream and its own latency."""
        trace = None if self.traces is None else self.traces / f"{name}.jsonl"
        operator = Operator[Any, Any](
            local,
            name=name,
            trace=trace,
            clock=self.loop.time_ns,
            output_len=64,
            reserve=after,
            latency=own,
        )
        self.operators.append(operator)
        return operator

    def keep_last(self, operator: Operator[Any, Any]) -> None:
        """Send the last result for a message without one, as old as it is."""
        last = CarriedState[Any](None)
        operator.use_state(last, lambda output: output)
        operator.use_substitute(lambda _: last.current())


def detection(vehicle: Vehicle, after: Sequence[Latency]) -> Operator[Joined, Scene]:
    """Boxes; the two clouds alternate, and get frames that are not consecutive."""

    async def compute(joined: Joined, _: int) -> Scene:
        scene = _detect(joined, 42.0)
        if scene is None or vehicle.mode == "cloud":
            raise RuntimeError("no detection on board")
        return await vehicle.kill.compute("local-detector", 0.3017, scene)

    operator = vehicle.operator("detection", Local.task(compute, at_once=4, waiting=1), after)
    clouds = [
        ("west/dino-swin-t", "west-detector", vehicle.west, 0.0901, 51.3),
        ("east/detr-r101", "east-detector", vehicle.east, 0.1182, 43.5),
    ]
    for turn, (name, part, network, seconds, accuracy) in enumerate(clouds):
        if vehicle.mode == "local":
            continue

        async def handle(
            scene: Scene,
            _: Call,
            network: Network = network,
            part: str = part,
            seconds: float = seconds,
        ) -> Scene:
            await network.round_trip()
            return await vehicle.kill.compute(part, seconds, scene)

        def message_handler(
            joined: Joined, t: int, turn: int = turn, accuracy: float = accuracy
        ) -> tuple[Scene, float] | None:
            scene = _detect(joined, accuracy) if t % 3 == turn else None
            return None if scene is None else (scene, 0.4)

        operator.use_cloud(handle, message_handler, _same, turn + 1, name=name)
    vehicle.keep_last(operator)
    return operator


def tracking(
    vehicle: Vehicle, after: Sequence[Latency], own: Latency
) -> Operator[Item[Scene], Scene]:
    """Tracks; the state goes along to the cloud, and is the cloud's where its result is sent."""
    state = CarriedState[Scene | None](None)

    async def compute(item: Item[Scene], t: int) -> Scene:
        scene = _track(state.current(), _value(item))
        scene = await vehicle.kill.compute("local-tracker", 0.02, scene)
        state.computed(t, scene)
        return scene

    async def handle(scene: Scene, _: Call) -> Scene:
        await vehicle.near.round_trip()
        return await vehicle.kill.compute("cloud-tracker", 0.005, scene)

    def message_handler(item: Item[Scene], _: int) -> tuple[Scene, float] | None:
        # By content: only while there is somebody to track.
        scene = item.value
        if scene is None or not scene.walker or vehicle.mode == "local":
            return None
        return _track(state.current(), scene), 0.06

    operator = vehicle.operator("tracking", Local.task(compute), after, own)
    operator.use_cloud(handle, message_handler, _same, 1, name="tracker")
    operator.use_state(state, lambda scene: scene)
    operator.use_substitute(lambda _: state.current())
    return operator


def prediction(
    vehicle: Vehicle, after: Sequence[Latency], own: Latency
) -> Operator[Item[Scene], Prediction]:
    """Several trajectories, with probabilities."""

    async def compute(item: Item[Scene], _: int) -> Prediction:
        prediction = Prediction(_value(item))
        return await vehicle.kill.compute("local-predictor", 0.015, prediction)

    operator = vehicle.operator("prediction", Local.task(compute), after, own)
    vehicle.keep_last(operator)
    return operator


def planning(
    vehicle: Vehicle, after: Sequence[Latency], own: Latency
) -> Operator[Item[Prediction], Scene]:
    """Plans; those for what is unlikely are obtained beside the outputs, the likeliest first."""
    plans: list[str] = []

    async def compute(item: Item[Prediction], _: int) -> Scene:
        predicted = _value(item)
        # With a plan that was made before it only has to be checked.
        is_ready = predicted.scene.walker and "crosses" in plans
        seconds = 0.015 if is_ready else 0.04
        return await vehicle.kill.compute("local-planner", seconds, predicted.scene)

    async def handle(what: str, _: Call) -> str:
        await vehicle.near.round_trip()
        return what

    def message_handler(item: Item[Prediction], _: int) -> tuple[str, float] | None:
        if item.value is None or vehicle.mode == "local":
            return None
        unlikely = sorted(item.value.trajectories[1:], key=lambda it: -it[1])
        missing = [what for what, _ in unlikely if what not in plans]
        return (missing[0], 1.0) if missing else None

    operator = vehicle.operator("planning", Local.task(compute), after, own)
    operator.use_side_request(handle, message_handler, plans.append, name="contingency")
    vehicle.keep_last(operator)
    return operator


def control(vehicle: Vehicle) -> Operator[Joined, Scene | str]:
    """A command for each tick: by the last plan, or a safe stop."""

    async def compute(joined: Joined, _: int) -> Scene | str:
        await asyncio.sleep(0.001)
        plan: Item[Scene] | None = joined.set.get("plan")
        scene = None if plan is None else plan.value
        # A substitute for a plan is the last one, as old as it is.
        if scene is None or vehicle.loop.time_ns() - scene.captured > 1_000_000_000:
            raise RuntimeError("no plan that is fresh")
        return scene

    operator = vehicle.operator("control", Local.task(compute))
    operator.use_substitute(lambda _: STOP)
    return operator


def _detect(joined: Joined, accuracy: float) -> Scene | None:
    frames: list[Frame] = [joined.set[name] for name in ("left", "right") if name in joined.set]
    if not frames:
        return None
    captured = min(frame.captured for frame in frames)
    walker = any(frame.walker for frame in frames)
    return Scene(captured, accuracy * len(frames) / 2, walker)


def _track(state: Scene | None, scene: Scene) -> Scene:
    return replace(scene, tracked=(0 if state is None else state.tracked) + 1)


def _same(scene: Scene) -> Scene:
    return scene


def _value(item: Item[Any]) -> Any:
    """The item's, if it has one."""
    if item.value is None:
        raise RuntimeError("nothing came from upstream")
    return item.value
