"""What the localizer knows of an object's geometry."""

from __future__ import annotations

import numpy as np
from pydrake import geometry
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from drake_srg.common.convex_pieces import ConvexPieces, Solid, centered_pieces
from drake_srg.common.exceptions import scenario_errors
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import AddObject, known_shape
from drake_srg.types import Vector

# Sides of the prism that stands for a cylinder: within 0.5 % of the radius.
_SIDES = 32


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
    return [
        _moved(_corners(inspector.GetShape(i)), inspector.GetPoseInFrame(i))
        for i in plant.GetCollisionGeometriesForBody(plant.get_body(index))
    ]


def _moved(p_G: Vector, X_BG: RigidTransform) -> Vector:
    return np.asarray(p_G @ X_BG.rotation().matrix().T + X_BG.translation())


def _corners(shape: geometry.Shape) -> Vector:
    """Return points whose convex hull is a shape, or nearly so, shape (n, 3) [m]."""
    match shape:
        case geometry.Mesh() | geometry.Convex():
            hull = shape.GetConvexHull()
            return np.array([hull.vertex(i) for i in range(hull.num_vertices())])
        case geometry.Box():
            signs = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), axis=-1).reshape(-1, 3)
            return np.asarray(signs * shape.size())
        case geometry.Cylinder():
            return _rings([(shape.radius(), z * shape.length()) for z in (-0.5, 0.5)])
        case geometry.Sphere():
            angles = np.linspace(-np.pi / 2, np.pi / 2, _SIDES // 2 + 1)[1:-1]
            r = shape.radius()
            poles = [[0.0, 0.0, -r], [0.0, 0.0, r]]
            rings = _rings([(r * np.cos(a), r * np.sin(a)) for a in angles])
            return np.concatenate([poles, rings])
    raise ValueError(f"the localizer knows no {type(shape).__name__}")


def _rings(circles: list[tuple[float, float]]) -> Vector:
    """Return points on circles about z, given as (radius, height)."""
    angle = 2 * np.pi * np.arange(_SIDES) / _SIDES
    x, y = np.cos(angle), np.sin(angle)
    return np.concatenate(
        [np.stack([r * x, r * y, np.full(_SIDES, z)], axis=1) for r, z in circles]
    )
