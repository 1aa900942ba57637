"""Objects' extents, and the solids that localizer and planner assume for them."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import (
    Box,
    Convex,
    Cylinder,
    Mesh,
    SceneGraph,
    SceneGraphInspector,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, RigidBody

from drake_srg.common.exceptions import scenario_errors
from drake_srg.common.geometry import ConvexPieces, Solid, centered_pieces
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import AddObject, known_shape
from drake_srg.types import Vector

_FAR = 1e3  # half the size of a half space [m]
# Sides of the prism that replaces a cylinder: an error of at most 0.5 % of the radius.
_SIDES = 32
_SIGNS = np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3), axis=-1).reshape(-1, 3)


def hull_points(
    plant: MultibodyPlant, inspector: SceneGraphInspector, body: RigidBody
) -> list[Vector]:
    """Return points whose convex hulls are a body's collision geometries.

    The hulls are exact, except those of round shapes: their points lie on the surface.

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
    """Return points whose convex hull is nearly a shape, shape (n, 3) [m]."""
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
    raise ValueError(
        f"geometry must be a mesh, box, cylinder or sphere, got {type(shape).__name__}"
    )


def _rings(circles: list[tuple[float, float]]) -> Vector:
    """Return points on circles about z, given as (radius, height)."""
    angle = 2 * np.pi * np.arange(_SIDES) / _SIDES
    x, y = np.cos(angle), np.sin(angle)
    return np.concatenate(
        [np.stack([r * x, r * y, np.full(_SIDES, z)], axis=1) for r, z in circles]
    )


def known_solid(name: str, config: ObjectConfig) -> tuple[Solid, Vector] | None:
    """Return the geometry that the localizer assumes for an object.

    It is the object's simple shape or, for a model of several pieces with a
    `color_range`, the union of their convex hulls.

    Returns:
        The solid, scaled by `known_scale`, and its centre p_OC [m], shape (3,); None if
        the localizer does not know the object.

    Raises:
        ScenarioError: If the model cannot be read, or a piece has no volume.
    """
    shape = known_shape(name, config)
    if shape is not None:
        return shape, np.zeros(3)
    if not config.known or config.soft is not None or config.color_range is None:
        return None
    solid, p_OC = object_pieces(name, config)
    scale = config.known_scale
    return ConvexPieces(tuple(scale * piece for piece in solid.pieces)), scale * p_OC


def planned_solid(name: str, config: ObjectConfig) -> Solid | None:
    """Return the geometry that the planner assumes for an object, about its frame.

    Returns:
        The localizer's solid; None if the localizer does not know the object, or if it
        is soft.

    Raises:
        ScenarioError: If the model cannot be read, or a piece has no volume.
    """
    known = None if config.soft is not None else known_solid(name, config)
    if known is None:
        return None
    solid, p_OC = known
    return solid.translated(p_OC) if isinstance(solid, ConvexPieces) else solid


def object_pieces(name: str, config: ObjectConfig) -> tuple[ConvexPieces, Vector]:
    """Return the convex hulls of an object's collision geometries.

    Returns:
        The solid, about its centre C, and p_OC [m], shape (3,).

    Raises:
        ScenarioError: If the model cannot be read, or a piece has no volume.
    """
    with scenario_errors(f"objects.{name}.model"):
        return centered_pieces(_pieces(name, config))


def _pieces(name: str, config: ObjectConfig) -> list[Vector]:
    """Return corners of each collision geometry in the object's frame, (n, 3) each."""
    plant, scene_graph = MultibodyPlant(time_step=0.0), SceneGraph()
    plant.RegisterAsSourceForSceneGraph(scene_graph)
    model: ModelInstanceIndex = AddObject(plant, name, config)
    (index,) = plant.GetBodyIndices(model)
    inspector = scene_graph.model_inspector()
    return hull_points(plant, inspector, plant.get_body(index))
