"""Servos at a gripper's joints, either sampled systems or PD actuators of the plant."""

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, PdControllerGains
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    OutputPort,
)
from pydrake.systems.primitives import MatrixGain

from drake_srg.common.systems import joint_to_actuator, model_actuators, value_or_none
from drake_srg.config import positive
from drake_srg.gripper.driver import GripperControl, GripperDriver
from drake_srg.gripper.servo import LAWS, PLANT_LAW, GripperServo, GripperServoConfig
from drake_srg.lifetime import LeafSystem
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
        plant: Plant with the gripper, not yet finalized.
        gripper: Its model instance.
        names: Names of the joints, in the order of the gains.
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


@dc.dataclass(kw_only=True)
class JointServoDriver(GripperDriver):
    """Configuration of a driver with a servo at each joint."""

    # Torque at full PWM, as a fraction of the model's effort limit: supply voltages sag
    # and motors differ.
    motor_strength: float = dc.field(default=1.0, metadata=positive())

    def prepare_plant(self, plant: MultibodyPlant, gripper: ModelInstanceIndex) -> None:
        """Prepare the plant for the driver, before the plant is finalized.

        With the law `plant`, this gives the actuators gains and limits.
        """
        if self.servo.law == PLANT_LAW:
            SetPlantServos(
                plant, gripper, self.joint_names, self.servo, self.motor_strength
            )


class PlantJointServos(LeafSystem):
    """Commands PD actuators of the plant so that they act like `GripperServo`.

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

    The inputs are those of `GripperServo`. The plant solves the law `pid` of that
    servo, without the integral, implicitly and within its effort limits. So the law
    does not limit the plant's step. The reference is sampled every `config.period`.
    `position` (n) [rad] is the actuators' target. `feedforward` (n) is the part of the
    PWM that does not depend on the measurement. `pwm` (n) is the actuators' present
    torque. Both are fractions of full scale.

    The plant's effort limits are those of the motors. For a `force_limit` kappa below
    1, each sample limits `position` to within kappa / K_P of the measured angles.
    """

    def __init__(self, config: GripperServoConfig) -> None:
        super().__init__()
        self.config = config
        self._kp, self._kd = np.array(config.kp), np.array(config.kd)
        self._kff1, self._kff2 = np.array(config.kff1), np.array(config.kff2)
        self._n = n = len(config.kp)
        self._reference = self.DeclareVectorInputPort(name="reference", size=3 * n)
        self._measured = self.DeclareVectorInputPort(name="state_measured", size=2 * n)
        self._limit = self.DeclareVectorInputPort(name="force_limit", size=1)
        self._position, self._feedforward = (
            self.DeclareDiscreteState(n) for _ in range(2)
        )
        self.DeclareStateOutputPort("position", self._position)
        self.DeclareStateOutputPort("feedforward", self._feedforward)
        self.DeclareVectorOutputPort(
            name="pwm",
            size=n,
            calc=self._calc_pwm,
            prerequisites_of_calc={self.xd_ticket(), self._measured.ticket()},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=config.period, offset_sec=0.0, update=self._update
        )

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        q, v, a = self._reference.Eval(context).reshape(3, self._n)
        feedforward = (self._kff1 + self._kd) * v + self._kff2 * a
        kappa, force_limit = (
            self.config.force_limit,
            value_or_none(self._limit, context),
        )
        if force_limit is not None and np.isfinite(force_limit[0]):
            kappa = min(max(float(force_limit[0]), 0.0), 1.0)
        if kappa < 1.0:
            measured = self._measured.Eval(context)[: self._n]
            ahead = kappa / self._kp
            q = np.clip(q, measured - ahead, measured + ahead)
            feedforward = np.clip(feedforward, -kappa, kappa)
        discrete_state.set_value(self._position, q)
        discrete_state.set_value(self._feedforward, feedforward)

    def _calc_pwm(self, context: Context, output: BasicVector) -> None:
        position, feedforward = (
            context.get_discrete_state(index).value()
            for index in (self._position, self._feedforward)
        )
        q, v = self._measured.Eval(context).reshape(2, self._n)
        pwm = self._kp * (position - q) - self._kd * v + feedforward
        output.SetFromVector(np.clip(pwm, -1.0, 1.0))


