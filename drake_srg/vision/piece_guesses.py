"""First guesses of the pose of convex pieces from the points of their surface."""

from __future__ import annotations

from operator import itemgetter

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.common.convex_pieces import ConvexPieces
from drake_srg.types import Vector
from drake_srg.vision.solids import signed_distance
from drake_srg.vision.symmetry import turn_between
from drake_srg.vision.view import View

# A fit from a guess finds the pose if it is turned by less than about half of this from
# the true one [rad].
_TURN = np.deg2rad(30.0)
# Points that rank the guesses, steps that bring a guess to them, and guesses that are
# worth a fit. As few points show what makes a turn visible, such as a handle, as many
# more are if none of the first explains the view.
_POINTS, _STEPS, WORTH_A_FIT = 150, 4, 6
# Turns about the solid's axes, and about the vertical, that may rival the best pose
# [rad], and how many of the former are worth a fit.
_RIVAL_TURNS = np.deg2rad([-90.0, -40.0, -20.0, 20.0, 40.0, 90.0, 180.0])
_SMALL_TURNS = _RIVAL_TURNS[1:5]
_RIVALS = 12
# A pose that is turned farther from the best one [rad] rivals it if it leaves no more
# unexplained than this many times as much, and this share of the blob: a dozen pixels.
_TURNED, _MUCH, _MORE = np.deg2rad(10.0), 1.2, 0.01
# Distance beyond which a point counts less [m], as when something hides the solid.
_FAR = 0.005


def guess_pieces(
    shape: ConvexPieces, view: View, *, upright: bool = False
) -> list[RigidTransform]:
    """Return poses X_WO from which a fit may start, the likeliest first.

    Args:
        shape: The solid.
        view: Where it is. At least three pixels of the blob have depth.
        upright: Whether its z points upwards; otherwise, it stands or rests on a face.
    """
    points = _some_points(view)
    downs = [np.array([0.0, 0.0, -1.0])]
    if not upright:
        downs += [down for down in shape.resting if down[2] > -0.99]
    guesses = [
        _settled(
            shape, RotationMatrix.MakeZRotation(yaw) @ _put_down(down), points, view
        )
        for down in downs
        for yaw in np.arange(0.0, 2 * np.pi, _TURN)
    ]
    return [X_WO for _, X_WO in sorted(guesses, key=itemgetter(0))]


def guess_rivals(
    shape: ConvexPieces, X_WO: RigidTransform, view: View
) -> list[RigidTransform]:
    """Return far turned poses that the points show nearly as well, the likeliest first.

    Args:
        shape: The solid.
        X_WO: The pose whose rivals are looked for.
        view: As for `guess_pieces`.
    """
    points = _some_points(view)
    guesses = [
        _settled(
            shape,
            X_WO.rotation() @ RotationMatrix(AngleAxis(turn, axis)),
            points,
            view,
        )
        for axis in np.eye(3)
        for turn in _RIVAL_TURNS
    ]
    X_WM = RigidTransform(points.mean(axis=0))
    X_MO = X_WM.InvertAndCompose(X_WO)
    upright = [
        X_WM @ RigidTransform(RotationMatrix.MakeZRotation(turn), np.zeros(3)) @ X_MO
        for turn in _SMALL_TURNS
    ]
    return [X for _, X in sorted(guesses, key=itemgetter(0))[:_RIVALS]] + upright


def are_rivals(
    shape: ConvexPieces,
    best: tuple[float, RigidTransform],
    other: tuple[float, RigidTransform],
) -> bool:
    """Return whether another pose explains a view hardly worse than the best one.

    Each is the share of pixels that it leaves unexplained, and X_WO.
    """
    (least, X_1), (unexplained, X_2) = best, other
    return (
        unexplained <= _MUCH * least + _MORE
        and turn_between(shape, X_1.rotation(), X_2.rotation()) > _TURNED
    )


def _some_points(view: View) -> Vector:
    """Return evenly spread points of the blob, shape (n, 3), at most `_POINTS`."""
    points = view.seen
    return points[:: -(-len(points) // _POINTS)]


def _put_down(down: Vector) -> RotationMatrix:
    """Return a rotation R_WO that turns a direction in O downwards."""
    return RotationMatrix.MakeFromOneVector(-down, 2).inverse()


def _settled(
    shape: ConvexPieces, R_WO: RotationMatrix, points: Vector, view: View
) -> tuple[float, RigidTransform]:
    """Return the pose of some rotation that the points show, and how badly they do.

    At first, its visible extents are those of the points: in the camera's x and y, the
    middles agree, and in depth the nearest points. As the points may show a part only,
    the solid then moves to where its surface is near them.

    Returns:
        The mean distance of the points to the surface [m], far ones counting less, and
        the pose.
    """
    R = R_WO.matrix()
    solid, seen = shape.corners @ R.T @ view.R_WD, points @ view.R_WD
    middle = [0.5 * (p.max(axis=0) + p.min(axis=0)) for p in (seen, solid)]
    offset = middle[0] - middle[1]
    offset[2] = np.quantile(seen[:, 2], 0.02) - solid[:, 2].min()
    p_WO = view.R_WD @ offset
    for step in range(_STEPS + 1):
        error, gradient = signed_distance(shape, (points - p_WO) @ R)
        weight = 1.0 / np.maximum(1.0, np.abs(error) / _FAR)
        if step < _STEPS:
            g = gradient @ R.T
            H = (g.T * weight) @ g + 1e-3 * len(g) * np.eye(3)
            p_WO = p_WO + np.linalg.solve(H, g.T @ (weight * error))
    misfit = float(np.mean(weight * np.abs(error)))
    return misfit, RigidTransform(R_WO, p_WO)
