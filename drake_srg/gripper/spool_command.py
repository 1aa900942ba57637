"""What closure, or somebody who commands the motor itself, asks of the spool."""

import dataclasses as dc

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues

from drake_srg.common.srg_geometry import SRG
from drake_srg.gripper.moment_arms import wire_travel
from drake_srg.lifetime import LeafSystem
from drake_srg.types import positive


@dc.dataclass(kw_only=True)
class SpoolCommandConfig:
    """From closure to spool angle."""

    # Sum of base and tip angle that closure 1 asks of an empty hand [rad], and the
    # base's limit, from where on the tip closes; as in UnderactuationConfig.
    full_scale: float = dc.field(default=SRG.full_scale, metadata=positive())
    # (The fitted moment arms end at 2.007 rad.)
    base_limit: float = dc.field(default=SRG.joint_limit, metadata=positive(le=2.007))
    period: float = dc.field(default=0.01, metadata=positive())  # s


def spool_angle(
    closure: float, spool_radius: float, config: SpoolCommandConfig
) -> float:
    """Spool angle at which an empty hand is closed as closure asks [rad].

    A wire that closes a finger on nothing moves the base to its limit and then the tip,
    as Algorithm 1 does: with this, closure means the same for both drivers.
    """
    total = config.full_scale * min(max(closure, 0.0), 1.0)
    base = min(total, config.base_limit)
    return float(wire_travel(base, total - base)) / spool_radius


class SpoolCommand(LeafSystem):
    """Turns closure, or what is asked of the motor, into a target of the spool.

    .. pydrake_system::

        name: SpoolCommand
        input_ports:
        - closure_commanded
        - motor_state
        - triggered
        - hold (optional)
        - motor_position_commanded (optional)
        - motor_torque_commanded (optional)
        output_ports:
        - angle_desired
        - torque_desired

    `closure_commanded` (1) is 0 open .. 1 closed, clipped, a NaN ignored. A finite
    `motor_position_commanded` (1), a spool angle [rad], goes before it. While
    `motor_torque_commanded` (1) is finite, so that the motor obeys that, the target
    goes with the spool, for position control to take over from there. While `hold`
    (1) is nonzero, the target, or the torque if it winds, (and so the grip) is kept if
    one of the sensors, `triggered` (4), fired when the hold began; else the spool stays
    where it was then: the angle in `motor_state` (2). `angle_desired` (1) [rad] and
    `torque_desired` (1), NaN where the motor goes by the angle, are updated every
    `config.period`.
    """

    def __init__(
        self, spool_radius: float, config: SpoolCommandConfig | None = None
    ) -> None:
        super().__init__()
        self.config = config or SpoolCommandConfig()
        self._spool_radius = spool_radius
        # target [rad], holding, torque
        state = self.DeclareDiscreteState([0.0, 0.0, np.nan])
        self._closure = self.DeclareVectorInputPort(name="closure_commanded", size=1)
        self._motor = self.DeclareVectorInputPort(name="motor_state", size=2)
        self._triggered = self.DeclareVectorInputPort(name="triggered", size=4)
        self._hold = self.DeclareVectorInputPort(name="hold", size=1)
        self._position = self.DeclareVectorInputPort(
            name="motor_position_commanded", size=1
        )
        self._torque = self.DeclareVectorInputPort(
            name="motor_torque_commanded", size=1
        )
        for name, calc in (
            ("angle_desired", self._calc_angle_desired),
            ("torque_desired", self._calc_torque_desired),
        ):
            self.DeclareVectorOutputPort(
                name=name,
                size=1,
                calc=calc,
                prerequisites_of_calc={self.discrete_state_ticket(state)},
            )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=self.config.period, offset_sec=0.0, update=self._update
        )

    def _calc_angle_desired(self, context: Context, output: BasicVector) -> None:
        output[0] = context.get_discrete_state(0)[0]

    def _calc_torque_desired(self, context: Context, output: BasicVector) -> None:
        output[0] = context.get_discrete_state(0)[2]

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        target, was_holding, torque = context.get_discrete_state(0).value()
        holding = self._hold.HasValue(context) and self._hold.Eval(context)[0] != 0.0
        closure = self._closure.Eval(context)[0]
        position, torque_commanded = (
            port.Eval(context)[0] if port.HasValue(context) else np.nan
            for port in (self._position, self._torque)
        )
        angle = self._motor.Eval(context)[0]
        gripping = self._triggered.Eval(context).any() and not torque <= 0.0
        if not holding:
            torque = torque_commanded
            if np.isfinite(position):
                target = position
            elif np.isfinite(closure):
                target = spool_angle(closure, self._spool_radius, self.config)
        elif not was_holding and not gripping:
            target, torque = angle, np.nan
        if np.isfinite(torque):
            target = angle
        discrete_state.set_value([target, float(holding), torque])
