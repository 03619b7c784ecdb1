"""One drive: SUMO moves the world and reports collisions, and the operator's outputs brake the car.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from fuseline.deadline import (
    Constant,
    Expected,
    Guard,
    Hazard,
    Impact,
    Parameters,
    Policy,
    Situation,
)
from network import Network
from operators import Fused, Race, VirtualOperator
from planner import Planner
from scenes import EGO, KINDS, Scene
from world import Pose, World, running

#: The ranges of `fuseline scenario`, which are fitted to the paper's traffic jam.
RANGES = (39.0, 57.0)
DECELERATION, BRAKE_DELAY = 7.5, 0.1
#: The paper's runtimes of the smaller detector on board and the larger one in the cloud, in s.
LOCAL, CLOUD = 0.3017, 0.1182
RATE = 30.0
#: The longest drive, in s.
LONGEST = 40.0
#: How long the cloud is called before a scene begins, so that policies know some calls, in s.
BEFORE = 3.0

PARAMETERS = Parameters(
    deceleration=DECELERATION,
    brake_delay=BRAKE_DELAY,
    local_response=LOCAL,
    hazards=(Hazard(range_local=RANGES[0], range_cloud=RANGES[1]),),
)


def nanos(seconds: float) -> int:
    """Converts seconds to nanoseconds."""
    return round(seconds * 1e9)


def _expected() -> Policy:
    guard = Guard(PARAMETERS)
    return guard.cap(Expected(Impact(PARAMETERS), local_response=LOCAL, probe_every=None))


def _first(local: int, cloud: int | None) -> tuple[int, int]:
    return (local, 0) if cloud is None or local <= cloud else (cloud, 1)


#: How each approach makes its operator. The first never reports anything, so it hits whatever has
#: to be braked for.
APPROACHES: dict[str, Callable[[], VirtualOperator]] = {
    "blind": lambda: Race(lambda _local, _cloud: None),
    "local": lambda: Race(lambda local, _cloud: (local, 0)),
    "cloud": lambda: Race(lambda _local, cloud: None if cloud is None else (cloud, 1)),
    "first": lambda: Race(_first),
    "0.5 s": lambda: Fused(Constant(0.5)),
    "guard": lambda: Fused(Guard(PARAMETERS)),
    "expected": lambda: Fused(_expected()),
    # The detector on board. `Neighbours` adds the shared locations.
    "sharing": lambda: Race(lambda local, _cloud: (local, 0)),
}


class Neighbours:
    """Shared locations, which ego requests ten times a second with a deadline of 0.5 s.

    Local answers with an empty list at once. The cloud answers with the other car's last report
    before the request.
    """

    EVERY = 0.1

    def __init__(self, scene: Scene, network: Network | float, offset: float) -> None:
        self._scene, self._network, self._offset = scene, network, offset
        self._operator = Fused(Constant(0.5))
        self._reports: list[tuple[float, Pose | None]] = []

    def must_brake(self, world: World, ego: Pose) -> bool:
        """Returns whether the reports so far make ego brake."""
        now = world.now
        if now >= len(self._reports) * self.EVERY:
            self._reports.append((now, self._scene.shared(world)))
            trip = _round_trip(self._network, self._offset + BEFORE + now)
            self._operator.frame(nanos(now), 0, trip, Situation())
        for output in self._operator.until(nanos(now)):
            at, other = self._reports[output.t]
            if output.source and other and self._scene.must_brake(ego, other, now - at):
                return True
        return False


@dataclass(frozen=True)
class Result:
    """The end of a drive."""

    #: Ego's speed when SUMO saw it collide, in m/s, or None if it did not.
    impact: float | None
    #: The instant at which it decided to brake, in s, or None if it never did.
    decided: float | None
    #: The distance from the front to the hazard when the drive ended, in m, or None if the hazard
    #: was not in view.
    left: float | None


def drive(
    scene: Scene,
    approach: str,
    network: Network | float,
    *,
    offset: float = 0.0,
    log: Callable[[str], None] | None = None,
) -> Result:
    """Drives a scene once.

    The network is a recording from `offset` on, or a response in s that never changes.
    """
    operator, planner = APPROACHES[approach](), Planner()
    begin = BEFORE if isinstance(network, Network) else 0.0
    frames: list[float | None] = []
    # These calls of the cloud come before the scene begins.
    for number in range(int(begin * RATE)):
        at = number / RATE
        operator.frame(
            nanos(at), nanos(LOCAL), _response(network, offset + at), Situation(speed=scene.speed)
        )
        frames.append(None)
    neighbours = Neighbours(scene, network, offset) if approach == "sharing" else None
    decided: float | None = None
    distance: float | None = None
    with running(scene.network, KINDS) as world:
        scene.place(world)
        world.step()
        world.require_all()
        while world.now < LONGEST and EGO in world.names():
            now = world.now
            ego = world.pose(EGO)
            scene.move(world)
            # A frame is captured in the first step after its instant.
            if now * RATE >= len(frames) - begin * RATE:
                distance = scene.distance(world, ego)
                situation = Situation(speed=ego.speed, reveal=scene.reveal(world, ego))
                captured = begin + now
                operator.frame(
                    nanos(captured), nanos(LOCAL), _response(network, offset + captured), situation
                )
                frames.append(distance)
            for output in operator.until(nanos(begin + now)):
                seen = frames[output.t]
                reports = (
                    output.source is not None and seen is not None and seen <= RANGES[output.source]
                )
                if log and reports and decided is None:
                    log(
                        f"{now:6.2f} s  frame {output.t} at {seen:.1f} m by {'cloud' if output.source else 'local'}"
                    )
                if planner.take(output.t, reports) and decided is None:
                    decided = now
                    if log:
                        log(f"{now:6.2f} s  decides to brake")
            if neighbours and decided is None and neighbours.must_brake(world, ego):
                decided = now
                if log:
                    log(f"{now:6.2f} s  decides to brake by a shared location")
            if decided is not None and now >= decided + BRAKE_DELAY:
                world.brake(EGO, DECELERATION)
            world.step()
            if (impact := world.collision(EGO)) is not None:
                return Result(impact, decided, distance)
            if (
                decided is not None
                and EGO in world.names()
                and world.pose(EGO).speed < 0.01
                and scene.is_still(world)
            ):
                return Result(None, decided, scene.distance(world, world.pose(EGO)))
            if EGO in world.names() and scene.is_over(world, world.pose(EGO)):
                break
    return Result(None, decided, distance)


def _response(network: Network | float, at: float) -> int | None:
    """Returns the cloud's response to a frame of this instant, in ns, or None if it never comes."""
    if not isinstance(network, Network):
        return nanos(network)
    round_trip = network.round_trip(at)
    return None if round_trip is None else nanos(CLOUD + round_trip)


def _round_trip(network: Network | float, at: float) -> int | None:
    """Returns the round trip of a message that needs no computation."""
    response = _response(network, at)
    return None if response is None else max(0, response - nanos(CLOUD))
