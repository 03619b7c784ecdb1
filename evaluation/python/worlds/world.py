"""Eclipse SUMO as the world: it moves everything and reports collisions.

A process runs one simulation at a time (`libsumo`), without a window, in steps of 10 ms.
"""

from __future__ import annotations

import math
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import libsumo
import sumo

#: The length of a step, in seconds.
STEP = 0.01
_HERE = Path(__file__).resolve().parent
_NETS = tempfile.TemporaryDirectory(prefix="fuseline-worlds-")

#: SUMO's mode in which a vehicle keeps its own limits of braking and is not cautious otherwise.
_ONLY_LIMITS = 4
#: SUMO's mode in which a vehicle is not cautious at all.
_BLIND = 0


@dataclass(frozen=True)
class Pose:
    """The place of a vehicle: its front, in metres; its heading, in radians, 0 along x."""

    front: tuple[float, float]
    heading: float
    speed: float
    length: float
    width: float

    def touches(self, other: Pose) -> bool:
        """Returns whether both rectangles have a point in common."""
        ours, theirs = self.corners(), other.corners()
        for heading in (self.heading, other.heading):
            for x, y in (
                (math.cos(heading), math.sin(heading)),
                (-math.sin(heading), math.cos(heading)),
            ):
                our, their = ([px * x + py * y for px, py in corners] for corners in (ours, theirs))
                if min(our) > max(their) or min(their) > max(our):
                    return False
        return True

    def corners(self) -> list[tuple[float, float]]:
        """Returns the corners: front left, front right, rear right, rear left."""
        along, across = math.cos(self.heading), math.sin(self.heading)
        x, y = self.front
        half = self.width / 2
        return [
            (x - back * along - side * across, y - back * across + side * along)
            for back, side in ((0.0, half), (0.0, -half), (self.length, -half), (self.length, half))
        ]


@dataclass(frozen=True)
class Kind:
    """A type of vehicle."""

    length: float = 4.7
    width: float = 1.9
    deceleration: float = 7.5
    vclass: str = "passenger"


@cache
def _network(name: str) -> str:
    """Returns the network of this name, made by SUMO's own netconvert."""
    made = Path(_NETS.name) / f"{name}.net.xml"
    subprocess.run(
        [
            Path(sumo.SUMO_HOME) / "bin/netconvert",
            *("--node-files", _HERE / f"nets/{name}.nod.xml"),
            *("--edge-files", _HERE / f"nets/{name}.edg.xml"),
            *("--output-file", made, "--no-turnarounds", "true", "--xml-validation", "never"),
        ],
        check=True,
        capture_output=True,
    )
    return str(made)


