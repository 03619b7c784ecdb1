"""The car of CommonRoad's vehicle models: a single track with tyres that slip, a BMW 320i."""

from __future__ import annotations

import math
from collections.abc import Sequence

from vehiclemodels.init_st import init_st
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.vehicle_dynamics_st import vehicle_dynamics_st

#: The length and width that the scenarios of `fuseline` have, in metres.
LENGTH, WIDTH = 4.7, 1.9


class Car:
    """A car in metres, seconds and radians.

    Its state is CommonRoad's: x and y of the centre of mass, steering angle, speed, heading, yaw
    rate and slip.
    """

    def __init__(self, front: tuple[float, float], heading: float, speed: float) -> None:
        self.figures = parameters_vehicle2()
        x = front[0] - LENGTH / 2 * math.cos(heading)
        y = front[1] - LENGTH / 2 * math.sin(heading)
        self._state: list[float] = list(init_st([x, y, 0.0, speed, heading, 0.0, 0.0]))

    @property
    def speed(self) -> float:
        """Its speed in m/s."""
        return self._state[3]

    @property
    def heading(self) -> float:
        """Its heading in radians."""
        return self._state[4]

    @property
    def middle(self) -> tuple[float, float]:
        """The centre of its rectangle, which here is its centre of mass."""
        return self._state[0], self._state[1]

    @property
    def front(self) -> tuple[float, float]:
        """The middle of its front."""
        x, y = self.middle
        return x + LENGTH / 2 * math.cos(self.heading), y + LENGTH / 2 * math.sin(self.heading)

    def brake(self, seconds: float, deceleration: float) -> None:
        """Drives on and brakes."""
        self._step(seconds, 0.0, -deceleration if self.speed > 0.05 else 0.0)

    def coast(self, seconds: float) -> None:
        """Drives on as before."""
        self._step(seconds, 0.0, 0.0)

    def swerve(self, seconds: float, lateral: float) -> None:
        """Drives on and turns the wheels to the left.

        The wheels turn as fast as they can, up to the angle of this lateral acceleration.
        """
        wheelbase = self.figures.a + self.figures.b
        angle = math.atan(lateral * wheelbase / max(self.speed, 1.0) ** 2)
        turning = self._state[2] < min(self.figures.steering.max, angle)
        self._step(seconds, self.figures.steering.v_max if turning else 0.0, 0.0)

    def distance_to(self, point: tuple[float, float]) -> float:
        """Returns the distance from a point to the car's rectangle, which is 0 inside."""
        dx, dy = point[0] - self.middle[0], point[1] - self.middle[1]
        along = math.cos(self.heading) * dx + math.sin(self.heading) * dy
        across = -math.sin(self.heading) * dx + math.cos(self.heading) * dy
        return math.hypot(max(abs(along) - LENGTH / 2, 0.0), max(abs(across) - WIDTH / 2, 0.0))

    def _step(self, seconds: float, steering: float, acceleration: float) -> None:
        change: Sequence[float] = vehicle_dynamics_st(
            self._state, [steering, acceleration], self.figures
        )
        self._state = [
            value + seconds * rate for value, rate in zip(self._state, change, strict=True)
        ]
