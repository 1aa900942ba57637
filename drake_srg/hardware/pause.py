"""What becomes of a motion while the arm is stopped, and how it goes on."""

from __future__ import annotations

import dataclasses as dc
import math

import numpy as np
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.common.safety_states import SafetyState, StopReason
from drake_srg.planning.motion.arm_motion import STOP_TIME, Motion
from drake_srg.types import Vector

# After these stops the monitor goes on along the path of the commands. After others it
# waits for commands that begin where the arm rests.
_PATH_KEPT = {
    StopReason.FOLLOWING_ERROR,
    StopReason.MEASURED_SPEED,
    StopReason.MEASURED_NOT_FINITE,
    StopReason.EXTERNAL_TORQUE,
    StopReason.FORCE,
    StopReason.STALE,
}
# How an arm that rests elsewhere goes to its path: at least so long [s], at most so
# fast [rad/s or m/s].
_RETURN_TIME, _RETURN_SPEED = 0.5, 0.2
_THERE = 1e-6  # rad or m


@dc.dataclass(frozen=True)
class Pause:
    """A motion while the arm is stopped, and until it is back on its path.

    Attributes:
        stopped: The motion in whose middle the arm was stopped. It comes to rest by
            itself, within the planner's limits.
        motion: The commands meanwhile.
        held: Where the arm rests, shape (N,); None: not yet.
        cut: Whether the monitor has forgotten the path.
        until: When the next thing happens after the release [s]; infinite before.
        since: Where on its path `stopped` goes on [s], once the arm returns there.
    """

    stopped: Motion
    motion: Motion
    held: Vector | None = None
    cut: bool = False
    until: float = math.inf
    since: float | None = None

    @classmethod
    def begun(cls, motion: Motion, time: float) -> Pause:
        """Return the pause that begins with a stop."""
        stopped = motion.stopped(time)
        return cls(stopped, stopped)

    def go_on(
        self, time: float, state: SafetyState, reason: StopReason, held: Vector
    ) -> Pause | Motion:
        """Return the pause one control period later, or the motion that ends it.

        Args:
            time: Now [s].
            state: Of the safety monitor.
            reason: Of the stop.
            held: Where the arm rests in a stop, otherwise NaN; shape (N,).
        """
        if state is not SafetyState.RUNNING:
            return dc.replace(
                self,
                motion=self.motion.stopped(time),
                held=held.copy() if np.isfinite(held).all() else self.held,
                cut=reason not in _PATH_KEPT,
                until=math.inf,
                since=None,
            )
        if math.isinf(self.until) and not self.cut:  # the monitor goes along its path
            return dc.replace(self, until=time + STOP_TIME)
        if math.isfinite(self.until) and time < self.until:
            return self
        if self.since is not None:
            return self.stopped.resumed(time, self.since)
        # Where the arm is by now.
        start = self.motion.destination
        if self.cut and self.held is not None:
            start = self.held
        since, q = self.stopped.nearest(start)
        if np.max(np.abs(q - start)) < _THERE:
            return self.stopped.resumed(time, since)
        back = _line(start, q)
        motion = Motion(start).followed_by(back, time)
        return dc.replace(self, motion=motion, since=since, until=motion.due)


def _line(start: Vector, goal: Vector) -> PiecewisePolynomial:
    """Return a straight motion in joint space, from rest to rest."""
    duration = max(_RETURN_TIME, float(np.max(np.abs(goal - start))) / _RETURN_SPEED)
    rest = np.zeros(len(start))
    return PiecewisePolynomial.CubicWithContinuousSecondDerivatives(
        [0.0, duration], np.stack([start, goal], axis=1), rest, rest
    )
