"""The vehicle's operators: what each computes, requests from clouds, and sends when it has nothing.

Detection replays what was recorded; what the others compute is emulated.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from fuseline import Call, CarriedState, Commit, Item, Joined, Latency, Local, Operator
from fuseline.testing import VirtualLoop
from score import Recording, Seen, captured
from world import Kill, Network, elapsed_ms

#: A safe stop.
STOP = "stop"
#: The results of detection that each rule uses: its commit rule and the clouds of detection.
#: Under ``first response`` the detectors race; the other operators are eager.
RULES: dict[str, tuple[Commit, tuple[str, ...]]] = {
    "on board": (Commit.EAGER, ()),
    "cloud alone": (Commit.EAGER, ("east",)),
    "first response": (Commit.EAGER, ()),
    "eager": (Commit.EAGER, ("west", "east")),
    "patient": (Commit.PATIENT, ("west", "east")),
    "progressive": (Commit.PROGRESSIVE, ("west", "east")),
}


@dataclass(frozen=True)
class Frame:
    """A frame that a camera captured."""

    number: int
    #: True if somebody walks towards the road.
    walker: bool


@dataclass(frozen=True)
class Scene:
    """The objects around the vehicle, as far as they are known."""

    seen: Seen
    walker: bool
    #: For how many frames in a row it was tracked.
    tracked: int = 0


@dataclass(frozen=True)
class Prediction:
    """Possible trajectories, each with its probability, the likeliest first."""

    scene: Scene
    trajectories: tuple[tuple[str, float], ...] = (
        ("stays", 0.8),
        ("crosses", 0.15),
        ("turns back", 0.05),
    )


@dataclass
class Vehicle:
    """The state that all operators share."""

    loop: VirtualLoop
    #: One of `RULES`.
    rule: str
    recording: Recording
    kill: Kill
    #: The networks of the detectors ``west`` and ``east``, and the tracker's, ``near``.
    networks: dict[str, Network]
    traces: Path | None
    #: The instant at which the drive began, by the loop's clock.
    start: float
    operators: list[Operator[Any, Any]] = field(default_factory=list)

    def operator(
        self,
        name: str,
        local: Local[Any, Any],
        after: Sequence[Latency] = (),
        own: Latency | None = None,
        commit: Commit = Commit.EAGER,
    ) -> Operator[Any, Any]:
        """Returns an operator with its name, those downstream and its own latency."""
        trace = None if self.traces is None else self.traces / f"{name}.jsonl"
        operator = Operator[Any, Any](
            local,
            name=name,
            trace=trace,
            clock=self.loop.time_ns,
            output_len=64,
            reserve=after,
            latency=own,
            commit=commit,
        )
        self.operators.append(operator)
        return operator

    def keep_last(self, operator: Operator[Any, Any]) -> None:
        """Lets an operator send its last result for a message without one, as old as it is."""
        last = CarriedState[Any](None)
        operator.use_state(last, lambda output: output)
        operator.use_substitute(lambda _: last.current())


def detection(vehicle: Vehicle, after: Sequence[Latency]) -> Operator[Joined, Scene]:
    """Boxes, by the rule."""

    async def detect(by: str, scene: Scene) -> Scene:
        """Detects a scene after the runtime that was recorded with its boxes."""
        scene = replace(scene, seen=replace(scene.seen, by=by))
        if by in vehicle.networks:
            await vehicle.networks[by].round_trip()
        seconds = vehicle.recording.runtime(by, scene.seen.frame)
        return await vehicle.kill.compute(f"{by}-detector", seconds, scene)

    async def detect_first(scene: Scene) -> Scene:
        """Whichever detector is first."""
        tasks = [asyncio.create_task(detect(by, scene)) for by in ("local", "west", "east")]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            return next(task.result() for task in tasks if task.done())
        finally:
            for task in tasks:
                task.cancel()

    async def compute(joined: Joined, _: int) -> Scene:
        scene = _see(joined)
        if scene is None or vehicle.rule == "cloud alone":
            raise RuntimeError("no camera" if scene is None else "no detection on board")
        if vehicle.rule == "first response":
            return await detect_first(scene)
        return await detect("local", scene)

    def message_handler(joined: Joined, _: int) -> tuple[Scene, float] | None:
        scene = _see(joined)
        return None if scene is None else (scene, 0.4)

    commit, clouds = RULES[vehicle.rule]
    local = Local.task(compute, at_once=4, waiting=1)
    operator = vehicle.operator("detection", local, after, commit=commit)
    for priority, cloud in enumerate(clouds, 1):

        async def handle(scene: Scene, _: Call, by: str = cloud) -> Scene:
            return await detect(by, scene)

        operator.use_cloud(handle, message_handler, _same, priority, name=cloud)
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
        await vehicle.networks["near"].round_trip()
        return await vehicle.kill.compute("cloud-tracker", 0.006, scene)

    def message_handler(item: Item[Scene], _: int) -> tuple[Scene, float] | None:
        # By content: only while there is somebody to track.
        scene = item.value
        if scene is None or not scene.walker or vehicle.rule == "on board":
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
        return await vehicle.kill.compute("local-predictor", 0.016, prediction)

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
        seconds = 0.016 if is_ready else 0.04
        return await vehicle.kill.compute("local-planner", seconds, predicted.scene)

    async def handle(what: str, _: Call) -> str:
        await vehicle.networks["near"].round_trip()
        return what

    def message_handler(item: Item[Prediction], _: int) -> tuple[str, float] | None:
        if item.value is None or vehicle.rule == "on board":
            return None
        unlikely = sorted(item.value.trajectories[1:], key=lambda it: -it[1])
        missing = [what for what, _ in unlikely if what not in plans]
        return (missing[0], 1.0) if missing else None

    operator = vehicle.operator("planning", Local.task(compute), after, own)
    operator.use_side_request(handle, message_handler, plans.append, name="contingency")
    vehicle.keep_last(operator)
    return operator


def control(vehicle: Vehicle) -> Operator[Joined, Scene | str]:
    """Makes the operator that sends a command for each tick: by the last plan, or a safe stop."""

    async def compute(joined: Joined, _: int) -> Scene | str:
        await asyncio.sleep(0.001)
        plan: Item[Scene] | None = joined.set.get("plan")
        scene = None if plan is None else plan.value
        # A substitute for a plan is the last one, as old as it is.
        if scene is None or elapsed_ms(vehicle.start) > captured(scene.seen.frame) + 1000:
            raise RuntimeError("no plan that is fresh")
        return scene

    operator = vehicle.operator("control", Local.task(compute))
    operator.use_substitute(lambda _: STOP)
    return operator


def _see(joined: Joined) -> Scene | None:
    """Holds what the cameras see. A detector finds out who is there."""
    left: Frame | None = joined.set.get("left")
    right: Frame | None = joined.set.get("right")
    frames = [frame for frame in (left, right) if frame is not None]
    if not frames:
        return None
    number = min(frame.number for frame in frames)
    seen = Seen(number, "local", left is not None, right is not None)
    return Scene(seen, any(frame.walker for frame in frames))


def _track(state: Scene | None, scene: Scene) -> Scene:
    return replace(scene, tracked=(0 if state is None else state.tracked) + 1)


def _same(scene: Scene) -> Scene:
    return scene


def _value(item: Item[Any]) -> Any:
    """Returns the item's value, if it has one."""
    if item.value is None:
        raise RuntimeError("nothing came from upstream")
    return item.value
