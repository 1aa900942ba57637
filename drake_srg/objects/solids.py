"""What the localizer knows of an object's geometry."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from drake_srg.common.convex_pieces import ConvexPieces, Solid, centered_pieces
from drake_srg.common.exceptions import scenario_errors
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.corners import hull_points
from drake_srg.objects.models import AddObject, known_shape
from drake_srg.types import Vector


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
        What the localizer knows of it; None if that is nothing, or the object is soft.

    Raises:
        ScenarioError: If the model cannot be read, or a piece has no volume.
    """
    known = None if config.soft is not None else known_solid(name, config)
    if known is None:
        return None
    solid, p_OC = known
    return solid.shifted(p_OC) if isinstance(solid, ConvexPieces) else solid


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
