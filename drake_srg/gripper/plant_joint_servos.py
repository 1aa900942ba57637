"""Servos at a gripper's joints as PD actuators of the plant."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, PdControllerGains

from drake_srg.common.actuators import model_actuators
from drake_srg.common.stages import StageOutput, StageSystem
from drake_srg.gripper.servo import GripperServoConfig
from drake_srg.types import Vector


def SetPlantServos(
    plant: MultibodyPlant,
    gripper: ModelInstanceIndex,
    names: Sequence[str],
    config: GripperServoConfig,
    strength: float,
) -> None:
    """Give a gripper's actuators the gains and limits of servos.

    Args:
        plant: With the gripper, not yet finalized.
        gripper: Its model instance.
        names: Of the joints, in the order of the gains.
        config: Gains.
        strength: Torque at full PWM, as a fraction of the effort limit.

    Raises:
        ValueError: If the servos integrate, or their PWM has steps.
    """
    if any(config.ki) or config.pwm_steps:
        raise ValueError(
            "gripper.servo: the plant's servos neither integrate nor have steps "
            "(allowed: ki and pwm_steps 0)"
        )
    for actuator in model_actuators(plant, gripper):
        i = names.index(actuator.joint().name())
        limit = strength * actuator.effort_limit()
        gains = PdControllerGains(p=limit * config.kp[i], d=limit * config.kd[i])
        actuator.set_controller_gains(gains)
        actuator.set_effort_limit(limit)


class PlantJointServos(StageSystem):
    """Tells PD actuators of the plant what `GripperServo` would make of a reference.

    .. pydrake_system::

        name: PlantJointServos
        input_ports:
        - reference
        - state_measured
        - force_limit (optional)
        output_ports:
        - position
        - feedforward
        - pwm

    The inputs are those of `GripperServo`. The plant solves its law `pid`, without the
    integral, implicitly and within its effort limits, so the law does not limit the
    plant's step. The reference is sampled every `config.period`. `position` (n) [rad]
    is where the actuators must move, `feedforward` (n) the part of the PWM that does
    not depend on the measurement, and `pwm` (n) their torque now, both fractions of
    full scale.

    The plant's limits are those of the motors. A smaller `force_limit` kappa takes
    `position` within kappa / K_P of the measured angles, as often as it is sampled.

    Args:
        config: Gains.
    """

    def __init__(self, config: GripperServoConfig) -> None:
        super().__init__()
        self.config = config
        self._kp, self._kd = np.array(config.kp), np.array(config.kd)
        self._kff1, self._kff2 = np.array(config.kff1), np.array(config.kff2)
        self._n = n = len(config.kp)
        self.declare_stage(
            inputs={"reference": 3 * n, "state_measured": 2 * n},
            optional={"force_limit": 1},
            outputs={
                "position": StageOutput(n, lambda time, state: state[:n]),
                "feedforward": StageOutput(n, lambda time, state: state[n:]),
                "pwm": StageOutput(n, self._pwm, ("state_measured",)),
            },
            state=np.zeros(2 * n),
            period=config.period,
        )

    def update(
        self,
        time: float,
        state: Vector,
        reference: Vector,
        state_measured: Vector,
        force_limit: Vector | None,
    ) -> Vector:
        """See `Stage`."""
        q, v, a = reference.reshape(3, self._n)
        feedforward = (self._kff1 + self._kd) * v + self._kff2 * a
        kappa = self.config.force_limit
        if force_limit is not None and np.isfinite(force_limit[0]):
            kappa = min(max(float(force_limit[0]), 0.0), 1.0)
        if kappa < 1.0:
            measured, ahead = state_measured[: self._n], kappa / self._kp
            q = np.clip(q, measured - ahead, measured + ahead)
            feedforward = np.clip(feedforward, -kappa, kappa)
        return np.concatenate([q, feedforward])

    def _pwm(self, time: float, state: Vector, state_measured: Vector) -> Vector:
        n = self._n
        error = state[:n] - state_measured[:n]
        pwm = self._kp * error - self._kd * state_measured[n:] + state[n:]
        return np.clip(pwm, -1.0, 1.0)
