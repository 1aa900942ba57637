"""First guesses of a solid's pose from the points of its visible surface."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.types import Box, Cylinder, Shape, Sphere, Vector
from drake_srg.vision.view import View

_FLOOR = 5e-5  # m, least thickness of a plane: a renderer's depth has no noise
_STEEPEST = np.cos(np.deg2rad(15.0))  # a top leaning more is taken as not understood
_UP = np.array([0.0, 0.0, 1.0])


def guess_upright(shape: Cylinder | Box, view: View) -> RigidTransform:
    """The pose X_WO, the solid's z upwards, from which a fit may start.

    Args:
        shape: The solid.
        view: Where it is; at least three pixels of the blob have depth.
    """
    points = view.points()[view.blob & view.valid]
    if isinstance(shape, Box):
        return _standing_box(shape, points, view.noise, upright=True)
    forward = points.mean(axis=0) - view.origin
    forward /= np.linalg.norm(forward)
    return _cylinder(shape, points, _UP, forward, view)


def guess_poses(shape: Shape, view: View) -> list[RigidTransform]:
    """Poses X_WO from which a fit may start.

    A box is taken to stand, its top within 15 degrees of level. A cylinder's normals
    are along its axis or square to it, so its axis is an eigenvector of their second
    moments, whatever part is seen. Where noise spoils the normals, the axis may be that
    of a level top or the points' longest. Either end of a cylinder may be hidden.

    Args:
        shape: The solid.
        view: Where it is; at least three pixels of the blob have depth.
    """
    points = view.points()[view.blob & view.valid]
    middle = points.mean(axis=0)
    forward = (middle - view.origin) / np.linalg.norm(middle - view.origin)
    if isinstance(shape, Sphere):
        # A ball's surface is on average that much before its centre.
        return [RigidTransform(middle + 2 / 3 * shape.radius * forward)]
    if isinstance(shape, Box):
        return [_standing_box(shape, points, view.noise)]
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
    """Unit normals where a pixel of the blob is between others, in W, shape (n, 3)."""
    known = view.blob & view.valid
    points = np.where(known[..., None], view.points(), 0.0)
    right, down = (points - np.roll(points, 2, axis=k) for k in (1, 0))
    n = np.cross(right[1:-1, 2:], down[2:, 1:-1])
    n = n[known[1:-1, 2:] & known[1:-1, :-2] & known[2:, 1:-1] & known[:-2, 1:-1]]
    return n / np.maximum(np.linalg.norm(n, axis=1), 1e-12)[:, None]


def _cylinder(
    shape: Cylinder, points: Vector, axis: Vector, forward: Vector, view: View
) -> RigidTransform:
    """A cylinder along an axis, whose end is at the last of the points there."""
    middle = points.mean(axis=0)
    end = np.quantile((points - middle) @ axis, 0.98)
    # Seen from the side, a cylinder's surface is on average that much before its axis.
    behind = np.pi / 4 * shape.radius * (forward - (forward @ axis) * axis)
    center = middle + (end - 0.5 * shape.length) * axis + behind
    # Its x is one that turns with the camera, so that what is found does so, too.
    x = view.R_WD[:, np.argmin(np.abs(axis @ view.R_WD))]
    x = x - (x @ axis) * axis
    x /= np.linalg.norm(x)
    R_WO = RotationMatrix(np.column_stack([x, np.cross(axis, x), axis]))
    return RigidTransform(R_WO, center)


def _standing_box(
    shape: Box, points: Vector, noise: float, *, upright: bool = False
) -> RigidTransform:
    """A box on its base: its top is the plane through the topmost points."""
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
    """The plane through the topmost of `points`, nearly level.

    Grows from the points near the highest ones and narrows to four standard deviations
    of what it holds. A patch too narrow to tell its slope is taken as level.

    Args:
        points: Shape (n, 3), n > 0, z up [m].
        extent: Size of the surface looked for [m].
        noise: Standard deviation of the points [m].

    Returns:
        Unit normal (3,), a point of the plane (3,), half its thickness [m].
    """
    floor = max(_FLOOR, 4 * noise)
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
        normal = lean if wide and lean[2] > _STEEPEST else _UP
        residual = np.abs((top - center) @ normal)
        thickness = min(thickness, max(floor, 4 * 1.4826 * float(np.median(residual))))
    return normal, center, thickness


def guess_rectangle(points: Vector, size: Sequence[float]) -> Vector:
    """First guess (x, y, yaw) of a rectangle from points (n, 2) inside it [m]."""
    scale = 1e4  # OpenCV works in single precision; 0.1 mm units suit it
    middle, sides, degrees = cv2.minAreaRect((points * scale).astype(np.float32))
    yaw = np.deg2rad(degrees)
    if (sides[0] < sides[1]) != (size[0] < size[1]):
        yaw += np.pi / 2
    return np.array([middle[0] / scale, middle[1] / scale, yaw])
