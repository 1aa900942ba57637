"""Hands and grasps as planning sees them."""

from __future__ import annotations

import abc
import dataclasses as dc
from collections.abc import Mapping

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.planning.grasps.fingers import Fingers
from drake_srg.planning.motion.hand_target import AxisTarget, HandTarget
from drake_srg.types import Shape, Vector


@dc.dataclass(frozen=True, kw_only=True)
class Grasp(abc.ABC):
    """One way to take an object. The rotation about the object's axis is free."""

    name: str  # a few words, for messages
    p_GO: Vector  # the object's centre in the hand, shape (3,) [m]
    axis_G: Vector  # the object's axis in the hand, shape (3,)
    closure_open: float  # the object passes between the fingers
    closure_closed: float  # the fingers press on the object
    fingers_open: Mapping[str, float]  # joint angles of the gripper by name [rad]
    fingers_closed: Mapping[str, float]  # the same, as expected when holding [rad]
    # Angle between the object's axis and the nearest axis of the palm [rad].
    lean: float = 0.0
    # How the object moves, in the palm's axes, when it is set down and let go, shape
    # (3,) [m].
    release_shift_G: Vector = dc.field(default_factory=lambda: np.zeros(3))

    @property
    def X_GO(self) -> RigidTransform:
        """Pose of the object in the hand [m]; its turn about its axis is arbitrary."""
        return pose_along(self.p_GO, self.axis_G)

    def target(
        self, X_WO: RigidTransform, angle_tolerance: float = 0.002
    ) -> HandTarget:
        """Return where the hand must be to hold the object at `X_WO`.

        Args:
            X_WO: The object's pose in world [m]. Its turn about its z does not count.
            angle_tolerance: Of the object's axis in the hand [rad].
        """
        # A copy: col() would be a view into a pose that may not live on.
        axis_W = X_WO.rotation().matrix()[:, 2]
        axis = AxisTarget(self.axis_G, axis_W, angle_tolerance)
        return HandTarget(p_WT=X_WO.translation(), p_GT=self.p_GO, axes=(axis,))

    def pick_target(self, X_WO: RigidTransform) -> HandTarget:
        """Return where the hand must be to take the object at `X_WO`.

        Unlike `target`, it may allow a hand that turns the object as it closes.
        """
        return self.target(X_WO)

    @abc.abstractmethod
    def holds(self, q: Vector, proximity: Vector) -> bool:
        """Return whether closed fingers that fire hold an object of the right size.

        Args:
            q: Measured angles of the gripper's joints, shape (n,) [rad].
            proximity: Readings of its sensors, shape (m,) [m].
        """


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
        self, shape: Shape, axis_W: Vector, firmness: float = 1.0
    ) -> list[Grasp]:
        """Return the ways to take an object; empty if it does not fit the hand.

        Args:
            shape: The object's.
            axis_W: Its z axis in world, shape (3,).
            firmness: How much more firmly than usual the hand closes, if it can.
        """


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
