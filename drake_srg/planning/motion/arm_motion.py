"""The arm's current motion: its commands at any time."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from pydrake.trajectories import (
    PathParameterizedTrajectory,
    PiecewisePolynomial,
    Trajectory,
)

from drake_srg.types import Vector

# Duration of a stop in the middle of a motion [s]: from the iiwa's top speed, 1.5 to
# 2.4 rad/s, this takes less than half of its acceleration limits.
STOP_TIME = 0.4
_SEARCH = 1e-3  # resolution of a search along a path [s]
_ARRIVED = 0.005  # joint error within which the arm has arrived [rad]
# Largest lag of an arm whose motion does not end at rest [s].
_LAG = 0.05
_TICK = 1e-6  # times that differ by less are equal [s]


@dc.dataclass(frozen=True)
class Motion:
    """The arm's current motion, or its place at rest."""

    q_rest: Vector  # position without a trajectory, shape (N,) [rad]
    trajectory: Trajectory | None = None
    departed: float = 0.0  # when the trajectory began [s]
    due: float = 0.0  # when it is over, including waits [s]
    stopped_at: float | None = None  # time in the trajectory at which a stop began [s]

    def position(self, time: float) -> Vector:
        """Return the commanded position at a time, shape (N,) [rad]."""
        if self.trajectory is None:
            return self.q_rest
        t = time - self.departed
        if self.stopped_at is not None:
            t = min(t - self.stopped_at, STOP_TIME)
            t = self.stopped_at + t - 0.5 * t * t / STOP_TIME
        end = self.trajectory.end_time()
        q: Vector = self.trajectory.value(end if t > end - _TICK else t)[:, 0]
        return q

    @property
    def destination(self) -> Vector:
        """The position at which the commands end, shape (N,) [rad]."""
        return self.position(np.inf)

    def arrived(self, q: Vector, time: float) -> bool:
        """Return whether the motion is over and the arm at `q` (N,) [rad] has arrived.

        A motion need not end at rest, if another one follows.
        """
        if self.trajectory is None:
            return True
        if time < self.due - _TICK:
            return False
        behind = np.abs(q - self.destination)
        return bool(np.all(behind < _ARRIVED + _LAG * self._end_speed))

    def error(self, q: Vector, time: float) -> float:
        """Return the largest path error of any joint [rad].

        Args:
            q: Posture of the arm, shape (N,) [rad].
            time: Now [s].
        """
        return float(np.max(np.abs(q - self.position(time))))

    @property
    def _end_speed(self) -> Vector:
        """Return the joints' speeds at the trajectory's end, shape (N,) [rad/s]."""
        if self.trajectory is None or self.stopped_at is not None:
            return np.zeros_like(self.q_rest)
        end = self.trajectory.EvalDerivative(self.trajectory.end_time(), 1)
        speed: Vector = np.abs(end[:, 0])
        return speed

    def stopped(self, time: float) -> Motion:
        """Return the motion that comes to rest along its own path from `time` on."""
        if self.trajectory is None or self.stopped_at is not None:
            return self
        return dc.replace(self, stopped_at=time - self.departed, due=time + STOP_TIME)

    def nearest(self, q: Vector) -> tuple[float, Vector]:
        """Return the point of a stopped motion's path nearest to `q` (N,) [rad].

        It is not beyond the place at which the stop ends.

        Returns:
            Its time in the trajectory [s] and its position, shape (N,) [rad].
        """
        if self.trajectory is None or self.stopped_at is None:
            return 0.0, self.destination
        end = min(self.stopped_at + 0.5 * STOP_TIME, self.trajectory.end_time())
        first = max(self.stopped_at - STOP_TIME, 0.0)
        times = [*np.arange(first, end, _SEARCH).tolist(), end]
        path = np.array([self.trajectory.value(t)[:, 0] for t in times])
        best = int(np.argmin(np.linalg.norm(path - q, axis=1)))
        return times[best], path[best]

    def resumed(self, time: float, since: float) -> Motion:
        """Return the rest of a stopped motion; it accelerates as gently as it braked.

        Args:
            time: Start of the motion [s].
            since: Time in its trajectory at which the rest begins [s].
        """
        if self.trajectory is None:
            return Motion(self.q_rest)
        remaining = self.trajectory.end_time() - since
        if remaining < _SEARCH:
            return Motion(self.trajectory.value(self.trajectory.end_time())[:, 0])
        # The speed along the path rises evenly to the trajectory's, if the rest is long
        # enough.
        ramp = min(STOP_TIME, float(np.sqrt(2.0 * STOP_TIME * remaining)))
        covered, speed = 0.5 * ramp**2 / STOP_TIME, ramp / STOP_TIME
        breaks, reached, speeds = [0.0, ramp], [since, since + covered], [0.0, speed]
        if remaining - covered > _SEARCH:
            breaks.append(ramp + remaining - covered)
            reached, speeds = [*reached, since + remaining], [*speeds, speed]
        scaling = PiecewisePolynomial.CubicHermite(breaks, [reached], [speeds])
        rest = PathParameterizedTrajectory(self.trajectory, scaling)
        return Motion(self.q_rest).followed_by(rest, time)

    def ended(self, time: float) -> Motion:
        """Return the arm at rest; a motion that is not yet over comes to a stop."""
        under_way = self.trajectory is not None and time < self.due
        rest = self.stopped(time) if under_way else Motion(self.q_rest)
        return dc.replace(rest, q_rest=self.position(time))

    def led_to(self, q: Vector, time: float) -> Motion:
        """Return the motion that leaves its path to rest at `q` (N,) [rad]."""
        v = np.zeros_like(q)
        if self.trajectory is not None and self.stopped_at is None:
            t = min(time - self.departed, self.trajectory.end_time())
            v = self.trajectory.EvalDerivative(t, 1)[:, 0]
        aside = PiecewisePolynomial.CubicHermite(
            [0.0, STOP_TIME],
            np.column_stack([self.position(time), q]),
            np.column_stack([v, np.zeros_like(q)]),
        )
        return dc.replace(self.followed_by(aside, time), q_rest=q.copy())

    def followed_by(
        self, trajectory: Trajectory | None, time: float, wait: float = 0.0
    ) -> Motion:
        """Return the motion that begins at `time`, with a wait [s] at its end."""
        due = time + (trajectory.end_time() if trajectory else 0.0)
        return Motion(self.position(time), trajectory, time, due + wait)
