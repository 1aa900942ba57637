"""The target of the spool, from closure or from commands to the motor itself."""

import dataclasses as dc
import math

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues

from drake_srg.common.ports import value_or_none
from drake_srg.common.srg_geometry import SRG
from drake_srg.gripper.moment_arms import empty_hand
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

    So closure means the same for both drivers, see `empty_hand`.

    Args:
        closure: 0 open .. 1 closed, clipped.
        spool_radius: [m].
        config: How closure becomes an angle.
    """
    travel, _ = empty_hand(closure, config.full_scale, config.base_limit)
    return travel / spool_radius


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
        self._closure, self._motor, self._triggered, self._hold, *self._commands = (
            self.DeclareVectorInputPort(name=name, size=size)
            for name, size in (
                ("closure_commanded", 1),
                ("motor_state", 2),
                ("triggered", 4),
                ("hold", 1),
                ("motor_position_commanded", 1),
                ("motor_torque_commanded", 1),
            )
        )
        self._target, self._torque, self._holding = (
            self.DeclareDiscreteState([value]) for value in (0.0, np.nan, 0.0)
        )
        self.DeclareStateOutputPort("angle_desired", self._target)
        self.DeclareStateOutputPort("torque_desired", self._torque)
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=self.config.period, offset_sec=0.0, update=self._update
        )

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        target, torque, was_holding = (
            float(context.get_discrete_state(index).value()[0])
            for index in (self._target, self._torque, self._holding)
        )
        hold = value_or_none(self._hold, context)
        holding = hold is not None and hold[0] != 0.0
        closure, angle = (
            float(port.Eval(context)[0]) for port in (self._closure, self._motor)
        )
        position, torque_commanded = (
            math.nan if command is None else float(command[0])
            for command in (value_or_none(port, context) for port in self._commands)
        )
        gripping = self._triggered.Eval(context).any() and not torque <= 0.0
        if not holding:
            torque = torque_commanded
            if math.isfinite(position):
                target = position
            elif math.isfinite(closure):
                target = spool_angle(closure, self._spool_radius, self.config)
        elif not was_holding and not gripping:
            target, torque = angle, math.nan
        if math.isfinite(torque):
            target = angle
        for index, value in (
            (self._target, target),
            (self._torque, torque),
            (self._holding, float(holding)),
        ):
            discrete_state.set_value(index, [value])
