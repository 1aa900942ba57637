"""What planning knows of a hand: the ways it can take an object, and when it has it."""

from __future__ import annotations

import abc
import dataclasses as dc
from collections.abc import Mapping

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.planning.motion.hand_target import AxisTarget, HandTarget
from drake_srg.types import Shape, Vector


@dc.dataclass(frozen=True, kw_only=True)
class Grasp(abc.ABC):
    """One way to take an object; any rotation about the object's axis is free."""

    name: str  # a few words for people
    p_GO: Vector  # the object's centre in the hand, shape (3,) [m]
    axis_G: Vector  # the object's axis in the hand, shape (3,)
    closure_open: float  # lets the object pass between the fingers
    closure_closed: float  # presses on it
    fingers_open: Mapping[str, float]  # angles of the gripper's joints by name [rad]
    fingers_closed: Mapping[str, float]  # the same, expected when holding
    # Angle between the object's axis and the nearest axis of the palm [rad].
    lean: float = 0.0
    # How the object moves in the palm's axes as it is set down and let go, (3,) [m].
    release_shift_G: Vector = dc.field(default_factory=lambda: np.zeros(3))

    @property
    def X_GO(self) -> RigidTransform:
        """Pose of the object in the hand [m], turned about its axis somehow."""
        return pose_along(self.p_GO, self.axis_G)

    def target(
        self, X_WO: RigidTransform, angle_tolerance: float = 0.002
    ) -> HandTarget:
        """Where the hand has to be to hold the object at `X_WO`.

        Args:
            X_WO: The object's pose in world [m]; how it is turned about its z is free.
            angle_tolerance: Of the object's axis in the hand [rad].
        """
        # A copy: col() would be a view into a pose that may not live on.
        axis_W = X_WO.rotation().matrix()[:, 2]
        axis = AxisTarget(self.axis_G, axis_W, angle_tolerance)
        return HandTarget(p_WT=X_WO.translation(), p_GT=self.p_GO, axes=(axis,))

    def pick_target(self, X_WO: RigidTransform) -> HandTarget:
        """Where the hand has to be to take the object at `X_WO`, which it may turn."""
        return self.target(X_WO)

    @abc.abstractmethod
    def holds(self, q: Vector, proximity: Vector) -> bool:
        """Whether closed fingers that sense something have an object of the right size.

        Args:
            q: Measured angles of the gripper's joints, shape (n,) [rad].
            proximity: Readings of its sensors, shape (m,) [m].
        """


class Hand(abc.ABC):
    """A gripper as its planner sees it.

    Attributes:
        num_joints: Length n of the measured joint angles.
        num_sensors: Length m of the proximity readings.
        p_GT: The hand's point that straight lines are for, shape (3,) [m].
        upright_within: Lean up to which an object counts as standing upright [rad].
    """

    num_joints: int
    num_sensors: int
    p_GT: Vector
    upright_within: float

    @abc.abstractmethod
    def grasps(
        self, shape: Shape, axis_W: Vector, firmness: float = 1.0
    ) -> list[Grasp]:
        """Return the ways to take an object; none where it does not fit the hand.

        Args:
            shape: The object's.
            axis_W: Its z axis in world, shape (3,).
            firmness: How much more firmly than usual the hand closes, where it can.
        """


def pose_along(p: Vector, axis: Vector) -> RigidTransform:
    """Return a pose at `p` (3,) [m] whose z points along `axis` (3,).

    Its y is level where it can be: the rotation about the axis has no other meaning.
    """
    z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    x = np.cross([0.0, 1.0, 0.0], z)
    if np.linalg.norm(x) < 1e-6:
        x = np.array([1.0, 0.0, 0.0])
    x = x / np.linalg.norm(x)
    R = RotationMatrix(np.column_stack([x, np.cross(z, x), z]))
    return RigidTransform(R, np.asarray(p, dtype=float))
