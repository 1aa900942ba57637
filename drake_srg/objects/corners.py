"""How far a body's collision geometry reaches: as points of hulls, and as boxes."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import (
    Box,
    Convex,
    Cylinder,
    Mesh,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody

from drake_srg.types import Vector

_FAR = 1e3  # half the size of a half space [m]
# Sides of the prism that stands for a cylinder: within 0.5 % of the radius.
_SIDES = 32
_SIGNS = np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3), axis=-1).reshape(-1, 3)


def hull_points(
    plant: MultibodyPlant, inspector: SceneGraphInspector, body: RigidBody
) -> list[Vector]:
    """Return points whose convex hulls are a body's collision geometries.

    The hulls are exact but for round shapes, whose points lie on the surface.

    Returns:
        Positions in the body's frame, shape (n, 3) [m], for each geometry.

    Raises:
        ValueError: If a geometry is neither a mesh, a box, a cylinder nor a ball.
    """
    return [
        _moved(inspector.GetPoseInFrame(i), _points(inspector.GetShape(i)))
        for i in plant.GetCollisionGeometriesForBody(body)
    ]


def body_corners(
    plant: MultibodyPlant, inspector: SceneGraphInspector, body: RigidBody
) -> Vector:
    """Return the corners of the boxes around each of a body's collision geometries.

    They enclose geometry of any kind, but less closely than `hull_points`.

    Returns:
        Positions in the body's frame, shape (n, 3) [m].
    """
    corners = []
    for geometry in plant.GetCollisionGeometriesForBody(body):
        X_BG = inspector.GetPoseInFrame(geometry)
        box = inspector.GetObbInGeometryFrame(geometry)
        half = np.full(3, _FAR) if box is None else box.half_width()
        X_BO = X_BG if box is None else X_BG @ box.pose()
        corners.append(_moved(X_BO, _SIGNS * half))
    return np.vstack(corners) if corners else np.zeros((0, 3))


def _moved(X_AB: RigidTransform, p_B: Vector) -> Vector:
    return np.asarray(p_B @ X_AB.rotation().matrix().T + X_AB.translation())


def _points(shape: Shape) -> Vector:
    """Return points whose convex hull is a shape, or nearly so, shape (n, 3) [m]."""
    match shape:
        case Mesh() | Convex():
            hull = shape.GetConvexHull()
            return np.array([hull.vertex(i) for i in range(hull.num_vertices())])
        case Box():
            return np.asarray(0.5 * _SIGNS * shape.size())
        case Cylinder():
            return _rings([(shape.radius(), z * shape.length()) for z in (-0.5, 0.5)])
        case Sphere():
            angles = np.linspace(-np.pi / 2, np.pi / 2, _SIDES // 2 + 1)[1:-1]
            r = shape.radius()
            poles = [[0.0, 0.0, -r], [0.0, 0.0, r]]
            rings = _rings([(r * np.cos(a), r * np.sin(a)) for a in angles])
            return np.concatenate([poles, rings])
    raise ValueError(f"the corners of a {type(shape).__name__} are not known")


def _rings(circles: list[tuple[float, float]]) -> Vector:
    """Return points on circles about z, given as (radius, height)."""
    angle = 2 * np.pi * np.arange(_SIDES) / _SIDES
    x, y = np.cos(angle), np.sin(angle)
    return np.concatenate(
        [np.stack([r * x, r * y, np.full(_SIDES, z)], axis=1) for r, z in circles]
    )
