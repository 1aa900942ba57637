"""The pinhole model of a calibration, with its derivatives.

Frames: C is the camera's imager and B the board. P is the frame on which the camera is
mounted and Q the one on which the board is: a camera in the hand has P on the hand and
Q = world, a fixed one has P = world and Q on the hand. X_PQ is known in every view.
"""

from __future__ import annotations

import dataclasses as dc

import cv2
import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.types import Vector

NUM_PARAMETERS = 16  # focal, center, X_PC and X_QB


@dc.dataclass(frozen=True)
class View:
    """An image of the board: what is known of it.

    Attributes:
        name: For messages.
        X_PQ: Pose of the board's mount in the camera's mount [m].
        p_B: Corners on the board [m], shape (K, 3).
        pixels: The same corners in the image, shape (K, 2).
    """

    name: str
    X_PQ: RigidTransform
    p_B: Vector
    pixels: Vector


@dc.dataclass(frozen=True)
class Unknowns:
    """What a calibration estimates.

    Attributes:
        focal: Focal lengths [pixels], shape (2,).
        center: Principal point [pixels], shape (2,); whole in the middle of a pixel.
        X_PC: Pose of the camera's imager in its mount [m].
        X_QB: Pose of the board in its mount [m].
    """

    focal: Vector
    center: Vector
    X_PC: RigidTransform
    X_QB: RigidTransform

    def moved(self, step: Vector) -> Unknowns:
        """Return these unknowns after a step of shape (16,), see `jacobian`."""
        return Unknowns(
            self.focal + step[0:2],
            self.center + step[2:4],
            self.X_PC @ _small_pose(step[4:10]),
            self.X_QB @ _small_pose(step[10:16]),
        )


def project(unknowns: Unknowns, view: View) -> Vector:
    """Return the pixels (K, 2) at which the view's corners are expected."""
    p_C = _p_C(unknowns, view)
    z = np.maximum(p_C[:, 2:], 1e-3)  # a corner behind the camera is far off
    return np.asarray(p_C[:, :2] / z * unknowns.focal + unknowns.center)


def residuals(unknowns: Unknowns, view: View) -> Vector:
    """Return expected minus seen pixels (K, 2)."""
    return project(unknowns, view) - view.pixels


def jacobian(unknowns: Unknowns, view: View) -> Vector:
    """Return the derivatives of `project`, shape (K, 2, 16).

    The columns are focal (2), center (2), then rotation vector and translation of a
    small motion of C in C (6) and of B in B (6).
    """
    p_C = _p_C(unknowns, view)
    z = np.maximum(p_C[:, 2], 1e-3)
    xy = p_C[:, :2] / z[:, None]
    # Derivative of the pixel by the point in C.
    by_point = np.zeros((len(p_C), 2, 3))
    for axis in range(2):
        by_point[:, axis, axis] = unknowns.focal[axis] / z
        by_point[:, axis, 2] = -unknowns.focal[axis] * xy[:, axis] / z
    R_CB = (unknowns.X_PC.inverse() @ view.X_PQ @ unknowns.X_QB).rotation().matrix()
    result = np.zeros((len(p_C), 2, NUM_PARAMETERS))
    for axis in range(2):
        result[:, axis, axis] = xy[:, axis]
        result[:, axis, 2 + axis] = 1.0
    result[:, :, 4:7] = by_point @ _cross(p_C)
    result[:, :, 7:10] = -by_point
    result[:, :, 10:13] = -by_point @ (R_CB @ _cross(view.p_B))
    result[:, :, 13:16] = by_point @ R_CB
    return result


def _p_C(unknowns: Unknowns, view: View) -> Vector:
    X_CB = unknowns.X_PC.inverse() @ view.X_PQ @ unknowns.X_QB
    return np.asarray(X_CB.multiply(view.p_B.T).T)


def _cross(p: Vector) -> Vector:
    """Return the matrices (K, 3, 3) of the cross products with points (K, 3)."""
    x, y, z = p.T
    o = np.zeros_like(x)
    return np.array([[o, -z, y], [z, o, -x], [-y, x, o]]).transpose(2, 0, 1)


def _small_pose(step: Vector) -> RigidTransform:
    """Return the pose of a rotation vector and a translation, shape (6,)."""
    turn = cv2.Rodrigues(step[:3])[0]
    return RigidTransform(RotationMatrix.ProjectToRotationMatrix(turn), step[3:])
