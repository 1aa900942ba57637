"""Hands and grasps as planning sees them."""

from __future__ import annotations

import abc
import dataclasses as dc
from collections.abc import Mapping

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.common.convex_pieces import Solid
from drake_srg.planning.grasps.fingers import Fingers
from drake_srg.planning.motion.hand_target import AxisTarget, HandTarget
from drake_srg.types import Vector

# In every grasp, the palm's y is perpendicular to the object's axis.
PALM_Y = np.array([0.0, 1.0, 0.0])
_DOWN = np.array([0.0, 0.0, -1.0])
_EXACT = 0.002  # tolerance of a direction [rad]


@dc.dataclass(frozen=True, kw_only=True)
class Grasp(abc.ABC):
    """One way to take an object, and to set it down with its axis upright.

    The axis is the object's z unless `axis_O` says otherwise.

    The rotation about the object's axis is free when it is set down. When it is taken,
    the rotation is free unless `across_O` or `down_G` says otherwise.
    """

    name: str  # a few words, for messages
    p_GO: Vector  # the object's origin in the hand, shape (3,) [m]
    axis_G: Vector  # the object's axis in the hand, shape (3,)
    axis_O: Vector = dc.field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    closure_open: float  # the object passes between the fingers
    closure_closed: float  # the fingers press on the object
    fingers_open: Mapping[str, float]  # joint angles of the gripper by name [rad]
    fingers_closed: Mapping[str, float]  # the same, as expected when holding [rad]
    # Angle between the object's axis and the nearest axis of the palm [rad].
    lean: float = 0.0
    # Where the palm's y is in the object, perpendicular to its axis, shape (3,): the
    # normal of a box's face. None: the object is round.
    across_O: Vector | None = None
    # What must point down in the palm when the hand takes an object that lies,
    # perpendicular to `axis_G` and the palm's y, shape (3,). None: the object stands.
    down_G: Vector | None = None
    # How far the axis may be turned from `axis_G` when the hand closes [rad].
    pick_angle: float = _EXACT
    # How the object moves, in the palm's axes, when it is set down and let go, shape
    # (3,) [m].
    release_shift_G: Vector = dc.field(default_factory=lambda: np.zeros(3))
    cost: float = 0.0  # added to the score, of which less is better [rad²]

    @property
    def X_GO(self) -> RigidTransform:
        """Pose of the object in the hand [m]; a round one's turn is arbitrary."""
        if self.across_O is None:
            return pose_along(self.p_GO, self.axis_G)
        R_GA = _axes(self.axis_G, PALM_Y)
        R_OA = _axes(self.axis_O, self.across_O)
        return RigidTransform(R_GA @ R_OA.inverse(), self.p_GO)

    def target(
        self, X_WO: RigidTransform, angle_tolerance: float = _EXACT
    ) -> HandTarget:
        """Return where the hand must be to hold the object at `X_WO`.

        Args:
            X_WO: The object's pose in world [m]. Its turn about its axis does not
                count.
            angle_tolerance: Of the object's axis in the hand [rad].
        """
        axis_W = X_WO.rotation().matrix() @ self.axis_O
        axis = AxisTarget(self.axis_G, axis_W, angle_tolerance)
        return HandTarget(p_WT=X_WO.translation(), p_GT=self.p_GO, axes=(axis,))

    def pick_target(self, X_WO: RigidTransform) -> HandTarget:
        """Return where the hand must be to take the object at `X_WO`.

        Unlike `target`, it knows of the object's faces, and may allow a hand that turns
        the object as it closes.
        """
        target = self.target(X_WO, self.pick_angle)
        if self.down_G is not None:
            axis = AxisTarget(self.down_G, _DOWN, _EXACT)
        elif self.across_O is not None:
            axis = AxisTarget(PALM_Y, X_WO.rotation() @ self.across_O, _EXACT)
        else:
            return target
        return dc.replace(target, axes=(*target.axes, axis))

    def set_down(
        self, X_WG: RigidTransform, X_WO_goal: RigidTransform
    ) -> RigidTransform:
        """Return the pose of the object that the hand has set down on its goal [m].

        Args:
            X_WG: Of the hand [m].
            X_WO_goal: The goal [m]. The object is turned about its axis as in the hand.
        """
        if self.across_O is None:
            return X_WO_goal
        R_WO = X_WG.rotation() @ self.X_GO.rotation()
        return RigidTransform(R_WO, X_WO_goal.translation())

    @abc.abstractmethod
    def holds(self, q: Vector, proximity: Vector) -> bool:
        """Return whether closed fingers that fire hold an object of the right size.

        Args:
            q: Measured angles of the gripper's joints, shape (n,) [rad].
            proximity: Readings of its sensors, shape (m,) [m].
        """


@dc.dataclass(frozen=True, kw_only=True)
class PinchGrasp(Grasp):
    """A grasp between the pads of fingers whose angles tell what they hold."""

    fingers: Fingers
    width: float  # between the pads [m]

    def holds(self, q: Vector, proximity: Vector) -> bool:
        """See `Grasp`."""
        return self.fingers.holds(self.width, q, proximity)


class Hand(abc.ABC):
    """A gripper as its planner sees it.

    Attributes:
        num_joints: Number n of measured joint angles.
        num_sensors: Number m of proximity readings.
        p_GT: The point of the hand that moves along straight lines, shape (3,) [m].
        upright_within: Lean up to which an object counts as standing upright [rad].
        pinch: Its fingers in pinches from above; None: no such pinches are planned.
    """

    num_joints: int
    num_sensors: int
    p_GT: Vector
    upright_within: float
    pinch: Fingers | None = None

    @abc.abstractmethod
    def grasps(
        self, shape: Solid, X_WO: RigidTransform, firmness: float = 1.0
    ) -> list[Grasp]:
        """Return the ways to take an object; empty if it does not fit the hand.

        Args:
            shape: The object's.
            X_WO: Its pose [m]; the turn of a round one about its axis does not count.
            firmness: How much more firmly than usual the hand closes, if it can.
        """


def _axes(z: Vector, y: Vector) -> RotationMatrix:
    """Return the rotation of a frame of which z, and about it y, point as given."""
    z = z / np.linalg.norm(z)
    x = np.cross(y, z)
    x = x / np.linalg.norm(x)
    return RotationMatrix(np.column_stack([x, np.cross(z, x), z]))


def pose_along(p: Vector, axis: Vector) -> RigidTransform:
    """Return a pose whose z points along an axis.

    Its y is level if possible; the rotation about the axis has no other meaning.

    Args:
        p: Its position, shape (3,) [m].
        axis: Of any length, shape (3,).
    """
    z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    x = np.cross([0.0, 1.0, 0.0], z)
    if np.linalg.norm(x) < 1e-6:
        x = np.array([1.0, 0.0, 0.0])
    x = x / np.linalg.norm(x)
    R = RotationMatrix(np.column_stack([x, np.cross(z, x), z]))
    return RigidTransform(R, np.asarray(p, dtype=float))
