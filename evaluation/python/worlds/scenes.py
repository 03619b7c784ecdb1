"""The paper's three situations in SUMO, each drawn by a seed: what stands, moves and hides.

A scene puts itself into a world and then says, for any instant, what a detector would report and how far ahead something
could come into sight.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from typing import Protocol

from sight import Point, sees
from world import Kind, Pose, World

EGO, HAZARD = "ego", "hazard"
#: Ego and the other cars; the rest by their SUMO classes.
KINDS = {
    "car": Kind(),
    "motorcycle": Kind(2.2, 0.9, 7.5, "motorcycle"),
    "truck": Kind(8.0, 2.5, 6.0, "truck"),
    # SUMO moves it as a vehicle, as wide and long as a person.
    "person": Kind(0.6, 0.6, 3.0, "bicycle"),
}
#: The distance of a red light's line from the middle of ego's lane, in m, and the deceleration
#: above which a car does not stop at the line, in m/s².
LINE, HARD = 5.0, 4.0


class Scene(Protocol):
    """A situation."""

    network: str
    speed: float

    def place(self, world: World) -> None:
        """Puts all vehicles into the world."""

    def move(self, world: World) -> None:
        """Moves the others, once a step."""

    def distance(self, world: World, ego: Pose) -> float | None:
        """Returns the distance of the hazard, or None if the camera does not have it in view."""

    def reveal(self, world: World, ego: Pose) -> float | None:
        """Returns the distance to the nearest place from which something may come into sight."""

    def shared(self, world: World) -> Pose | None:
        """Returns the pose that the hazard shares, or None if it shares none."""

    def must_brake(self, ego: Pose, other: Pose, age: float) -> bool:
        """Returns whether ego brakes for a vehicle that shared this pose `age` ago and went on."""

    def is_over(self, world: World, ego: Pose) -> bool:
        """Returns whether ego is past the hazard."""

    def is_still(self, world: World) -> bool:
        """Returns whether a car that stands is safe from now on."""


def _in_view(world: World, ego: Pose, between: tuple[str, ...]) -> float | None:
    if HAZARD not in world.names():
        return None
    others = [world.pose(name).corners() for name in between if name in world.names()]
    return sees(ego.front, ego.heading, world.pose(HAZARD).corners(), [*others, *world.polygons()])


@dataclass
class Jam:
    """Something stands on ego's lane. A car before ego may hide it until that car changes its lane.
    """

    speed: float
    kind: str = "motorcycle"
    #: The distance from ego's front to the obstacle's rear, at the start.
    start: float = 200.0
    #: The car before ego: its distance, and how far before the hazard it leaves the lane. None if
    #: there is no such car.
    lead: tuple[float, float] | None = None
    #: Cars on the other lane: distance from ego, speed.
    others: tuple[tuple[float, float], ...] = ()
    network: str = field(default="straight", init=False)

    @classmethod
    def draw(cls, rng: random.Random) -> Jam:
        """Draws a jam."""
        speed = rng.uniform(11.0, 26.0)
        lead = (
            (speed * rng.uniform(0.9, 2.0), rng.uniform(25.0, 60.0)) if rng.random() < 0.5 else None
        )
        others = tuple(
            (rng.uniform(-60.0, 120.0), rng.uniform(10.0, 25.0)) for _ in range(rng.randrange(3))
        )
        kind = rng.choice(["motorcycle", "car", "truck"])
        return cls(speed, kind, rng.uniform(150.0, 220.0), lead, others)

    def place(self, world: World) -> None:
        """See `Scene`."""
        ego = 100.0
        rear = ego + self.start
        world.add(HAZARD, self.kind, ["AB"], rear + KINDS[self.kind].length, 0.0)
        world.add(EGO, "car", ["AB"], ego, self.speed)
        if self.lead:
            world.add("lead", "car", ["AB"], ego + KINDS["car"].length + self.lead[0], self.speed)
        for number, (ahead, speed) in enumerate(self.others):
            world.add(f"other{number}", "car", ["AB"], ego + ahead, speed, lane=1)

    def move(self, world: World) -> None:
        """See `Scene`."""
        if self.lead and "lead" in world.names() and HAZARD in world.names():
            hazard = world.pose(HAZARD)
            if hazard.front[0] - hazard.length - world.pose("lead").front[0] <= self.lead[1]:
                world.change_lane("lead", 1, 60.0)

    def distance(self, world: World, ego: Pose) -> float | None:
        """See `Scene`."""
        return _in_view(world, ego, ("lead",))

    def reveal(self, world: World, ego: Pose) -> float | None:
        """Returns the distance to the car ahead, as long as that is on ego's lane."""
        if not self.lead or "lead" not in world.names():
            return None
        lead = world.pose("lead")
        if abs(lead.front[1] - ego.front[1]) > 1.5:
            return None
        return max(0.0, lead.front[0] - ego.front[0])

    def shared(self, world: World) -> Pose | None:
        """Returns None: an obstacle that stands there shares nothing."""
        return None

    def must_brake(self, ego: Pose, other: Pose, age: float) -> bool:
        """See `Scene`."""
        return False

    def is_over(self, world: World, ego: Pose) -> bool:
        """See `Scene`."""
        return ego.front[0] > 100.0 + self.start + 20.0

    def is_still(self, world: World) -> bool:
        """See `Scene`."""
        return True


