"""First guesses of the pose of convex pieces from the points of their surface."""

from __future__ import annotations

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.common.convex_pieces import ConvexPieces
from drake_srg.types import Vector
from drake_srg.vision.solids import signed_distance
from drake_srg.vision.view import View

# A fit from a guess finds the pose if it is turned by less than about half of this from
# the true one [rad].
_TURN = np.deg2rad(30.0)
# Points that rank the guesses, and guesses that are worth a fit.
_POINTS, _BEST = 200, 6
# Rotations R_WO that put each side of the bounding box down; upright is the first.
_SIDES = [
    RotationMatrix(),
    RotationMatrix.MakeXRotation(np.pi),
    *[RotationMatrix.MakeXRotation(angle) for angle in (-np.pi / 2, np.pi / 2)],
    *[RotationMatrix.MakeYRotation(angle) for angle in (-np.pi / 2, np.pi / 2)],
]


def guess_pieces(
    shape: ConvexPieces, view: View, *, upright: bool = False
) -> list[RigidTransform]:
    """Return poses X_WO from which a fit may start, the likeliest first.

    Args:
        shape: The solid.
        view: Where it is. At least three pixels of the blob have depth.
        upright: Whether its z points upwards.
    """
    points = view.points()[view.blob & view.valid]
    points = points[:: -(-len(points) // _POINTS)]
    yaws = np.arange(0.0, 2 * np.pi, _TURN)
    sides = _SIDES[:1] if upright else _SIDES
    guesses = [
        _behind(shape, RotationMatrix.MakeZRotation(yaw) @ side, points, view)
        for side in sides
        for yaw in yaws
    ]
    return sorted(guesses, key=lambda X_WO: _misfit(shape, X_WO, points))[:_BEST]


def _behind(
    shape: ConvexPieces, R_WO: RotationMatrix, points: Vector, view: View
) -> RigidTransform:
    """Return the pose of some rotation whose visible extents are those of the points.

    In the camera's x and y, the middles agree, and in depth the nearest points.
    """
    solid = shape.corners @ R_WO.matrix().T @ view.R_WD
    seen = points @ view.R_WD
    near = np.quantile(seen[:, 2], 0.02) - solid[:, 2].min()
    seen_middle, middle = (
        0.5 * (p.max(axis=0) + p.min(axis=0))[:2] for p in (seen, solid)
    )
    return RigidTransform(R_WO, view.R_WD @ [*(seen_middle - middle), near])


def _misfit(shape: ConvexPieces, X_WO: RigidTransform, points: Vector) -> float:
    """Return the mean distance of points to the solid's surface [m]."""
    p_O = (points - X_WO.translation()) @ X_WO.rotation().matrix()
    return float(np.abs(signed_distance(shape, p_O)[0]).mean())
