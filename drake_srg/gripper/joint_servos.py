"""Servos at a gripper's joints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import MatrixGain

from drake_srg.common.actuators import joint_to_actuator, model_actuators
from drake_srg.gripper.driver import GripperControl
from drake_srg.gripper.plant_joint_servos import PlantJointServos
from drake_srg.gripper.servo import (
    LAWS,
    PLANT_LAW,
    GripperServo_,
    GripperServoConfig,
)
from drake_srg.types import Vector


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
    """Add one servo per joint to a driver: PWM times the effort limit is the torque.

    With the law `plant`, call `SetPlantServos` before the plant is finalized.

    Args:
        inner: The driver under construction.
        plant: With the gripper.
        gripper: Its model instance.
        names: Of the joints, in the order of `state_measured` and `reference`.
        config: Gains.
        strength: Torque at full PWM, as a fraction of the effort limit.
        state_measured: Of the joints, [q; v].
        reference: For the joints, [q; v; a].
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
        # `SetPlantServos` has given the limits their strength already.
        return _AddPlantServos(
            inner, config, np.diag(limits) @ order, order, state_measured, reference
        )
    motors = inner.AddNamedSystem(
        "motors", MatrixGain(strength * np.diag(limits) @ order)
    )
    servo = inner.AddNamedSystem("servo", GripperServo_[float](config))
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
    """Add what commands the plant's PD actuators; see `AddJointServos`.

    `torques` makes torques of the actuators of the joints' PWM, and `order` puts joints
    into the actuators' order.
    """
    servo = inner.AddNamedSystem("servo", PlantJointServos(config))
    inner.Connect(reference, servo.GetInputPort("reference"))
    inner.Connect(state_measured, servo.GetInputPort("state_measured"))
    outputs = {"pwm": servo.GetOutputPort("pwm")}
    # Speeds count as torques; see drake_srg/common/velocity_feedforward.py.
    state = np.vstack([order, np.zeros_like(order)])
    for name, source, gain in (
        ("desired_state", "position", state),
        ("actuation", "feedforward", torques),
    ):
        system = inner.AddNamedSystem(name, MatrixGain(gain))
        inner.Connect(servo.GetOutputPort(source), system.get_input_port())
        outputs[name] = system.get_output_port()
    return GripperControl({"force_limit": servo.GetInputPort("force_limit")}, outputs)