@dataclass
class Meeting:
    """A car that runs a red light, or a person, comes from behind a building on the right.

    It may also stop before ego's lane, as most do.
    """

    speed: float
    kind: str
    crossing_speed: float
    #: How many seconds later than ego it would be at the middle of the crossing.
    delay: float
    #: The building's corner: how far it is from the middle of ego's lane and of the other's.
    corner: Point
    #: True if it stops before ego's lane.
    stops: bool = False
    seconds: float = 8.0
    network: str = field(default="crossing", init=False)

    @classmethod
    def draw_runner(cls, rng: random.Random) -> Meeting:
        """Draws a car that runs a red light."""
        corner = (rng.uniform(5.0, 14.0), rng.uniform(4.0, 10.0))
        return cls(
            rng.uniform(9.0, 16.0),
            "car",
            rng.uniform(9.0, 16.0),
            rng.uniform(-0.5, 0.5),
            corner,
            rng.random() < 0.4,
        )

    @classmethod
    def draw_person(cls, rng: random.Random) -> Meeting:
        """Draws a person who steps out between parked vehicles."""
        corner = (rng.uniform(2.5, 4.5), rng.uniform(0.8, 2.0))
        return cls(
            rng.uniform(6.0, 14.0),
            "person",
            rng.uniform(1.0, 2.5),
            rng.uniform(-0.4, 0.4),
            corner,
            rng.random() < 0.4,
        )

    def place(self, world: World) -> None:
        """See `Scene`."""
        # Ego's lane is the right one of its road, and so is the other's. SUMO's lanes end where the junction begins.
        own, other = world.lane("WC"), world.lane("SC")
        self._y, self._x = own[-1][1], other[-1][0]
        ego = own[-1][0] - own[0][0] + (self._x - own[-1][0]) - self.speed * self.seconds
        arrival = self.seconds + self.delay
        hazard = (
            other[-1][1] - other[0][1] + (self._y - other[-1][1]) - self.crossing_speed * arrival
        )
        world.add(EGO, "car", ["WC", "CE"], ego, self.speed)
        world.add(HAZARD, self.kind, ["SC", "CN"], hazard, self.crossing_speed)
        aside, before = self.corner
        right, top = self._x - before, self._y - aside
        world.hide(
            "building",
            [(right, top), (right - 60.0, top), (right - 60.0, top - 80.0), (right, top - 80.0)],
        )

    def move(self, world: World) -> None:
        """See `Scene`."""
        if not self.stops or HAZARD not in world.names():
            return
        hazard, deceleration = world.pose(HAZARD), KINDS[self.kind].deceleration
        # Its front stops a metre before ego's side.
        left = self._y - KINDS["car"].width / 2 - 1.0 - hazard.front[1]
        if 0.0 < left <= hazard.speed**2 / (2.0 * deceleration):
            world.brake(HAZARD, deceleration)

    def distance(self, world: World, ego: Pose) -> float | None:
        """See `Scene`. A hazard that has crossed, or stands, is no obstacle."""
        if HAZARD not in world.names():
            return None
        hazard = world.pose(HAZARD)
        passed = hazard.front[1] - hazard.length > self._y + KINDS["car"].width / 2
        return None if passed or hazard.speed < 0.1 else _in_view(world, ego, ())

    def reveal(self, world: World, ego: Pose) -> float | None:
        """Returns the distance to the path of the hazard, which is 0 once ego is past it."""
        return max(0.0, self._x - ego.front[0])

    def shared(self, world: World) -> Pose | None:
        """Returns the pose of a car. A person shares nothing."""
        return world.pose(HAZARD) if self.kind == "car" and HAZARD in world.names() else None

    def must_brake(self, ego: Pose, other: Pose, age: float) -> bool:
        """Decides as `fuseline scenario red-light` does.

        Ego brakes if the other can no longer stop at its line, and both arrive together, soon.
        """
        if other.speed < 0.1:
            return False
        distance = self._y - other.front[1] - other.speed * age
        to_line = distance - LINE
        stops = to_line > 0.0 and other.speed**2 / (2.0 * to_line) <= HARD
        arrives = (self._x - ego.front[0]) / ego.speed
        return not stops and abs(distance / other.speed - arrives) < 1.0 and 0.0 < arrives < 4.0

    def is_over(self, world: World, ego: Pose) -> bool:
        """See `Scene`."""
        return ego.front[0] > self._x + 15.0

    def is_still(self, world: World) -> bool:
        """Returns whether the other has crossed, or stands."""
        if HAZARD not in world.names():
            return True
        hazard = world.pose(HAZARD)
        return hazard.speed < 0.1 or hazard.front[1] - hazard.length > self._y + KINDS["car"].width
