"""Algorithm 1 for joints that the plant itself controls."""

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues

from drake_srg.common.ports import value_or_none
from drake_srg.gripper.underactuation import UnderactuationConfig, UnderactuationLogic
from drake_srg.types import Vector


class PlantServoLogic(UnderactuationLogic):
    """Algorithm 1, with targets that are as far ahead as the servos may press.

    .. pydrake_system::

        name: PlantServoLogic
        input_ports:
        - closure_commanded
        - state_measured
        - triggered
        - joint_position_commanded (optional)
        - hold (optional)
        - closure_messages (with per_message)
        - force_limit (optional)
        output_ports:
        - position_desired

    A proportional servo that lags its target by K_P e = kappa presses with the fraction
    kappa of its torque. `force_limit` (1) is kappa, 0 .. 1: every `config.period`, the
    targets are brought within kappa / K_P of the measured angles. If it is not
    connected or NaN, it is `force_limit`. The other ports are those of
    `UnderactuationLogic`.

    Args:
        kp: Gains K_P, shape (4,) [1/rad].
        force_limit: kappa without a command.
        config: Parameters of the algorithm.
    """

    def __init__(
        self,
        kp: Vector,
        force_limit: float = 1.0,
        config: UnderactuationConfig | None = None,
    ) -> None:
        super().__init__(config)
        self._kp = kp
        self._default_limit = force_limit
        self._limit = self.DeclareVectorInputPort(name="force_limit", size=1)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        super()._update(context, discrete_state)
        kappa, force_limit = self._default_limit, value_or_none(self._limit, context)
        if force_limit is not None and np.isfinite(force_limit[0]):
            kappa = min(max(float(force_limit[0]), 0.0), 1.0)
        if kappa == 1.0:
            return  # the plant limits the torque
        q, ahead = self._measured.Eval(context)[:4], kappa / self._kp
        desired = discrete_state.value(self._desired)
        desired = np.clip(desired, q - ahead, q + ahead)
        discrete_state.set_value(self._desired, desired)
