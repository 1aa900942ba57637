"""The bins of a scenario and the foot of its arm, measured on their models."""

from __future__ import annotations

import functools

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.corners import body_corners
from drake_srg.scenario import Scenario
from drake_srg.station.plant import Models
from drake_srg.types import Vector

# A bin's rim is at least that high above the table [m].
_LEAST_RIM = 0.02


def bin_boxes(scenario: Scenario) -> dict[str, tuple[Vector, Vector]]:
    """Return the least and greatest corner of each bin by name, in world, (3,) [m].

    Raises:
        ScenarioError: If a model has no collision geometry, or does not rise above the
            table.
    """
    models = Models.of(scenario)
    boxes = {}
    for name in scenario.task.place.bins:
        try:
            boxes[name] = _fixed_box(models, name)
        except ScenarioError as error:
            raise ScenarioError(f"{bin_key(scenario, name)}: {error}") from None
        rise = boxes[name][1][2] - scenario.table.height
        if rise < _LEAST_RIM:
            raise ScenarioError(
                f"{bin_key(scenario, name)}: {name!r} is no bin: it must rise at least "
                f"{_LEAST_RIM} m above the table, got {rise:.3f} m"
            )
    return boxes


def bin_floor(scenario: Scenario, name: str) -> float:
    """Return the world z below the middle of a bin's opening, or higher [m].

    It is measured as the distance of the nearest wall or floor.
    """
    low, high = _fixed_box(Models.of(scenario), name)
    p_W = np.array([*(0.5 * (low + high))[:2], high[2]])
    return float(high[2] - _distance(Models.of(scenario), name, tuple(p_W)))


def bin_key(scenario: Scenario, name: str) -> str:
    """Return the key that names a bin, for messages."""
    return "task.place.bin" if scenario.task.place.bin else f"task.place.bins.{name}"


def foot_box(scenario: Scenario) -> tuple[Vector, Vector]:
    """Return the least and greatest corner of what the arm stands on, (3,) [m]."""
    return _fixed_box(Models.of(scenario), "arm")


@functools.lru_cache(maxsize=4)
def _distance(models: Models, name: str, p_W: tuple[float, ...]) -> float:
    """Return the distance of a point from a model, 0 where none is known [m]."""
    diagram, plant, scene_graph = _built(models)
    context = scene_graph.GetMyContextFromRoot(diagram.CreateDefaultContext())
    query = scene_graph.get_query_output_port().Eval(context)
    own = {
        geometry
        for index in plant.GetBodyIndices(plant.GetModelInstanceByName(name))
        for geometry in plant.GetCollisionGeometriesForBody(plant.get_body(index))
    }
    near = query.ComputeSignedDistanceToPoint(np.array(p_W))
    return float(min((d.distance for d in near if d.id_G in own), default=0.0))


@functools.lru_cache(maxsize=4)
def _fixed_box(models: Models, name: str) -> tuple[Vector, Vector]:
    """Return the corners of those bodies of a model that cannot move."""
    diagram, plant, scene_graph = _built(models)
    context = plant.GetMyContextFromRoot(diagram.CreateDefaultContext())
    inspector = scene_graph.model_inspector()
    corners = [np.zeros((0, 3))]
    for index in plant.GetBodyIndices(plant.GetModelInstanceByName(name)):
        body = plant.get_body(index)
        X_WB: RigidTransform = plant.EvalBodyPoseInWorld(context, body)
        if plant.IsAnchored(body) and plant.GetCollisionGeometriesForBody(body):
            corners.append((X_WB @ body_corners(plant, inspector, body).T).T)
    points = np.concatenate(corners)
    if not len(points):
        raise ScenarioError(f"{name!r} has no fixed collision geometry")
    return points.min(axis=0), points.max(axis=0)


def _built(models: Models) -> tuple[Diagram, MultibodyPlant, SceneGraph]:
    """Return the models' plant in a diagram with its geometry."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    models.add_to(plant)
    plant.Finalize()
    return builder.Build(), plant, scene_graph
