"""Profiles: how a servo approaches its goal."""

from __future__ import annotations

import dataclasses as dc
import enum
import math


class Shape(enum.IntEnum):
    """Shapes of a profile's velocity, as in the moving status of Protocol 2.0."""

    STEP = 0x00
    RECTANGULAR = 0x10
    TRIANGULAR = 0x20
    TRAPEZOIDAL = 0x30


@dc.dataclass
class Profile:
    """A target that moves with limited velocity and acceleration.

    The velocity stays continuous when the goal or the limits change.

    Attributes:
        position: [rad].
        velocity: [rad/s].
        max_velocity: [rad/s]; infinite: goals are reached at once.
        max_acceleration: [rad/s²]; infinite: no ramps.
    """

    position: float = 0.0
    velocity: float = 0.0
    max_velocity: float = math.inf
    max_acceleration: float = math.inf

    def rest(self, position: float) -> None:
        """Stop at a position [rad]."""
        self.position, self.velocity = position, 0.0

    def shape(self, way: float) -> Shape:
        """Return the shape of a motion from rest over a way [rad]."""
        if math.isinf(self.max_velocity):
            return Shape.STEP
        if math.isinf(self.max_acceleration):
            return Shape.RECTANGULAR
        reached = self.max_velocity**2 <= self.max_acceleration * abs(way)
        return Shape.TRAPEZOIDAL if reached else Shape.TRIANGULAR

    def approach(self, goal: float, step: float) -> None:
        """Move for a step [s] towards a goal [rad], to arrive there at rest."""
        way, velocity = goal - self.position, self.max_velocity
        if math.isinf(velocity):
            self.rest(goal)
        elif step > 0.0:
            if not math.isinf(self.max_acceleration):
                # Largest velocity v from which this and the next steps can stop in
                # time: v² + a step v = 2 a way.
                half = self.max_acceleration * step / 2
                square = 2 * self.max_acceleration * abs(way)
                divisor = half + math.hypot(half, square**0.5)  # 0: cannot accelerate
                velocity = min(velocity, square / divisor) if divisor else 0.0
            self._change(math.copysign(velocity, way), step)
            if abs(way) <= self.velocity * step * math.copysign(1.0, way):
                self.rest(goal)
            else:
                self.position += self.velocity * step

    def run(self, velocity: float, step: float) -> None:
        """Move for a step [s], towards a velocity [rad/s]."""
        self._change(velocity, step)
        self.position += self.velocity * step

    def _change(self, velocity: float, step: float) -> None:
        change = velocity - self.velocity
        # A step of zero length changes nothing, even with infinite acceleration.
        most = self.max_acceleration * step if step > 0.0 else 0.0
        self.velocity += math.copysign(min(abs(change), most), change)
