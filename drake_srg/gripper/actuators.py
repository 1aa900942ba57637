"""A gripper's actuators, and the order of their torques."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JointActuator, ModelInstanceIndex

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
