"""A first estimate of both poses, from the board's pose in each image."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.calibration.projection import Unknowns, View
from drake_srg.types import Vector


def first_estimate(views: Sequence[View], focal: Vector, center: Vector) -> Unknowns:
    """Return unknowns from which a least-squares fit converges.

    In each view X_PC X_CB = X_PQ X_QB. The rotations are the null vector of these
    equations, written out for the 18 entries of R_PC and R_QB. The translations follow
    by linear least squares.

    Args:
        views: At least three, with hands turned about at least two axes.
        focal: Approximate focal lengths [pixels], shape (2,).
        center: Approximate principal point [pixels], shape (2,).
    """
    seen = [_board_pose(view, focal, center) for view in views]
    known = [view.X_PQ for view in views]
    turns, one = [], np.eye(3)
    for X_CB, X_PQ in zip(seen, known, strict=True):
        left = np.kron(X_CB.rotation().matrix().T, one)
        right = np.kron(one, X_PQ.rotation().matrix())
        turns.append(np.hstack([left, -right]))
    null = np.linalg.svd(np.vstack(turns))[2][-1]
    R_PC, R_QB = null[:9].reshape(3, 3).T, null[9:].reshape(3, 3).T
    sign = np.sign(np.linalg.det(R_PC)) or 1.0
    R_PC, R_QB = _nearest_rotation(sign * R_PC), _nearest_rotation(sign * R_QB)
    rows, values = [], []
    for X_CB, X_PQ in zip(seen, known, strict=True):
        rows.append(np.hstack([one, -X_PQ.rotation().matrix()]))
        values.append(X_PQ.translation() - R_PC @ X_CB.translation())
    p = np.linalg.lstsq(np.vstack(rows), np.concatenate(values), rcond=None)[0]
    return Unknowns(
        np.array(focal, float),
        np.array(center, float),
        RigidTransform(R_PC, p[:3]),
        RigidTransform(R_QB, p[3:]),
    )


def _board_pose(view: View, focal: Vector, center: Vector) -> RigidTransform:
    """Return X_CB of one view."""
    matrix = np.array([[focal[0], 0, center[0]], [0, focal[1], center[1]], [0, 0, 1.0]])
    _, turn, p = cv2.solvePnP(
        view.p_B, view.pixels, matrix, None, flags=cv2.SOLVEPNP_IPPE
    )
    R = RotationMatrix.ProjectToRotationMatrix(cv2.Rodrigues(turn)[0])
    return RigidTransform(R, p.ravel())


def _nearest_rotation(matrix: Vector) -> RotationMatrix:
    """Return the rotation nearest to a matrix, scaled by any factor."""
    u, _, v = np.linalg.svd(matrix)
    u[:, 2] *= np.linalg.det(u @ v)
    return RotationMatrix.ProjectToRotationMatrix(u @ v)
