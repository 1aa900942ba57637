"""What every gripper driver does with the plant that it drives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JointActuator, ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.primitives import MatrixGain

from drake_srg.gripper.servo import GripperServo, GripperServoConfig
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
) -> None:
    """Add a servo a joint to a driver: its PWM times the effort limit is the torque.

    Exports the input `force_limit` and the outputs `pwm` and `actuation`.

    Args:
        inner: The driver under construction.
        plant: With the gripper.
        gripper: Its model instance.
        names: Of the joints, in the order of `state_measured` and `reference`.
        config: Gains.
        strength: Torque at full PWM, over the effort limit.
        state_measured: Of the joints, [q; v].
        reference: What they shall follow, [q; v; a].
    """
    limits = [actuator.effort_limit() for actuator in gripper_actuators(plant, gripper)]
    order = joint_to_actuator(plant, gripper, names)
    motors = inner.AddNamedSystem(
        "motors", MatrixGain(strength * np.diag(limits) @ order)
    )
    servo = inner.AddNamedSystem("servo", GripperServo(config))
    inner.Connect(state_measured, servo.GetInputPort("state_measured"))
    inner.Connect(reference, servo.GetInputPort("reference"))
    inner.Connect(servo.get_output_port(), motors.get_input_port())
    inner.ExportInput(servo.GetInputPort("force_limit"), "force_limit")
    inner.ExportOutput(servo.get_output_port(), "pwm")
    inner.ExportOutput(motors.get_output_port(), "actuation")


def AddDriver(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    gripper: ModelInstanceIndex,
    inner: DiagramBuilder,
) -> Diagram:
    """Build a driver, add it to a diagram and connect it to the plant."""
    driver = builder.AddNamedSystem("gripper_driver", inner.Build())
    for output, name in (
        (plant.get_state_output_port(gripper), "plant_state"),
        (plant.get_contact_results_output_port(), "contact_results"),
        (plant.get_body_poses_output_port(), "body_poses"),
    ):
        builder.Connect(output, driver.GetInputPort(name))
    builder.Connect(
        driver.GetOutputPort("actuation"), plant.get_actuation_input_port(gripper)
    )
    return driver
