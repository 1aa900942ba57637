"""First guesses of a solid's pose from the points of its visible surface."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.common.convex_pieces import ConvexPieces, Solid
from drake_srg.types import Box, Cylinder, Sphere, Vector
from drake_srg.vision.piece_guesses import guess_pieces
from drake_srg.vision.rectangle import narrowest_rectangle
from drake_srg.vision.robust import robust_deviation
from drake_srg.vision.view import View

_UP = np.array([0.0, 0.0, 1.0])

_PLANE_THICKNESS = 5e-5  # at least [m]: a renderer's depth has no noise
# A top that leans more than this is not understood and counts as level [rad].
_MOST_LEAN = np.deg2rad(15.0)


def guess_upright(shape: Cylinder | Box | ConvexPieces, view: View) -> RigidTransform:
    """Return a pose X_WO with the solid's z upwards, from which a fit may start.

    Args:
        shape: The solid.
        view: Where it is. At least three pixels of the blob have depth.
    """
    points = view.seen
    if isinstance(shape, Box):
        return _standing_box(shape, points, view.noise, upright=True)
    if isinstance(shape, ConvexPieces):
        return guess_pieces(shape, view, upright=True)[0]
    forward = points.mean(axis=0) - view.origin
    forward /= np.linalg.norm(forward)
    return _cylinder(shape, points, _UP, forward, view)


def guess_poses(shape: Solid, view: View) -> list[RigidTransform]:
    """Return poses X_WO from which a fit may start.

    A box is assumed to be on one of its faces, within 15 degrees. Convex pieces stand
    upright or rest on a face of their convex hull. A cylinder's normals are parallel or
    square to its axis, so the axis is an eigenvector of their second moments, whatever
    part is seen. Where noise spoils the normals, the axis may be the normal of a top or
    the direction in which the points extend farthest. Either end of
    a cylinder may be hidden.

    Args:
        shape: The solid.
        view: Where it is. At least three pixels of the blob have depth.
    """
    points = view.seen
    middle = points.mean(axis=0)
    forward = (middle - view.origin) / np.linalg.norm(middle - view.origin)
    if isinstance(shape, Sphere):
        # On average, a ball's visible surface is this far before its centre.
        return [RigidTransform(middle + 2 / 3 * shape.radius * forward)]
    if isinstance(shape, Box):
        return [_box_on_a_side(shape, i, points, view.noise) for i in (2, 0, 1)]
    if isinstance(shape, ConvexPieces):
        return guess_pieces(shape, view)
    top, _, _ = fit_plane(points, 2 * shape.radius, view.noise)
    long = np.linalg.eigh(np.cov(points.T))[1][:, -1]
    normals = _normals(view)
    axes = [top, long, *np.linalg.eigh(normals.T @ normals)[1].T]
    return [
        _cylinder(shape, points, end * axis, forward, view)
        for axis in axes
        for end in (1, -1)
    ]


def _normals(view: View) -> Vector:
    """Return unit normals where a pixel of the blob lies between others.

    Returns:
        In W, shape (n, 3).
    """
    known = view.blob & view.valid
    points = np.where(known[..., None], view.points, 0.0)
    right, down = (points - np.roll(points, 2, axis=k) for k in (1, 0))
    n = np.cross(right[1:-1, 2:], down[2:, 1:-1])
    n = n[known[1:-1, 2:] & known[1:-1, :-2] & known[2:, 1:-1] & known[:-2, 1:-1]]
    return n / np.maximum(np.linalg.norm(n, axis=1), 1e-12)[:, None]


def _cylinder(
    shape: Cylinder, points: Vector, axis: Vector, forward: Vector, view: View
) -> RigidTransform:
    """Return the pose of a cylinder along an axis that ends where the points end."""
    middle = points.mean(axis=0)
    end = np.quantile((points - middle) @ axis, 0.98)
    # On average, a cylinder's surface seen from the side is this far before its axis.
    behind = np.pi / 4 * shape.radius * (forward - (forward @ axis) * axis)
    center = middle + (end - 0.5 * shape.length) * axis + behind
    # Its x turns with the camera, so that the result does so, too.
    x = view.R_WD[:, np.argmin(np.abs(axis @ view.R_WD))]
    x = x - (x @ axis) * axis
    x /= np.linalg.norm(x)
    R_WO = RotationMatrix(np.column_stack([x, np.cross(axis, x), axis]))
    return RigidTransform(R_WO, center)


def _box_on_a_side(shape: Box, up: int, points: Vector, noise: float) -> RigidTransform:
    """Return the pose of a box whose `up`-th axis is nearly vertical."""
    order = [(up + 1) % 3, (up + 2) % 3, up]
    R_OS = RotationMatrix(np.eye(3)[:, order])
    side = Box([shape.size[i] for i in order])
    X_WS = _standing_box(side, points, noise)
    return X_WS @ RigidTransform(R_OS.inverse())


def _standing_box(
    shape: Box,
    points: Vector,
    noise: float,
    *,
    upright: bool = False,
) -> RigidTransform:
    """Return the pose of a box whose top is the plane through the topmost points."""
    normal, center, thickness = fit_plane(points, min(shape.size[:2]), noise)
    normal = _UP if upright else normal
    e1 = np.cross(_UP if abs(normal[2]) < 0.5 else [0.0, 1.0, 0.0], normal)
    basis = np.stack([e1, np.cross(normal, e1)]) / np.linalg.norm(e1)
    top = points[np.abs((points - center) @ normal) <= thickness]
    x, y, yaw = guess_rectangle((top - center) @ basis.T, shape.size)
    c, s = np.cos(yaw), np.sin(yaw)
    R = np.column_stack([basis.T @ [c, s], basis.T @ [-s, c], normal])
    position = center + np.array([x, y]) @ basis - 0.5 * shape.height * normal
    return RigidTransform(RotationMatrix(R), position)


def fit_plane(
    points: Vector, extent: float, noise: float = 0.0
) -> tuple[Vector, Vector, float]:
    """Return the nearly level plane through the topmost points.

    It grows from the points near the highest ones and narrows to four standard
    deviations of the points that it holds. A patch that is too narrow to show its slope
    counts as level.

    Args:
        points: Shape (n, 3), n > 0, z up [m].
        extent: Size of the surface [m].
        noise: Standard deviation of the points [m].

    Returns:
        Unit normal (3,), a point of the plane (3,), half its thickness [m].
    """
    floor = max(_PLANE_THICKNESS, 4 * noise)
    steepest = np.cos(_MOST_LEAN)
    normal, thickness = _UP, max(3e-3, floor)
    center = np.array([0.0, 0.0, np.quantile(points[:, 2], 0.95)])
    for _ in range(6):
        height = (points - center) @ normal
        top = points[np.abs(height) <= thickness]
        if len(top) < 3:
            break
        center = top.mean(axis=0)
        variance, axes = np.linalg.eigh(np.cov(top.T))
        lean = axes[:, 0] * np.copysign(1.0, axes[2, 0])
        wide = variance[1] > (0.1 * extent) ** 2
        normal = lean if wide and lean[2] > steepest else _UP
        spread = robust_deviation((top - center) @ normal)
        thickness = min(thickness, max(floor, 4 * spread))
    return normal, center, thickness


def guess_rectangle(points: Vector, size: Sequence[float]) -> Vector:
    """Return a first guess (x, y, yaw) of a rectangle from points inside it.

    Args:
        points: Shape (n, 2) [m].
        size: Of the rectangle, along its x and y [m].
    """
    middle, sides, yaw = narrowest_rectangle(points)
    if (sides[0] < sides[1]) != (size[0] < size[1]):
        yaw += np.pi / 2
    return np.array([*middle, yaw])
