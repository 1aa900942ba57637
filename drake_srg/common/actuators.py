"""The actuators of a model, and the order of their torques."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JointActuator, ModelInstanceIndex

from drake_srg.types import Vector


def model_actuators(
    plant: MultibodyPlant, model: ModelInstanceIndex
) -> list[JointActuator]:
    """Return the actuators of a model instance in the plant's order."""
    actuators = [plant.get_joint_actuator(a) for a in plant.GetJointActuatorIndices()]
    return [a for a in actuators if a.model_instance() == model]


def joint_to_actuator(
    plant: MultibodyPlant, model: ModelInstanceIndex, names: Sequence[str]
) -> Vector:
    """Return the matrix that puts torques of n joints into the actuators' order.

    Args:
        plant: With the model.
        model: Its model instance.
        names: Of the joints, in the order of the torques.
    """
    joints = [a.joint().name() for a in model_actuators(plant, model)]
    return np.array([[float(name == joint) for name in names] for joint in joints])
