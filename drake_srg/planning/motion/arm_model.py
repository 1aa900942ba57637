"""Kinematics for planning: an arm with a gripper in a plant."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, Joint, ModelInstanceIndex

from drake_srg.planning.motion.arm_chain import ArmChain
from drake_srg.types import Vector

# How far fingers and held objects may reach from the hand's origin, and links from the
# line between their joints [m]. It only affects the step between checked
# configurations, never a distance.
_REACH = 0.2
_TWO_TURNS = 2.0 * np.pi  # either way, for a joint without limits [rad]
_POSE_FREEDOMS = 6  # of a rigid body in space


class ArmModel:
    """An arm and its gripper in a finalized plant, with a context of their own.

    Throughout, `q` is shape (N,) [rad]: the arm's one-degree-of-freedom joints in
    the order of the plant's positions. The fingers stay at `fingers`, every other
    joint of the plant at its default. Frame G is that of the hand, W the world.

    Attributes:
        plant: The plant.
        context: The plant's context; X_WG() moves it.
        hand_frame: G.
        joint_names: Names of the arm's N joints.
        finger_names: Names of the gripper's joints.
        arm_indices: Indices of the arm's joints in the plant's positions, (N,).
        lower: Lower limits of the arm's joints, (N,) [rad]; -2 pi without a limit.
        upper: Upper limits of the arm's joints, (N,) [rad]; 2 pi without a limit.
        p_WA: The arm's first joint in world, shape (3,) [m].
        levers: Bounds on how far each joint moves anything, (N,) [m/rad]: no point of
            arm, hand or held object moves further than levers @ abs(dq). See `travel`.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        arm: ModelInstanceIndex,
        gripper: ModelInstanceIndex,
        hand_frame: Frame,
    ) -> None:
        self.plant = plant
        self.context = plant.CreateDefaultContext()
        self.hand_frame = hand_frame
        self._gripper_model = gripper
        self._positions = plant.GetPositions(self.context)
        joints = _moving_joints(plant, arm)
        self.joint_names = [joint.name() for joint in joints]
        self.finger_names = [joint.name() for joint in _moving_joints(plant, gripper)]
        self.arm_indices = np.array([joint.position_start() for joint in joints])
        # Random postures need limits, so a joint without any gets two turns.
        lower = plant.GetPositionLowerLimits()[self.arm_indices]
        upper = plant.GetPositionUpperLimits()[self.arm_indices]
        self.lower: Vector = np.maximum(lower, -_TWO_TURNS)
        self.upper: Vector = np.minimum(upper, _TWO_TURNS)
        self.plant.SetPositions(
            self.context, self.positions(np.zeros(len(self.arm_indices)))
        )
        self._chain = ArmChain.of_joints(joints, hand_frame, self.context, _REACH)
        self.p_WA: Vector = self._chain.points[0]
        # A joint's lever is the stretched chain from the joint to the fingertips.
        lengths = np.linalg.norm(np.diff(self._chain.points, axis=0), axis=1)
        self.levers: Vector = np.cumsum(lengths[::-1])[::-1] + _REACH

    @property
    def num_joints(self) -> int:
        """N, the number of arm joints."""
        return len(self.arm_indices)

    @property
    def reaches_any_pose(self) -> bool:
        """Whether the arm has enough joints to keep a whole pose along a line."""
        return self.num_joints >= _POSE_FREEDOMS

    @property
    def fingers(self) -> Vector:
        """Angles of the gripper's joints [rad], in the order of `finger_names`."""
        return self.plant.GetPositionsFromArray(self._gripper_model, self._positions)

    @fingers.setter
    def fingers(self, value: Vector) -> None:
        self.plant.SetPositionsInArray(self._gripper_model, value, self._positions)

    def SetFingers(self, angles: Mapping[str, float]) -> None:
        """Set the gripper's joints by name [rad]; those left out go to 0.

        Raises:
            ValueError: If a name is not one of `finger_names`.
        """
        if unknown := set(angles) - set(self.finger_names):
            raise ValueError(
                f"the gripper has no joints {sorted(unknown)} "
                f"(allowed: {', '.join(self.finger_names)})"
            )
        self.fingers = np.array([angles.get(n, 0.0) for n in self.finger_names])

    def positions(self, q: Vector) -> Vector:
        """Return all positions of the plant, (num_positions,), with the arm at `q`."""
        positions = self._positions.copy()
        positions[self.arm_indices] = q
        return positions

    def travel(self, path: Vector) -> Vector:
        """Return bounds on how far anything moves on each line of a path.

        Where joints turn against each other, this is far less than what each of them
        could move alone. A point's speed at either end of a line changes on the way by
        at most its acceleration, which is below sum(abs(dq)) times levers @ abs(dq).
        Lines of less than 0.2 rad in sum are bounded closely.

        Args:
            path: Configurations on straight lines, shape (K, N) [rad].

        Returns:
            Shape (K - 1,) [m]. On any share of a line, no point of the arm, of the hand
            and of what it holds within 0.2 m moves further than that share of this.
        """
        turns = np.abs(np.diff(path, axis=0))
        change = 0.5 * turns.sum(axis=1) * (turns @ self.levers)
        return np.asarray(self._chain.speeds(path).max(axis=0) + change)

    def X_WG(self, q: Vector) -> RigidTransform:
        """Return the hand's pose in the world [m] with the arm at `q`."""
        self.plant.SetPositions(self.context, self.positions(q))
        return self.hand_frame.CalcPoseInWorld(self.context)


def _moving_joints(plant: MultibodyPlant, model: ModelInstanceIndex) -> list[Joint]:
    joints = map(plant.get_joint, plant.GetJointIndices(model))
    moving = (joint for joint in joints if joint.num_positions() == 1)
    return sorted(moving, key=lambda joint: joint.position_start())
