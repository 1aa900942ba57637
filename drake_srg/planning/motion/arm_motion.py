"""The arm's motion under way: where the commands are at any time."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from pydrake.trajectories import Trajectory

from drake_srg.types import Vector

# Duration of a stop in the middle of a motion [s]: at the iiwa's top speed, 1.5 to 2.4
# rad/s, that brakes with less than half of its acceleration limits.
_STOP_TIME = 0.4
_ARRIVED = 0.005  # joint error within which the arm is where it was sent [rad]


@dc.dataclass(frozen=True)
class Motion:
    """The arm's motion under way, or where the arm rests without one."""

    q_rest: Vector  # where the arm is without a trajectory, shape (N,) [rad]
    trajectory: Trajectory | None = None
    departed: float = 0.0  # when the trajectory began [s]
    due: float = 0.0  # when it is over, waits included [s]
    stopped_at: float | None = None  # time in the trajectory where a stop began [s]

    def position(self, time: float) -> Vector:
        """Return the commanded position at a time, shape (N,) [rad]."""
        if self.trajectory is None:
            return self.q_rest
        t = time - self.departed
        if self.stopped_at is not None:
            t = min(t - self.stopped_at, _STOP_TIME)
            t = self.stopped_at + t - 0.5 * t * t / _STOP_TIME
        q: Vector = self.trajectory.value(min(t, self.trajectory.end_time()))[:, 0]
        return q

    @property
    def destination(self) -> Vector:
        """The position in which the commands end, shape (N,) [rad]."""
        return self.position(np.inf)

    def arrived(self, q: Vector, time: float) -> bool:
        """Return whether the motion is over and the arm, at `q` (N,) [rad], there."""
        if self.trajectory is None:
            return True
        if time < self.due:
            return False
        return bool(np.max(np.abs(q - self.destination)) < _ARRIVED)

    def stopped(self, time: float) -> Motion:
        """Return the motion that comes to rest along its own path from `time` on."""
        if self.trajectory is None or self.stopped_at is not None:
            return self
        return dc.replace(self, stopped_at=time - self.departed, due=time + _STOP_TIME)

    def ended(self, time: float) -> Motion:
        """Return the rest that follows; a motion that is not yet over is stopped."""
        under_way = self.trajectory is not None and time < self.due
        rest = self.stopped(time) if under_way else Motion(self.q_rest)
        return dc.replace(rest, q_rest=self.position(time))

    def followed_by(
        self, trajectory: Trajectory | None, time: float, wait: float = 0.0
    ) -> Motion:
        """Return the motion that begins at `time`, with a wait at its end [s]."""
        due = time + (trajectory.end_time() if trajectory else 0.0)
        return Motion(self.position(time), trajectory, time, due + wait)
