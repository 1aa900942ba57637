"""Servos at a gripper's joints, and the order of its actuators."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JointActuator, ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import MatrixGain

from drake_srg.gripper.driver import GripperControl
from drake_srg.gripper.servo import LAWS, GripperServo_, GripperServoConfig
from drake_srg.types import Vector


def gripper_actuators(
    plant: MultibodyPlant, gripper: ModelInstanceIndex
) -> list[JointActuator]:
    """Return the gripper's actuators in the plant's order."""
    actuators = [plant.get_joint_actuator(a) for a in plant.GetJointActuatorIndices()]
    return [a for a in actuators if a.model_instance() == gripper]


def joint_to_actuator(
    plant: MultibodyPlant, gripper: ModelInstanceIndex, names: Sequence[str]
) -> Vector:
    """Return the matrix that puts torques of n joints into the actuators' order.

    Args:
        plant: With the gripper.
        gripper: Its model instance.
        names: Of the joints, in the order of the torques.
    """
    joints = [a.joint().name() for a in gripper_actuators(plant, gripper)]
    return np.array([[float(name == joint) for name in names] for joint in joints])


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
        The input `force_limit` and the outputs `pwm` and `actuation`.

    Raises:
        ValueError: If the law `literal` lacks its targets.
    """
    limits = [actuator.effort_limit() for actuator in gripper_actuators(plant, gripper)]
    order = joint_to_actuator(plant, gripper, names)
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
