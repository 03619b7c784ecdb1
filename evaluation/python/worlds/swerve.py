"""Jaywalking within SUMO: it moves the person, CommonRoad's car swerves by the planner's outputs, and SUMO has both poses.

The machine decides when the plan leaves: a planner on board takes 500 ms, with a cached plan 400 ms. Prints the greatest speed
without contact for each. SUMO's own collisions at a junction are of boxes along the axes, too coarse for a car that turns: so
contact is when the two rectangles that it reports overlap.
"""

from __future__ import annotations

import argparse
import json
import sys

from car import Car
from drive import nanos
from fuseline.deadline import Constant, Situation
from jaywalking import ASIDE, DISTANCE, LATERAL, RADIUS, STEP, WALKING
from operators import Fused
from scenes import EGO, HAZARD, KINDS, Meeting
from world import STEP as TICK
from world import running

#: The time between two messages to the planner, in s.
EVERY = 0.1
#: Nothing hides the person.
OPEN = (60.0, 60.0)


def touches(speed: float, response: float) -> bool:
    """Returns whether the car touches the person if the planner takes this long."""
    # The person's middle is ASIDE to the right when the car is DISTANCE away. SUMO places a person
    # by the front.
    crossing = (ASIDE - RADIUS) / WALKING
    scene = Meeting(speed, "person", WALKING, crossing - DISTANCE / speed, OPEN)
    enters = scene.seconds - DISTANCE / speed
    planner, messages, car = Fused(Constant(EVERY)), 0, None
    with running(scene.network, KINDS) as world:
        scene.place(world)
        world.step()
        world.require_all()
        while world.now < enters + 4.0 and EGO in world.names() and HAZARD in world.names():
            now = world.now
            if now >= enters + messages * EVERY:
                planner.frame(nanos(enters + messages * EVERY), nanos(response), None, Situation())
                messages += 1
            if planner.until(nanos(now)) and car is None:
                ego = world.pose(EGO)
                car = Car(ego.front, ego.heading, ego.speed)
            if car:
                for _ in range(round(TICK / STEP)):
                    car.swerve(STEP, LATERAL)
                world.put(EGO, car.front, car.heading)
            world.step()
            if EGO in world.names() and HAZARD in world.names():
                ego, person = world.pose(EGO), world.pose(HAZARD)
                if ego.touches(person):
                    return True
                if min(x for x, _ in ego.corners()) > max(x for x, _ in person.corners()):
                    return False
    return False


def greatest(response: float) -> float:
    """Returns the greatest speed up to which it touches nobody, in m/s, to 0.02."""
    low = 6.0
    while not touches(low + 0.5, response):
        low += 0.5
    high = low + 0.5
    while high - low > 0.02:
        middle = (low + high) / 2
        low, high = (low, middle) if touches(middle, response) else (middle, high)
    return round(low, 2)


def main() -> int:
    """Prints the speeds."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="the figures as JSON")
    options = parser.parse_args()
    found = {response: greatest(response) for response in (0.5, 0.4)}
    if options.json:
        print(json.dumps(found))
    else:
        print(f"swerve in SUMO: {found[0.5]:.2f} m/s at 500 ms, {found[0.4]:.2f} at 400 ms")
    return 0


if __name__ == "__main__":
    sys.exit(main())
