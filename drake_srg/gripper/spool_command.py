"""The target of the spool, from closure or from commands to the motor itself."""

import dataclasses as dc

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues

from drake_srg.common.srg_geometry import SRG
from drake_srg.gripper.moment_arms import wire_travel
from drake_srg.lifetime import LeafSystem
from drake_srg.types import positive


@dc.dataclass(kw_only=True)
class SpoolCommandConfig:
    """How closure becomes a spool angle."""

    # Base plus tip angle that closure 1 asks of an empty hand [rad], and the limit of
    # the base, beyond which the tip closes; as in `UnderactuationConfig`.
    full_scale: float = dc.field(default=SRG.full_scale, metadata=positive())
    # The fitted moment arms end at 2.007 rad.
    base_limit: float = dc.field(default=SRG.joint_limit, metadata=positive(le=2.007))
    period: float = dc.field(default=0.01, metadata=positive())  # s


def spool_angle(
    closure: float, spool_radius: float, config: SpoolCommandConfig
) -> float:
    """Return the spool angle that closes an empty hand as closure asks [rad].

    A wire that closes a finger on nothing moves the base to its limit and then the tip,
    as Algorithm 1 does. So closure means the same for both drivers.

    Args:
        closure: 0 open .. 1 closed, clipped.
        spool_radius: [m].
        config: How closure becomes an angle.
    """
    total = config.full_scale * min(max(closure, 0.0), 1.0)
    base = min(total, config.base_limit)
    return float(wire_travel(base, total - base)) / spool_radius


class SpoolCommand(LeafSystem):
    """Turns closure, or commands to the motor, into a target of the spool.

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

    The outputs, updated every `config.period`, are `angle_desired` (1) [rad] and
    `torque_desired` (1), a fraction of the torque at full PWM. The torque is NaN while
    the motor goes by the angle. Commands, the strongest first:

    * `hold` (1): while nonzero, the target stays as it is, or the torque if that winds
      the spool, and so does the grip, provided that one of the sensors, `triggered`
      (4), fired when the hold began. Otherwise, the spool stays at the angle that it
      had then, from `motor_state` (2).
    * `motor_torque_commanded` (1): while finite, the motor obeys it. The target follows
      the spool, so that position control can take over from there.
    * `motor_position_commanded` (1): a finite spool angle [rad].
    * `closure_commanded` (1): 0 open .. 1 closed, clipped, NaN ignored.

    Args:
        spool_radius: [m].
        config: How closure becomes a spool angle.
    """

    def __init__(
        self, spool_radius: float, config: SpoolCommandConfig | None = None
    ) -> None:
        super().__init__()
        self.config = config or SpoolCommandConfig()
        self._spool_radius = spool_radius
        # Target [rad], holding, torque.
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
