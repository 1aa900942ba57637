"""References: jerk-limited motion to targets, and motion along trajectories."""

import dataclasses as dc

import numpy as np
import ruckig
from pydrake.systems.framework import BasicVector, Context, DiscreteValues

from drake_srg.config import Config, positive
from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector


def _degrees(x: float) -> list[float]:
    return [float(np.deg2rad(x))]


@dc.dataclass(kw_only=True)
class JerkLimits(Config):
    """Limits of the joints' motion: one entry for all joints, or one per joint.

    The defaults are those of the SRG thesis for the iiwa: 110 degrees/s, 40 degrees/s²
    and 80 degrees/s³.
    """

    velocity: list[float] = dc.field(
        default_factory=lambda: _degrees(110.0), metadata=positive()
    )  # rad/s or m/s
    acceleration: list[float] = dc.field(
        default_factory=lambda: _degrees(40.0), metadata=positive()
    )  # rad/s² or m/s²
    jerk: list[float] = dc.field(
        default_factory=lambda: _degrees(80.0), metadata=positive()
    )  # rad/s³ or m/s³


# Rows of the discrete state, which has one column per joint.
_POSITION, _VELOCITY, _ACCELERATION, _TARGET = range(4)


class JerkLimitedReference(LeafSystem):
    """Moves N joints to their newest targets as fast as the limits allow.

    .. pydrake_system::

        name: JerkLimitedReference
        input_ports:
        - position_desired (optional)
        - position_held (optional)
        - state_measured (optional)
        output_ports:
        - position_commanded

    Every `period`, the system reads the targets from `position_desired` (N) [rad or m],
    which may change at any time. An entry that is not finite leaves its joint's target
    unchanged. While the first entry of `position_held` (N) is finite, the joints rest
    at that position, and targets are ignored. Otherwise, each joint moves independently
    from its present position, velocity and acceleration to rest at its target, in the
    least time that the limits allow (Ruckig: Berscheid and Kröger, RSS 2021).
    `position_commanded` (N) is updated every `period`; a target affects it one period
    later. When a simulation starts, the joints rest at their position according to
    `state_measured` (2N), [q; v].

    Args:
        home: The joints' position at the start without `state_measured`, shape (N,)
            [rad or m].
        limits: Limits of velocity, acceleration and jerk.
        period: Time between updates [s].

    Raises:
        ValueError: If a limit has neither one entry nor one entry per joint.
    """

    def __init__(self, home: Vector, limits: JerkLimits, period: float) -> None:
        super().__init__()
        self._n = n = len(home)
        self._period = period
        self._limits: dict[str, list[float]] = {}
        for name, values in dc.asdict(limits).items():
            if len(values) not in (1, n):
                raise ValueError(
                    f"limits.{name}: needs 1 entry or {n}, got {len(values)}"
                )
            self._limits[f"max_{name}"] = np.broadcast_to(values, n).tolist()

        rows = np.zeros((4, n))
        rows[[_POSITION, _TARGET]] = home
        state = self.DeclareDiscreteState(rows.flatten())
        self._desired = self.DeclareVectorInputPort(name="position_desired", size=n)
        self._held = self.DeclareVectorInputPort(name="position_held", size=n)
        self._measured = self.DeclareVectorInputPort(name="state_measured", size=2 * n)
        self.DeclareVectorOutputPort(
            name="position_commanded",
            size=n,
            calc=self._calc_position,
            prerequisites_of_calc={self.discrete_state_ticket(state)},
        )
        self.DeclareInitializationDiscreteUpdateEvent(self._initialize)
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._update
        )

    def _initialize(self, context: Context, discrete_state: DiscreteValues) -> None:
        if self._measured.HasValue(context):
            rows = np.zeros((4, self._n))
            rows[[_POSITION, _TARGET]] = self._measured.Eval(context)[: self._n]
            discrete_state.set_value(rows.flatten())

    def _rows(self, context: Context) -> Vector:
        value: Vector = context.get_discrete_state(0).value()
        return value.reshape(4, self._n)

    def _calc_position(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._rows(context)[_POSITION])

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        rows = self._rows(context)
        position, velocity, acceleration, target = rows
        if self._held.HasValue(context):
            held = self._held.Eval(context)
            if np.isfinite(held[0]):
                nothing = np.zeros(self._n)
                discrete_state.set_value(np.concatenate([held, nothing, nothing, held]))
                return
        moving = rows[[_VELOCITY, _ACCELERATION]].any()
        if self._desired.HasValue(context):
            desired = self._desired.Eval(context)
            target = np.where(np.isfinite(desired), desired, target)
        # A joint comes to rest exactly at its target, so equality means rest.
        if not moving and np.array_equal(target, position):
            return
        move, trajectory = ruckig.InputParameter(self._n), ruckig.Trajectory(self._n)
        move.synchronization = ruckig.Synchronization.No
        for name, values in self._limits.items():
            setattr(move, name, values)
        move.current_position = position
        move.current_velocity = velocity
        move.current_acceleration = acceleration
        move.target_position = target
        result = ruckig.Ruckig(self._n).calculate(move, trajectory)
        if result != ruckig.Result.Working:
            raise RuntimeError(
                f"Ruckig finds no motion ({result}) from {position} at {velocity}, "
                f"{acceleration} to {target}"
            )
        moved = np.array(trajectory.at_time(self._period))
        arrived = np.array(trajectory.independent_min_durations) <= self._period
        moved = np.where(arrived, [target, np.zeros(self._n), np.zeros(self._n)], moved)
        discrete_state.set_value(np.append(moved, target))


CAPACITY = 100  # largest number of points of a piece


def trajectory_piece(times: Vector, positions: Vector, start: float = 0.0) -> Vector:
    """Return a piece of a trajectory for `TrajectoryFollower`.

    Args:
        times: Times of its points after the start, increasing, shape (K,) [s].
        positions: Positions of the joints, shape (K, N) [rad or m].
        start: Time at which the piece begins [s]; 0: as soon as it arrives.

    Raises:
        ValueError: If there are more than `CAPACITY` points.
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

    Every `period`, the system reads `trajectory_desired`, a `trajectory_piece`. A new
    piece replaces the current one: from the present position, the system moves to the
    first future point, then from point to point, and rests at the last one. A piece
    whose points are all in the past, or NaN, changes nothing. While the first entry of
    `position_held` (N) is finite, the joints rest at that position, and pieces are
    discarded. `position_commanded` (N) is in rad or m.

    Args:
        home: The joints' first position, shape (N,) [rad or m].
        period: Time between updates [s].
    """

    def __init__(self, home: Vector, period: float) -> None:
        super().__init__()
        self._n = n = len(home)
        self._period = period
        size = 1 + CAPACITY * (1 + n)
        # The last piece that was read, and the points of the present motion, which
        # begin with one that has been passed.
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
        """Return the points of the present motion (K, 1 + N): times and positions."""
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
