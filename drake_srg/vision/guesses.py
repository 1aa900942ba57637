"""First guesses of a solid's pose from the points of its visible surface."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.types import Box, Cylinder, Shape, Sphere, Vector

_FLOOR = 5e-5  # m, least thickness of a plane: a renderer's depth has no noise
_STEEPEST = np.cos(np.deg2rad(15.0))  # a top leaning more is taken as not understood
_UP = np.array([0.0, 0.0, 1.0])


def guess_poses(shape: Shape, points: Vector, eye: Vector) -> list[RigidTransform]:
    """Poses X_WO from which a fit may start.

    A box is taken to stand, its top within 15 degrees of level. A cylinder's axis may
    be the normal of a level top, a principal direction of the points, or between the
    longest and the shortest one: where a tilted cylinder shows a cap and its side.

    Args:
        shape: The solid.
        points: Of its visible surface, in W [m], shape (n, 3).
        eye: Where they are seen from, in W [m], shape (3,).
    """
    middle = points.mean(axis=0)
    view = (middle - eye) / np.linalg.norm(middle - eye)
    if isinstance(shape, Sphere):
        return [RigidTransform(middle + 0.6 * shape.radius * view)]
    if isinstance(shape, Box):
        return [_standing_box(shape, points)]
    normal, _, _ = fit_plane(points, 2 * shape.radius)
    long, wide, thin = np.linalg.eigh(np.cov(points.T))[1].T[::-1]
    axes = (normal, long, wide, thin, long + thin, long - thin)
    return [
        _cylinder(shape, points, axis / np.linalg.norm(axis), view) for axis in axes
    ]


def _cylinder(
    shape: Cylinder, points: Vector, axis: Vector, view: Vector
) -> RigidTransform:
    """A cylinder along an axis, its end towards the eye at the last of the points."""
    axis = -axis * np.copysign(1.0, axis @ view)
    middle = points.mean(axis=0)
    end = np.quantile((points - middle) @ axis, 0.98)
    # Seen from the side, the surface is on average 0.2 r nearer than the axis' 0.8 r.
    behind = 0.8 * shape.radius * (view - (view @ axis) * axis)
    center = middle + (end - 0.5 * shape.length) * axis + behind
    return RigidTransform(RotationMatrix.MakeFromOneVector(axis, 2), center)


def _standing_box(shape: Box, points: Vector) -> RigidTransform:
    """A box on its base: its top is the plane through the topmost points."""
    normal, center, thickness = fit_plane(points, min(shape.size[:2]))
    e1 = np.cross(_UP if abs(normal[2]) < 0.5 else [0.0, 1.0, 0.0], normal)
    basis = np.stack([e1, np.cross(normal, e1)]) / np.linalg.norm(e1)
    top = points[np.abs((points - center) @ normal) <= thickness]
    x, y, yaw = guess_rectangle((top - center) @ basis.T, shape.size)
    c, s = np.cos(yaw), np.sin(yaw)
    R = np.column_stack([basis.T @ [c, s], basis.T @ [-s, c], normal])
    position = center + np.array([x, y]) @ basis - 0.5 * shape.height * normal
    return RigidTransform(RotationMatrix(R), position)


def fit_plane(points: Vector, extent: float) -> tuple[Vector, Vector, float]:
    """The plane through the topmost of `points`, nearly level.

    Grows from the points near the highest ones and narrows to four standard deviations
    of what it holds. A patch too narrow to tell its slope is taken as level.

    Args:
        points: Shape (n, 3), n > 0, z up [m].
        extent: Size of the surface looked for [m].

    Returns:
        Unit normal (3,), a point of the plane (3,), half its thickness [m].
    """
    normal, thickness = _UP, 3e-3
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
        thickness = min(thickness, max(_FLOOR, 4 * 1.4826 * float(np.median(residual))))
    return normal, center, thickness


def guess_rectangle(points: Vector, size: Sequence[float]) -> Vector:
    """First guess (x, y, yaw) of a rectangle from points (n, 2) inside it [m]."""
    scale = 1e4  # OpenCV works in single precision; 0.1 mm units suit it
    middle, sides, degrees = cv2.minAreaRect((points * scale).astype(np.float32))
    yaw = np.deg2rad(degrees)
    if (sides[0] < sides[1]) != (size[0] < size[1]):
        yaw += np.pi / 2
    return np.array([middle[0] / scale, middle[1] / scale, yaw])
