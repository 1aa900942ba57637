"""Tells when a robot and its twin part."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues

from drake_srg.lifetime import LeafSystem
from drake_srg.scenario.twin import TwinConfig
from drake_srg.types import Vector

# What is compared, in the order of the ports.
KINDS = ("joint", "torque", "finger", "object")
# A difference is over once it is below this share of its limit.
_OVER = 0.8


class TwinMonitor(LeafSystem):
    """Compares a robot's measurements with its twin.

    .. pydrake_system::

        name: TwinMonitor
        input_ports:
        - arm_state
        - arm_state_measured
        - torque_residual
        - gripper_state
        - gripper_state_measured
        - object_error
        output_ports:
        - joint_error
        - finger_error
        - difference
        - parted

    The states [q; v] (2N, 2n) are those of the twin and of the robot [rad, rad/s];
    `torque_residual` (N) is in N m and `object_error` (m) in m. A NaN is a measurement
    that nobody tells, and no difference.

    `joint_error` (N) and `finger_error` (n) are measured minus twin [rad].
    `difference` (4) has the largest of each of `KINDS`: joints [rad], torques [share of
    the effort limit] while the arm is still, else 0, fingers [rad], objects [m]; all of
    the last sample, like `parted`.
    `parted` (4) is 1 from when a difference has exceeded its limit for
    `config.patience`, a torque for `config.still_time`, until it is below 0.8 of the
    limit, else 0.

    Args:
        config: The limits.
        effort_limits: Of the arm's joints, shape (N,) [N m].
        fingers: Number n of finger joints.
        objects: Number m of objects.
        period: Time between samples [s].
    """

    def __init__(
        self,
        config: TwinConfig,
        effort_limits: Vector,
        fingers: int,
        objects: int,
        period: float,
    ) -> None:
        super().__init__()
        self._config, self._efforts = config, np.array(effort_limits)
        n = len(self._efforts)
        self._limits = np.array([getattr(config, kind) for kind in KINDS])
        patience, still = config.patience, config.still_time
        self._patience = np.array([patience, still, patience, patience])
        self._n, self._fingers = n, fingers
        self._inputs = {
            name: self.DeclareVectorInputPort(name=name, size=size)
            for name, size in (
                ("arm_state", 2 * n),
                ("arm_state_measured", 2 * n),
                ("torque_residual", n),
                ("gripper_state", 2 * fingers),
                ("gripper_state_measured", 2 * fingers),
                ("object_error", objects),
            )
        }
        # Since when the arm is still, since when each difference exceeds its limit
        # [s], `parted` and `difference`.
        start = np.concatenate([np.full(5, np.inf), np.zeros(8)])
        self._state = int(self.DeclareDiscreteState(start))
        inputs = {port.ticket() for port in self._inputs.values()}
        state = self.xd_ticket()
        for name, size, calc, tickets in (
            ("joint_error", n, self._calc_joint_error, inputs),
            ("finger_error", fingers, self._calc_finger_error, inputs),
            ("difference", 4, self._calc_difference, {state}),
            ("parted", 4, self._calc_parted, {state}),
        ):
            self.DeclareVectorOutputPort(
                name=name, size=size, calc=calc, prerequisites_of_calc=tickets
            )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _eval(self, context: Context, name: str) -> Vector:
        values: Vector = self._inputs[name].Eval(context)
        return values

    def _error(self, context: Context, name: str, n: int) -> Vector:
        measured = self._eval(context, f"{name}_measured")[:n]
        error: Vector = measured - self._eval(context, name)[:n]
        return error

    def _calc_joint_error(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._error(context, "arm_state", self._n))

    def _calc_finger_error(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._error(context, "gripper_state", self._fingers))

    def _difference(self, context: Context) -> Vector:
        still_since = context.get_discrete_state(self._state).value()[0]
        still = context.get_time() - still_since >= self._config.still_time
        shares = self._eval(context, "torque_residual") / self._efforts
        return np.array(
            [
                _largest(self._error(context, "arm_state", self._n)),
                _largest(shares) if still else 0.0,
                _largest(self._error(context, "gripper_state", self._fingers)),
                _largest(self._eval(context, "object_error")),
            ]
        )

    def _calc_difference(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_discrete_state(self._state).value()[9:])

    def _calc_parted(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_discrete_state(self._state).value()[5:9])

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        config, time = self._config, context.get_time()
        before = context.get_discrete_state(self._state).value()
        speed = self._eval(context, "arm_state_measured")[self._n :]
        still = (np.abs(speed) <= config.still_speed).all()
        still_since = min(before[0], time) if still else np.inf
        difference = self._difference(context)
        exceeded = difference > self._limits
        since = np.where(exceeded, np.minimum(before[1:5], time), np.inf)
        parted = before[5:9] * (difference > _OVER * self._limits)
        parted = np.where(time - since >= self._patience, 1.0, parted)
        discrete_state.set_value(
            self._state, np.concatenate([[still_since], since, parted, difference])
        )


def _largest(values: Vector) -> float:
    """Return the largest absolute value, without those that are not known; 0: none."""
    return float(np.max(np.abs(np.nan_to_num(values, nan=0.0)), initial=0.0))