class World:
    """A running simulation."""

    def __init__(self, kinds: dict[str, Kind]) -> None:
        self._added: list[str] = []
        for name, kind in kinds.items():
            types = libsumo.vehicletype
            types.copy("DEFAULT_VEHTYPE", name)
            types.setVehicleClass(name, kind.vclass)
            types.setLength(name, kind.length)
            types.setWidth(name, kind.width)
            types.setMinGap(name, 0.0)
            types.setMaxSpeed(name, 60.0)
            types.setDecel(name, kind.deceleration)
            types.setEmergencyDecel(name, kind.deceleration)
            # A vehicle of constant speed has its speed at once.
            types.setAccel(name, 0.01)
            types.setImperfection(name, 0.0)

    def add(
        self,
        name: str,
        kind: str,
        route: Sequence[str],
        position: float,
        speed: float,
        lane: int = 0,
    ) -> None:
        """Adds a vehicle with its front at this place of its route's first edge.

        It keeps its speed.
        """
        path = "-".join(route)
        if path not in libsumo.route.getIDList():
            libsumo.route.add(path, list(route))
        libsumo.vehicle.add(
            name,
            path,
            typeID=kind,
            departPos=str(position),
            departSpeed=str(speed),
            departLane=str(lane),
        )
        # SUMO itself would wait for a safe gap before it inserts the vehicle.
        libsumo.vehicle.moveTo(name, f"{route[0]}_{lane}", position)
        libsumo.vehicle.setPreviousSpeed(name, speed)
        libsumo.vehicle.setSpeedMode(name, _BLIND)
        libsumo.vehicle.setLaneChangeMode(name, 0)
        libsumo.vehicle.setSpeed(name, speed)
        self._added.append(name)

    def require_all(self) -> None:
        """Fails unless every vehicle that was added is there.

        A drive without one would show nothing.
        """
        if missing := set(self._added) - set(self.names()):
            raise RuntimeError(f"SUMO did not insert {', '.join(sorted(missing))}")

    def lane(self, edge: str) -> list[tuple[float, float]]:
        """Returns the middle of an edge's right lane."""
        return list(libsumo.lane.getShape(f"{edge}_0"))

    def hide(self, name: str, corners: Sequence[tuple[float, float]]) -> None:
        """Adds a polygon that hides what is behind it."""
        libsumo.polygon.add(name, list(corners), (90, 90, 90, 255), fill=True)

    def polygons(self) -> list[list[tuple[float, float]]]:
        """Returns the outlines of the obstacles that hide, as SUMO has them."""
        return [list(libsumo.polygon.getShape(name)) for name in libsumo.polygon.getIDList()]

    def brake(self, name: str, deceleration: float) -> None:
        """Brakes a vehicle at this deceleration until it stands."""
        libsumo.vehicle.setSpeedMode(name, _ONLY_LIMITS)
        libsumo.vehicle.setDecel(name, deceleration)
        libsumo.vehicle.setSpeed(name, 0.0)

    def put(self, name: str, front: tuple[float, float], heading: float) -> None:
        """Puts a vehicle where its own dynamics place it, on a lane or not."""
        angle = 90.0 - math.degrees(heading)
        libsumo.vehicle.moveToXY(name, "", -1, front[0], front[1], angle, keepRoute=2)

    def change_lane(self, name: str, lane: int, seconds: float) -> None:
        """Changes the lane at once, as in SUMO's model of lanes."""
        libsumo.vehicle.changeLane(name, lane, seconds)

    def step(self) -> None:
        """Lets 10 ms pass."""
        libsumo.simulationStep()

    @property
    def now(self) -> float:
        """Seconds since the start."""
        return float(libsumo.simulation.getTime())

    def names(self) -> tuple[str, ...]:
        """Returns the names of the vehicles that are there."""
        return tuple(libsumo.vehicle.getIDList())

    def pose(self, name: str) -> Pose:
        """Returns the place of a vehicle."""
        vehicle = libsumo.vehicle
        # SUMO's angles are degrees, clockwise from north.
        heading = math.radians(90.0 - vehicle.getAngle(name))
        return Pose(
            tuple(vehicle.getPosition(name)),
            heading,
            vehicle.getSpeed(name),
            vehicle.getLength(name),
            vehicle.getWidth(name),
        )

    def collision(self, name: str) -> float | None:
        """Returns this vehicle's speed in m/s if SUMO reports that it collides now."""
        for found in libsumo.simulation.getCollisions():
            if found.collider == name:
                return float(found.colliderSpeed)
            if found.victim == name:
                return float(found.victimSpeed)
        return None


@contextmanager
def running(network: str, kinds: dict[str, Kind]) -> Iterator[World]:
    """Yields a simulation, which ends with the block."""
    options = {
        "net-file": _network(network),
        "step-length": STEP,
        "step-method.ballistic": "true",
        "collision.action": "warn",
        "collision.mingap-factor": 0,
        "collision.check-junctions": "true",
        "no-step-log": "true",
        "no-warnings": "true",
        "xml-validation": "never",
        "time-to-teleport": -1,
    }
    libsumo.start(
        ["sumo", *(str(word) for name, value in options.items() for word in (f"--{name}", value))]
    )
    try:
        yield World(kinds)
    finally:
        libsumo.close()
