"""Targets of the hand, for inverse kinematics and straight paths."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.types import Vector


@dc.dataclass(frozen=True)
class AxisTarget:
    """An axis of the hand that must point along a direction of the world."""

    axis_G: Vector  # shape (3,), in the hand
    direction_W: Vector  # shape (3,), in the world
    angle: float  # largest angle between the two [rad]


@dc.dataclass(frozen=True)
class HandTarget:
    """A target of the hand: a point, and a full orientation, axes, or neither."""

    p_WT: Vector  # target of the hand's point T [m], shape (3,)
    R_WG: RotationMatrix | None = None
    axes: tuple[AxisTarget, ...] = ()
    p_GT: Vector = dc.field(default_factory=lambda: np.zeros(3))  # T in the hand [m]
    position_tolerance: float = 1e-4  # half the side of a box around p_WT [m]
    angle_tolerance: float = 2e-3  # of R_WG [rad]

    @staticmethod
    def from_pose(X_WG: RigidTransform) -> HandTarget:
        """Return the target of the whole pose `X_WG` [m]."""
        return HandTarget(X_WG.translation(), X_WG.rotation())

    def shifted(self, p_W: Vector) -> HandTarget:
        """Return the same target, moved by `p_W` (3,) [m]."""
        return dc.replace(self, p_WT=self.p_WT + p_W)

    def distance(self, X_WG: RigidTransform) -> float:
        """Return the distance of the hand's point T from its target [m]."""
        return float(np.linalg.norm(X_WG @ self.p_GT - self.p_WT))

    def angle_violation(self, X_WG: RigidTransform) -> float:
        """Return by how much the hand exceeds the angular tolerances [rad], or 0."""
        beyond = [0.0]
        if self.R_WG is not None:
            R_error = self.R_WG.inverse() @ X_WG.rotation()
            beyond.append(R_error.ToAngleAxis().angle() - self.angle_tolerance)
        for axis in self.axes:
            axis_W = X_WG.rotation() @ axis.axis_G
            sine = np.linalg.norm(np.cross(axis_W, axis.direction_W))
            angle = np.arctan2(sine, axis_W @ axis.direction_W)
            beyond.append(float(angle) - axis.angle)
        return max(beyond)
