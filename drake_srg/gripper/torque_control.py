"""The servo's own control of its motor's torque, by its estimate of the current."""

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues

from drake_srg.gripper.tendon import TendonDriveConfig
from drake_srg.lifetime import LeafSystem


class TorqueControl(LeafSystem):
    """Finds the PWM that gives a torque, by integration, as the servo's firmware does.

    .. pydrake_system::

        name: TorqueControl
        input_ports:
        - torque_desired
        output_ports:
        - pwm_desired

    `torque_desired` (1) is a fraction of the torque at rest of a full PWM without dead
    band; NaN while the motor goes by its position. `pwm_desired` (1) is the fraction of
    full PWM that gives this torque, updated every `period`, or NaN. With
    `drive.torque_rise` = 0 it does so at once. Otherwise it starts from 0 and rises:

        pwm' = (torque_desired - useful(pwm)) / torque_rise

    Args:
        drive: The motor.
        period: Of the updates [s].
    """

    def __init__(self, drive: TendonDriveConfig, period: float) -> None:
        super().__init__()
        self._drive, self._period = drive, period
        self._torque = self.DeclareVectorInputPort(name="torque_desired", size=1)
        pwm = self.DeclareDiscreteState([np.nan])
        self.DeclareStateOutputPort("pwm_desired", pwm)
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._update
        )

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        drive, torque = self._drive, self._torque.Eval(context)[0]
        before = context.get_discrete_state(0).value()[0]
        if not np.isfinite(torque):
            pwm = np.nan
        elif drive.torque_rise == 0.0:
            size = drive.pwm_of(abs(torque)) if torque else 0.0
            pwm = np.copysign(size, torque)
        else:
            pwm = before if np.isfinite(before) else 0.0
            error = torque - drive.useful_pwm(pwm)
            # With a shorter rise, an update would overshoot, and then never settle.
            rise = max(drive.torque_rise, self._period / (1.0 - drive.dead_band))
            pwm += self._period * error / rise
        discrete_state.set_value([np.clip(pwm, -1.0, 1.0)])
