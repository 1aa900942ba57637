"""The target of the spool, from closure or from commands to the motor itself."""

import dataclasses as dc
import math

import numpy as np

from drake_srg.common.srg_geometry import SRG
from drake_srg.common.stages import StageOutput, StageSystem
from drake_srg.gripper.moment_arms import empty_hand
from drake_srg.types import Vector, positive


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


class SpoolCommand(StageSystem):
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
        self.declare_stage(
            inputs={"closure_commanded": 1, "motor_state": 2, "triggered": 4},
            optional={
                "hold": 1,
                "motor_position_commanded": 1,
                "motor_torque_commanded": 1,
            },
            outputs={
                "angle_desired": StageOutput(1, lambda time, state: state[:1]),
                "torque_desired": StageOutput(1, lambda time, state: state[2:]),
            },
            # Target [rad], holding, torque.
            state=[0.0, 0.0, np.nan],
            period=self.config.period,
        )

    def update(
        self,
        time: float,
        state: Vector,
        closure_commanded: Vector,
        motor_state: Vector,
        triggered: Vector,
        hold: Vector | None,
        motor_position_commanded: Vector | None,
        motor_torque_commanded: Vector | None,
    ) -> list[float]:
        """See `Stage`."""
        target, was_holding, torque = state.tolist()
        holding = hold is not None and hold[0] != 0.0
        closure, angle = float(closure_commanded[0]), float(motor_state[0])
        position, torque_commanded = (
            math.nan if command is None else float(command[0])
            for command in (motor_position_commanded, motor_torque_commanded)
        )
        gripping = triggered.any() and not torque <= 0.0
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
        return [target, float(holding), torque]
