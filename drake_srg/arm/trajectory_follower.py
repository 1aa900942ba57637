"""Motion along trajectories that arrive piece by piece."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues

from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector

CAPACITY = 100  # points that a piece may have


def trajectory_piece(times: Vector, positions: Vector, start: float = 0.0) -> Vector:
    """Return a piece of a trajectory as `TrajectoryFollower` takes it.

    Args:
        times: Of its points after the start, increasing, shape (K,) [s].
        positions: Of the joints, shape (K, N) [rad or m].
        start: When it begins [s]; 0: as soon as it arrives.

    Raises:
        ValueError: If it has more than `CAPACITY` points.
    """
    count, n = positions.shape
    if count > CAPACITY:
        raise ValueError(f"needs at most {CAPACITY} points, got {count}")
    piece = np.full((CAPACITY, 1 + n), np.nan)
    piece[:count, 0], piece[:count, 1:] = times, positions
    return np.append(start, piece.ravel())


class TrajectoryFollower(LeafSystem):
    """Moves N joints evenly from point to point of the newest trajectory.

    .. pydrake_system::

        name: TrajectoryFollower
        input_ports:
        - trajectory_desired (optional)
        - position_held (optional)
        output_ports:
        - position_commanded

    Every `period`, the system looks at `trajectory_desired`, a `trajectory_piece`. A
    new one replaces what it follows: from where it is now, it moves to the first point
    whose time is to come, and so on. It rests at the last one. A piece whose points are
    all in the past, or NaN, changes nothing. While the first entry of `position_held`
    (N) is finite, the joints rest there, and pieces are forgotten. `position_commanded`
    (N) is in rad or m.

    Args:
        home: Where the joints are at first, shape (N,) [rad or m].
        period: Time between updates [s].
    """

    def __init__(self, home: Vector, period: float) -> None:
        super().__init__()
        self._n = n = len(home)
        self._period = period
        size = 1 + CAPACITY * (1 + n)
        # The last piece seen; the points that are followed, the first of them passed.
        self._seen = int(self.DeclareDiscreteState(np.full(size, np.nan)))
        points = np.full((CAPACITY + 1, 1 + n), np.nan)
        points[0] = [0.0, *home]
        self._points = int(self.DeclareDiscreteState(points.ravel()))
        self._desired = self.DeclareVectorInputPort(
            name="trajectory_desired", size=size
        )
        self._held = self.DeclareVectorInputPort(name="position_held", size=n)
        self.DeclareVectorOutputPort(
            name="position_commanded",
            size=n,
            calc=self._calc_position,
            prerequisites_of_calc={self.xd_ticket(), self.time_ticket()},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._update
        )

    def _following(self, context: Context) -> Vector:
        """Return the points (K, 1 + N) that are followed: times and positions."""
        flat: Vector = context.get_discrete_state(self._points).value()
        points = flat.reshape(CAPACITY + 1, 1 + self._n)
        return points[~np.isnan(points[:, 0])]

    def _position(self, context: Context, time: float) -> Vector:
        points = self._following(context)
        return np.array([np.interp(time, points[:, 0], q) for q in points[:, 1:].T])

    def _calc_position(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._position(context, context.get_time()))

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        time = context.get_time()
        piece = np.full(1, np.nan)
        if self._desired.HasValue(context):
            piece = self._desired.Eval(context)
            seen = context.get_discrete_state(self._seen).value()
            if np.array_equal(piece, seen, equal_nan=True):
                piece = np.full(1, np.nan)
            else:
                discrete_state.set_value(self._seen, piece)
        position = self._position(context, time)
        ahead = np.zeros((0, 1 + self._n))
        if self._held.HasValue(context) and np.isfinite(self._held.Eval(context)[0]):
            position = self._held.Eval(context)
        elif np.isfinite(piece[0]):
            points = piece[1:].reshape(CAPACITY, 1 + self._n).copy()
            points[:, 0] += piece[0] or time
            ahead = points[points[:, 0] > time]
            if not len(ahead):
                return
        else:
            return
        following = np.full((CAPACITY + 1, 1 + self._n), np.nan)
        following[0] = [time, *position]
        following[1 : 1 + len(ahead)] = ahead
        discrete_state.set_value(self._points, following.ravel())
