"""The greatest speed at which CommonRoad's car touches nobody who steps out 10 m before it.

The person, the cap of 7 m/s² to the side and the deceleration of 7.5 m/s² are those of `fuseline scenario jaywalking`; the car's
motion is CommonRoad's. Prints a line for each manoeuvre: the speeds after responses of 0.5 and 0.4 s, in m/s.
"""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

from car import Car

DISTANCE, WALKING, ASIDE, RADIUS = 10.0, 1.5, 1.75, 0.3
LATERAL, DECELERATION = 7.0, 7.5
STEP = 0.001


def touches(speed: float, response: float, *, swerves: bool, steering_rate: float) -> bool:
    """Returns whether the car touches the person if it acts after this response."""
    car, now = Car((0.0, 0.0), 0.0, speed), 0.0
    car.figures.steering.v_max = steering_rate
    while car.middle[0] < DISTANCE + 5.0 and now < 4.0:
        if now < response:
            car.coast(STEP)
        elif swerves:
            car.swerve(STEP, LATERAL)
        else:
            car.brake(STEP, DECELERATION)
        now += STEP
        if car.distance_to((DISTANCE, WALKING * now - ASIDE)) < RADIUS:
            return True
        if car.speed < 0.1 and WALKING * now > ASIDE + 1.5:
            return False
    return False


def greatest(response: float, *, swerves: bool, steering_rate: float = 0.4) -> float:
    """Returns the greatest speed up to which it touches nobody, in m/s, to 0.01."""
    low = 3.0
    while not touches(low + 0.25, response, swerves=swerves, steering_rate=steering_rate):
        low += 0.25
    high = low + 0.25
    while high - low > 0.005:
        middle = (low + high) / 2
        if touches(middle, response, swerves=swerves, steering_rate=steering_rate):
            high = middle
        else:
            low = middle
    return round(low, 2)


ROWS: dict[str, dict[str, Any]] = {
    "swerve, 0.4 rad/s": {"swerves": True, "steering_rate": 0.4},
    "swerve, 1.0 rad/s": {"swerves": True, "steering_rate": 1.0},
    "brake": {"swerves": False},
}


def main() -> int:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="the figures as JSON")
    options = parser.parse_args()
    found = {
        name: [greatest(response, **row) for response in (0.5, 0.4)] for name, row in ROWS.items()
    }
    if options.json:
        print(json.dumps(found))
        return 0
    print(f"{'CommonRoad 3.0.2, vehicle 2':<30}{'500 ms':>8}{'400 ms':>8}")
    for name, (slow, fast) in found.items():
        print(f"{name:<30}{slow:>8.2f}{fast:>8.2f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
