"""Kinematics for planning: an arm with a gripper in a plant."""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Concatenate, ParamSpec, Protocol, TypeVar

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    Frame,
    JacobianWrtVariable,
    Joint,
    ModelInstanceIndex,
    RevoluteJoint,
)
from pydrake.systems.framework import Context

from drake_srg.common.geometry import cross
from drake_srg.common.systems import joint_unit, moving_joints
from drake_srg.types import Vector


@dc.dataclass(frozen=True)
class ArmChain:
    """The serial joints of an arm, placed with all angles at 0.

    Attributes:
        axes: Directions of their axes in W, shape (N, 3).
        points: A point of each axis in W, and the hand's origin, shape (N + 1, 3) [m].
        turns: Whether each joint is revolute, shape (N,); the others are prismatic.
        reach: Largest distance of a point of a link from the line between the points at
            its ends, and of a point of the hand from the hand's origin [m].
    """

    axes: Vector
    points: Vector
    turns: Vector
    reach: float

    @classmethod
    def of_joints(
        cls, joints: Sequence[Joint], hand: Frame, context: Context, reach: float
    ) -> ArmChain:
        """Return the chain of a plant's joints.

        Args:
            joints: Joints of one degree of freedom each, from the base to the hand.
            hand: The hand's frame.
            context: The plant's, with all angles of the arm at 0.
            reach: See the attribute.
        """
        poses = [joint.frame_on_parent().CalcPoseInWorld(context) for joint in joints]
        turns = [isinstance(joint, RevoluteJoint) for joint in joints]
        axes = [
            X_WF.rotation()
            @ (joint.revolute_axis() if turn else joint.translation_axis())
            for X_WF, joint, turn in zip(poses, joints, turns, strict=True)
        ]
        poses.append(hand.CalcPoseInWorld(context))
        points = [X_WF.translation() for X_WF in poses]
        return cls(np.array(axes), np.array(points), np.array(turns, float), reach)

    def speeds(self, path: Vector) -> Vector:
        """Return bounds on all points' speeds at both ends of a path's lines.

        Args:
            path: Postures, shape (K, N) [rad or m].

        Returns:
            Speeds at the beginning and at the end of each line, if the line takes one
            unit of time, shape (2, K - 1) [m per unit of time].
        """
        axes, points = self._placed(path)
        v = np.diff(path, axis=0).T[..., None]
        turns = self.turns[:, None, None]
        ends = []
        for at in (np.s_[:, :-1], np.s_[:, 1:]):
            # For each link: its angular velocity, and the velocities of
            # the points at its ends.
            w = np.cumsum(turns * v * axes[at], axis=0)
            slide = np.cumsum((1.0 - turns) * v * axes[at], axis=0)
            along = cross(w, np.diff(points[at], axis=0))
            last = np.cumsum(along, axis=0) + slide
            speed = np.linalg.norm([last - along, last], axis=-1).max(axis=0)
            ends.append((speed + self.reach * np.linalg.norm(w, axis=-1)).max(axis=0))
        return np.array(ends)

    def _placed(self, q: Vector) -> tuple[Vector, Vector]:
        """Return axes (N, K, 3) and points (N + 1, K, 3) at postures (K, N), in W."""
        R, t = np.eye(3), np.zeros((len(q), 3))  # of all that the joints so far move
        axes, points = [], []
        for axis, point, turns, value in zip(
            self.axes, self.points[:-1], self.turns, q.T, strict=True
        ):
            axes.append(np.broadcast_to(R @ axis, t.shape))
            points.append(R @ point + t)
            if turns:
                turned = R @ _rotations(axis, value)
                t = points[-1] - turned @ point
                R = turned
            else:
                t = t + value[:, None] * axes[-1]
        points.append(R @ self.points[-1] + t)
        return np.array(axes), np.array(points)


