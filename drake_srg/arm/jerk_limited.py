"""Motion to targets that may jump, with limited velocity, acceleration and jerk."""

import dataclasses as dc

import numpy as np
import ruckig
from pydrake.systems.framework import BasicVector, Context, DiscreteValues

from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector, positive


def _degrees(x: float) -> list[float]:
    return [float(np.deg2rad(x))]


@dc.dataclass(kw_only=True)
class JerkLimits:
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
        output_ports:
        - position_commanded

    Every `period`, the system reads the targets from `position_desired` (N) [rad or m],
    which may change at any time. An entry that is not finite leaves its joint's target
    unchanged. While the first entry of `position_held` (N) is finite, the joints rest
    there and targets are ignored. Otherwise, each joint moves on its own, from its
    present position, velocity and acceleration to rest at its target, in the least time
    that the limits allow (Ruckig: Berscheid and Kröger, RSS 2021). `position_commanded`
    (N) is updated every `period`: from the targets at a time follows the position one
    period later.

    Args:
        home: Where the joints are, and stay without targets, shape (N,) [rad or m].
        limits: Of velocity, acceleration and jerk.
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
        self.DeclareVectorOutputPort(
            name="position_commanded",
            size=n,
            calc=self._calc_position,
            prerequisites_of_calc={self.discrete_state_ticket(state)},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._update
        )

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
        # A joint comes to rest exactly at its target, so equality means that it rests.
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
