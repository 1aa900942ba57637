"""Profiles: how a servo approaches its goal."""

from __future__ import annotations

import dataclasses as dc
import math


@dc.dataclass
class Profile:
    """A target that moves at a limited velocity and acceleration, in rad and s."""

    position: float = 0.0
    velocity: float = 0.0

    def rest(self, position: float) -> None:
        """Stop at a position [rad]."""
        self.position, self.velocity = position, 0.0

    def approach(
        self, goal: float, velocity: float, acceleration: float, step: float
    ) -> None:
        """Move towards a goal, to arrive there at rest.

        The velocity stays continuous when the goal changes.

        Args:
            goal: [rad].
            velocity: Limit [rad/s]; infinite: arrive at once.
            acceleration: Limit [rad/s²]; infinite: no ramps.
            step: Duration of this step [s].
        """
        way = goal - self.position
        if math.isinf(velocity):
            self.rest(goal)
        elif step > 0.0:
            if not math.isinf(acceleration):
                # Largest velocity from which this and the next steps can stop in time.
                half = acceleration * step / 2
                brakable = math.sqrt(half**2 + 2 * acceleration * abs(way)) - half
                velocity = min(velocity, brakable)
            self._change(math.copysign(velocity, way), acceleration, step)
            if abs(way) <= self.velocity * step * math.copysign(1.0, way):
                self.rest(goal)
            else:
                self.position += self.velocity * step

    def run(self, velocity: float, acceleration: float, step: float) -> None:
        """Move at a velocity [rad/s], reached with a limited acceleration [rad/s²]."""
        self._change(velocity, acceleration, step)
        self.position += self.velocity * step

    def _change(self, velocity: float, acceleration: float, step: float) -> None:
        change = velocity - self.velocity
        most = acceleration * step if step > 0.0 else 0.0  # not infinity times zero
        self.velocity += math.copysign(min(abs(change), most), change)