def AddJointServos(
    inner: DiagramBuilder,
    plant: MultibodyPlant,
    gripper: ModelInstanceIndex,
    names: Sequence[str],
    config: GripperServoConfig,
    *,
    strength: float,
    state_measured: OutputPort,
    reference: OutputPort,
    position_desired: OutputPort | None = None,
) -> GripperControl:
    """Add one servo per joint to a driver; torque is PWM times the effort limit.

    With the law `plant`, call `SetPlantServos` before the plant is finalized.

    Args:
        inner: The driver under construction.
        plant: Plant with the gripper.
        gripper: Its model instance.
        names: Names of the joints, in the order of `state_measured` and `reference`.
        config: Gains.
        strength: Torque at full PWM, as a fraction of the effort limit.
        state_measured: Measured state of the joints, [q; v].
        reference: Reference of the joints, [q; v; a].
        position_desired: Targets of the reference, [q], for the law `literal`.

    Returns:
        The input `force_limit` and the outputs `pwm` and `actuation`; with the law
        `plant` also `desired_state`.

    Raises:
        ValueError: If the law `literal` lacks its targets.
    """
    limits = [actuator.effort_limit() for actuator in model_actuators(plant, gripper)]
    order = joint_to_actuator(plant, gripper, names)
    if config.law == PLANT_LAW:
        # `SetPlantServos` has already scaled the limits by `strength`.
        return _AddPlantServos(
            inner, config, np.diag(limits) @ order, order, state_measured, reference
        )
    motors = inner.AddNamedSystem(
        "motors", MatrixGain(strength * np.diag(limits) @ order)
    )
    servo = inner.AddNamedSystem("servo", GripperServo(config))
    if position_desired is not None:
        inner.Connect(position_desired, servo.GetInputPort("position_desired"))
    elif config.law == "literal":
        allowed = ", ".join(law for law in LAWS if law != config.law)
        raise ValueError(
            "gripper.servo.law: 'literal' needs a driver whose reference moves to a "
            f"target (allowed here: {allowed})"
        )
    inner.Connect(state_measured, servo.GetInputPort("state_measured"))
    inner.Connect(reference, servo.GetInputPort("reference"))
    pwm = servo.get_output_port()
    inner.Connect(pwm, motors.get_input_port())
    return GripperControl(
        inputs={"force_limit": servo.GetInputPort("force_limit")},
        outputs={"pwm": pwm, "actuation": motors.get_output_port()},
    )


def _AddPlantServos(
    inner: DiagramBuilder,
    config: GripperServoConfig,
    torques: Vector,
    order: Vector,
    state_measured: OutputPort,
    reference: OutputPort,
) -> GripperControl:
    """Add the systems that command the plant's PD actuators; see `AddJointServos`.

    `torques` maps the joints' PWM to the actuators' torques, and `order` permutes
    joints into the actuators' order.
    """
    servo = inner.AddNamedSystem("servo", PlantJointServos(config))
    inner.Connect(reference, servo.GetInputPort("reference"))
    inner.Connect(state_measured, servo.GetInputPort("state_measured"))
    outputs = {"pwm": servo.GetOutputPort("pwm")}
    # Speeds count as torques; see drake_srg/common/systems.py.
    state = np.vstack([order, np.zeros_like(order)])
    for name, source, gain in (
        ("desired_state", "position", state),
        ("actuation", "feedforward", torques),
    ):
        system = inner.AddNamedSystem(name, MatrixGain(gain))
        inner.Connect(servo.GetOutputPort(source), system.get_input_port())
        outputs[name] = system.get_output_port()
    return GripperControl({"force_limit": servo.GetInputPort("force_limit")}, outputs)