def _rotations(axis: Vector, angle: Vector) -> Vector:
    """Return the rotations about an axis by angles (K,), shape (K, 3, 3)."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = (f(angle)[:, None, None] for f in (np.sin, np.cos))
    return np.asarray(np.eye(3) + s * K + (1.0 - c) * (K @ K))


# Largest distance of fingers and held objects from the hand's origin, and of links from
# the line between their joints [m]. It only affects the step between checked
# configurations, never a distance.
_REACH = 0.2
_TWO_TURNS = 2.0 * np.pi  # limit to either side of an unlimited joint [rad]
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
        joint_units: Units of their positions, rad or m.
        finger_names: Names of the gripper's joints.
        arm_indices: Indices of the arm's joints in the plant's positions, (N,).
        lower: Lower limits of the arm's joints, (N,) [rad]; -2 pi without a limit.
        upper: Upper limits of the arm's joints, (N,) [rad]; 2 pi without a limit.
        p_WA: The arm's first joint in world, shape (3,) [m].
        levers: Bounds on the motion by each joint, (N,) [m/rad]: no point of arm, hand
            or held object moves farther than levers @ abs(dq). See `travel`.
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
        joints = moving_joints(plant, arm)
        self.joint_names = [joint.name() for joint in joints]
        self.joint_units = [joint_unit(joint) for joint in joints]
        self.finger_names = [joint.name() for joint in moving_joints(plant, gripper)]
        self.arm_indices = np.array([joint.position_start() for joint in joints])
        # Random postures need limits, so an unlimited joint gets two turns.
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
        """Set the gripper's joints by name [rad]; omitted ones go to 0.

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
        """Return bounds on the motion of every point along each line of a path.

        If joints turn against each other, this is far less than the sum of their own
        motions. A point's speed at either end of a line changes on the way by at most
        its acceleration, which is below sum(abs(dq)) times levers @ abs(dq). Lines of
        less than 0.2 rad in sum are bounded closely.

        Args:
            path: Configurations on straight lines, shape (K, N) [rad].

        Returns:
            Shape (K - 1,) [m]. No point of the arm, the hand, or a held object within
            0.2 m moves farther than this. On any share of a line, no point moves
            farther than that share.
        """
        turns = np.abs(np.diff(path, axis=0))
        change = 0.5 * turns.sum(axis=1) * (turns @ self.levers)
        return np.asarray(self._chain.speeds(path).max(axis=0) + change)

    def jacobian(
        self, q: Vector, p_GT: Vector | tuple[float, ...] = (0.0, 0.0, 0.0)
    ) -> Vector:
        """Return the matrix from joint velocities to [v; w] in W, shape (6, N).

        Args:
            q: Posture of the arm.
            p_GT: The point of the hand whose velocity v is, shape (3,) [m].
        """
        self.plant.SetPositions(self.context, self.positions(q))
        world = self.plant.world_frame()
        J_W: Vector = self.plant.CalcJacobianSpatialVelocity(
            self.context,
            JacobianWrtVariable.kQDot,
            self.hand_frame,
            p_GT,
            world,
            world,
        )[:, self.arm_indices]
        # Drake's spatial velocities begin with the angular one.
        return np.vstack([J_W[3:], J_W[:3]])

    def X_WG(self, q: Vector) -> RigidTransform:
        """Return the hand's pose in the world [m] with the arm at `q`."""
        self.plant.SetPositions(self.context, self.positions(q))
        return self.hand_frame.CalcPoseInWorld(self.context)


class _WithScene(Protocol):
    @property
    def scene(self) -> ArmModel:
        """The model to plan with."""


_P = ParamSpec("_P")
_T = TypeVar("_T")
_S = TypeVar("_S", bound=_WithScene)


def restores_fingers(
    method: Callable[Concatenate[_S, _P], _T],
) -> Callable[Concatenate[_S, _P], _T]:
    """Make a method restore the fingers of its object's `scene`.

    A planner thus never changes itself: its whole memory is in the Context.
    """

    @functools.wraps(method)
    def restoring(self: _S, /, *args: _P.args, **options: _P.kwargs) -> _T:
        before = self.scene.fingers
        try:
            return method(self, *args, **options)
        finally:
            self.scene.fingers = before

    return restoring
