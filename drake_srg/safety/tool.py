"""The tool's position, and the force on it that external torques tell of."""

from __future__ import annotations

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable

from drake_srg.types import Vector

# Directions in which a force moves the joints by less than this share of the largest
# are not resolved: near a singular posture, noise would count as an enormous force.
_RESOLVED = 0.05


class Tool:
    """A point of the hand, as a function of the arm's joints.

    Args:
        plant: A finalized plant with the arm and the hand.
        arm: Name of the arm's model instance.
        frame: The tool, as MODEL::FRAME; its origin counts.

    Raises:
        ValueError: If there is no such frame.
    """

    def __init__(self, plant: MultibodyPlant, arm: str, frame: str) -> None:
        self._plant = plant
        self._context = plant.CreateDefaultContext()  # scratch, not state
        self._arm = plant.GetModelInstanceByName(arm)
        self._frame = _find(plant, frame)
        joints = plant.GetJointIndices(self._arm)
        moving = (plant.get_joint(i) for i in joints)
        self._columns = sorted(j.velocity_start() for j in moving if j.num_velocities())

    def position(self, q: Vector) -> Vector:
        """Return its position p_WT [m] at joint positions (N,) [rad or m]."""
        self._plant.SetPositions(self._context, self._arm, q)
        X_WT = self._frame.CalcPoseInWorld(self._context)
        p_WT: Vector = X_WT.translation()
        return p_WT

    def force(self, q: Vector, torque: Vector) -> float:
        """Return the size of the force on the point that best explains torques [N].

        It is the least-squares solution of J(q)ᵀ f = torque, for a contact at this
        point alone. A contact nearer to the base presses harder than it says.

        Args:
            q: Joint positions, shape (N,) [rad or m].
            torque: External torques, shape (N,) [N m].
        """
        plant = self._plant
        plant.SetPositions(self._context, self._arm, q)
        world = plant.world_frame()
        J = plant.CalcJacobianTranslationalVelocity(
            self._context,
            JacobianWrtVariable.kV,
            self._frame,
            np.zeros(3),
            world,
            world,
        )[:, self._columns]
        force = np.linalg.lstsq(J.T, torque, rcond=_RESOLVED)[0]
        return float(np.linalg.norm(force))


def _find(plant: MultibodyPlant, name: str) -> Frame:
    model, _, frame = name.partition("::")
    if frame and plant.HasModelInstanceNamed(model):
        instance = plant.GetModelInstanceByName(model)
        if plant.HasFrameNamed(frame, instance):
            return plant.GetFrameByName(frame, instance)
    raise ValueError(
        f"safety.tool: must be a frame of the models, as MODEL::FRAME, got {name!r}"
    )
