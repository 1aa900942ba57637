"""Gives an object of a finished plant other properties, in a context alone.

Building a plant takes a hundred times as long.
"""

from __future__ import annotations

from pydrake.geometry import (
    ProximityProperties,
    RoleAssign,
    SceneGraph,
)
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, SpatialInertia
from pydrake.systems.framework import Context

from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import collision_shape, shape_contact, solid_inertia


def SetObject(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    context: Context,
    body_index: BodyIndex,
    config: ObjectConfig,
) -> None:
    """Give an object shape, mass and friction of another configuration.

    An object with a `shape` takes all of them, one from a `model` mass and friction.

    Args:
        plant: With the object, finalized.
        scene_graph: With the plant's geometry.
        context: Of the root of both, changed.
        body_index: The object's body.
        config: What it becomes.
    """
    body = plant.get_body(body_index)
    plant_context = plant.GetMyMutableContextFromRoot(context)
    geometry_context = scene_graph.GetMyMutableContextFromRoot(context)
    source = plant.get_source_id()
    if config.shape is not None:
        assert config.mass is not None
        inertia = solid_inertia(config.mass, config.shape)
        shape = collision_shape(config.shape)
        properties = shape_contact(config)
        for geometry in plant.GetCollisionGeometriesForBody(body):
            scene_graph.AssignRole(
                geometry_context, source, geometry, properties, RoleAssign.kReplace
            )
            scene_graph.ChangeShape(geometry_context, source, geometry, shape)
        for geometry in plant.GetVisualGeometriesForBody(body):
            scene_graph.ChangeShape(geometry_context, source, geometry, shape)
        body.SetSpatialInertiaInBodyFrame(plant_context, inertia)
        return
    if config.mass is not None:
        own = body.default_spatial_inertia()
        inertia = SpatialInertia(config.mass, own.get_com(), own.get_unit_inertia())
        body.SetSpatialInertiaInBodyFrame(plant_context, inertia)
    inspector = scene_graph.model_inspector()
    for geometry in plant.GetCollisionGeometriesForBody(body):
        # The model's own friction may have been replaced before.
        properties = ProximityProperties(inspector.GetProximityProperties(geometry))
        if config.friction is not None:
            friction = CoulombFriction(config.friction, config.friction)
            properties.UpdateProperty("material", "coulomb_friction", friction)
        scene_graph.AssignRole(
            geometry_context, source, geometry, properties, RoleAssign.kReplace
        )
