"""Kinematics of the hand that a servo moves."""

from __future__ import annotations

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

from drake_srg.types import Vector


class ServoArm:
    """An arm's limits, and the pose and Jacobian of its hand.

    Args:
        plant: A finalized plant with the arm and its hand.
        arm: Name of the arm's model instance.
        hand: Name of the hand's body G, in the model instance `gripper`.
        speed: Share of the joints' velocity limits that may be used.

    Attributes:
        n: N, the number of the arm's joints.
        speed: Largest joint speeds, shape (N,) [rad/s].
        lower: Lower limits of the joints, shape (N,) [rad].
        upper: Upper limits of the joints, shape (N,) [rad].
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        *,
        arm: str = "arm",
        hand: str = "palm",
        speed: float = 0.9,
    ) -> None:
        self._plant = plant
        self._context = plant.CreateDefaultContext()  # scratch, not state
        self._arm = plant.GetModelInstanceByName(arm)
        gripper = plant.GetModelInstanceByName("gripper")
        self._hand = plant.GetFrameByName(hand, gripper)
        self.n = plant.num_positions(self._arm)

        def of_arm(values: Vector) -> Vector:
            return plant.GetVelocitiesFromArray(self._arm, values)

        self.speed = speed * of_arm(plant.GetVelocityUpperLimits())
        self.lower = plant.GetPositionsFromArray(
            self._arm, plant.GetPositionLowerLimits()
        )
        self.upper = plant.GetPositionsFromArray(
            self._arm, plant.GetPositionUpperLimits()
        )
        self._columns = of_arm(np.arange(plant.num_velocities())).astype(int)

    def X_WG(self, q: Vector) -> RigidTransform:
        """Return the hand's pose [m] with the arm at `q` (N,) [rad]."""
        self._plant.SetPositions(self._context, self._arm, q)
        return self._hand.CalcPoseInWorld(self._context)

    def jacobian(self, q: Vector) -> Vector:
        """Return the matrix from joint velocities to the hand's [v; w], (6, N)."""
        self._plant.SetPositions(self._context, self._arm, q)
        world = self._plant.world_frame()
        matrix = self._plant.CalcJacobianSpatialVelocity(
            self._context,
            JacobianWrtVariable.kV,
            self._hand,
            np.zeros(3),
            world,
            world,
        )
        # Drake's spatial velocities begin with the angular one.
        return np.vstack([matrix[3:], matrix[:3]])[:, self._columns]
