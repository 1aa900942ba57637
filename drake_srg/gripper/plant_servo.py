"""Algorithm 1 for joints that the plant itself controls."""

from typing import Any

import numpy as np

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
        super().__init__(config, further={"force_limit": 1})
        self._kp = kp
        self._default_limit = force_limit

    def update(self, time: float, state: Vector, *inputs: Any) -> list[float]:
        """See `Stage`."""
        *others, force_limit = inputs
        new = super().update(time, state, *others)
        kappa = self._default_limit
        if force_limit is not None and np.isfinite(force_limit[0]):
            kappa = min(max(float(force_limit[0]), 0.0), 1.0)
        if kappa == 1.0:
            return new  # the plant limits the torque
        state_measured = others[1]
        q, ahead = state_measured[:4], kappa / self._kp
        return [*new[:4], *np.clip(new[4:8], q - ahead, q + ahead), *new[8:]]
