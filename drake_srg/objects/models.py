"""Movable objects in a plant: their models, shapes and properties."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
from pydrake import geometry
from pydrake.geometry import ProximityProperties, RoleAssign, SceneGraph
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import (
    BodyIndex,
    DeformableBody,
    ModelInstanceIndex,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.framework import Context

from drake_srg.common.contacts import relaxation_time
from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.common.geometry import drake_shape
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.meshes.load import model_tree
from drake_srg.objects.sdf import (
    DISSIPATION,
    MODULUS,
    SetContact,
    SetMass,
    contact_properties,
    facet_length,
    is_placed,
)
from drake_srg.objects.soft import AddSoftObject
from drake_srg.parsing import configure_parser
from drake_srg.types import Box, Cylinder, Shape, Sphere

# Drake (1.51.1) cuts a cylinder along its medial axis, and fails on slivers if length
# and diameter differ by less than this [m]. If they are equal, it succeeds.
_NEARLY_AS_LONG = 1e-4


def object_shape(name: str, config: ObjectConfig) -> Shape:
    """Return the shape that localizer and planner assume for the picked object.

    Raises:
        ScenarioError: If the model cannot be read or does not have exactly one simple
            geometry, or the object is soft or not known.
    """
    if config.soft is not None:
        raise ScenarioError(
            f"objects.{name}.soft: a planner cannot pick a soft object; use a script"
        )
    if not config.known:
        raise ScenarioError(f"objects.{name}.known: must be true for the picked object")
    shape = known_shape(name, config)
    if shape is None:
        raise ScenarioError(
            f"objects.{name}.model: {config.model} must have one collision geometry, "
            "a cylinder, box or sphere, to be localized and planned with"
        )
    return shape


def known_shape(name: str, config: ObjectConfig) -> Shape | None:
    """Return the shape that localizer and planner assume for an object.

    Returns:
        The shape, scaled by `known_scale`; None if they do not know the object.

    Raises:
        ScenarioError: If the model cannot be read.
    """
    if not config.known or (shape := simple_shape(name, config)) is None:
        return None
    return shape.scaled(config.known_scale)


def simple_shape(name: str, config: ObjectConfig) -> Shape | None:
    """Return an object's shape or proxy, or the simple geometry of its model, or None.

    Raises:
        ScenarioError: If the model cannot be read.
    """
    if (given := config.shape or config.proxy) is not None:
        return given
    collisions = model_tree(name, config).findall(".//collision")
    geometries = [g for c in collisions for g in c.findall("geometry/*")]
    if len(geometries) != 1 or any(map(is_placed, collisions)):
        return None
    values = {child.tag: child.text or "" for child in geometries[0]}
    match geometries[0].tag:
        case "cylinder":
            return Cylinder(float(values["radius"]), float(values["length"]))
        case "sphere":
            return Sphere(float(values["radius"]))
        case "box":
            return Box([float(x) for x in values["size"].split()])
    return None


def body_color(name: str, config: ObjectConfig) -> list[float] | None:
    """Return the colour of an object's first visual geometry: red, green, blue 0 .. 1.

    Returns:
        The colour; None if the model leaves it to the mesh's own materials.

    Raises:
        ScenarioError: If the model cannot be read.
    """
    if config.shape is not None:
        return config.color
    diffuse = model_tree(name, config).findtext(".//visual/material/diffuse")
    return None if diffuse is None else [float(x) for x in diffuse.split()[:3]]


def X_FO_start(
    config: ObjectConfig, shape: Shape | None, table_height: float
) -> RigidTransform:
    """Return the pose of an object at the start.

    Args:
        config: The object, with its position drawn.
        shape: The object's shape, centred on its origin; None if it has no simple
            shape, in which case its origin is underneath it.
        table_height: Height of the table in world [m].

    Returns:
        X_FO; F is world or the `base_frame` of the object's `pose`.

    Raises:
        ValueError: If the position has not been drawn.
    """
    if config.pose is not None:
        return config.pose.GetDeterministicValue()
    if config.position is None:
        raise ValueError("The object's position has not been drawn.")
    half_height = 0.5 * shape.height if shape is not None else 0.0
    return RigidTransform(
        RollPitchYaw(*config.tilt, config.yaw),
        [*config.position, table_height + half_height],
    )


def AddObject(
    plant: MultibodyPlant, name: str, config: ObjectConfig
) -> ModelInstanceIndex:
    """Add an object to a plant that is not finalized, as model instance `name`.

    Mass, friction, resolution, modulus and dissipation replace the model's, if given.
    Inertia scales with mass.

    Raises:
        ScenarioError: If the model cannot be read or does not have exactly one link, or
            if the plant's settings do not suit a soft object.
    """
    if config.soft is not None:
        return AddSoftObject(plant, name, config)
    if config.shape is not None:
        return _AddShape(plant, name, config)
    root = model_tree(name, config)
    if (links := len(root.findall("model/link"))) != 1:
        raise ScenarioError(
            f"objects.{name}.model: {config.model} must have one link, got {links}"
        )
    if config.mass is not None:
        SetMass(root, config.mass)
    dissipation = config.dissipation
    tau = None if dissipation is None else relaxation_time(dissipation)
    values = {
        "mesh_resolution_hint": config.resolution,
        "hydroelastic_modulus": config.modulus,
        "hunt_crossley_dissipation": dissipation,
        "relaxation_time": tau,
        "mu_dynamic": config.friction,
        "mu_static": config.friction,
    }
    SetContact(root, values)
    parser = Parser(plant, model_name_prefix="")
    configure_parser(parser)
    root_model = root.find("model")
    assert root_model is not None
    root_model.set("name", name)
    with scenario_errors(f"objects.{name}.model: {config.model}"):
        (model,) = parser.AddModelsFromString(ET.tostring(root, "unicode"), "sdf")
    return model


def SetDefaultObjectPose(
    plant: MultibodyPlant, model: ModelInstanceIndex, X_WO: RigidTransform
) -> None:
    """Set the initial pose of an object from `AddObject`, before `Finalize`."""
    body = object_body(plant, model)
    if isinstance(body, BodyIndex):
        plant.SetDefaultFloatingBaseBodyPose(plant.get_body(body), X_WO)
    else:
        body.set_default_pose(X_WO)


def object_body(
    plant: MultibodyPlant, model: ModelInstanceIndex
) -> BodyIndex | DeformableBody:
    """Return the single body of an object: a rigid body's index, or a soft body."""
    deformables = plant.deformable_model()
    soft = [deformables.GetBody(i) for i in deformables.GetBodyIds(model)]
    (body,) = soft or plant.GetBodyIndices(model)
    return body


def _AddShape(
    plant: MultibodyPlant, name: str, config: ObjectConfig
) -> ModelInstanceIndex:
    """Add an object that is one solid shape of uniform density.

    Raises:
        ScenarioError: If mass or friction is missing.
    """
    if config.shape is None or config.mass is None or config.friction is None:
        raise ScenarioError(f"objects.{name}: a shape needs mass and friction")
    model = plant.AddModelInstance(name)
    inertia = solid_inertia(config.mass, config.shape)
    body = plant.AddRigidBody("object", model, inertia)
    X_BG = RigidTransform()
    color = np.array([*config.color, 1.0])
    plant.RegisterVisualGeometry(body, X_BG, drake_shape(config.shape), "visual", color)
    if plant.geometry_source_is_registered():
        plant.RegisterCollisionGeometry(
            body,
            X_BG,
            collision_shape(config.shape),
            "collision",
            shape_contact(config),
        )
    return model


def collision_shape(shape: Shape) -> geometry.Shape:
    """Return the collision shape of an object with a simple shape."""
    if isinstance(shape, Cylinder):
        diameter = 2.0 * shape.radius
        if abs(shape.length - diameter) < _NEARLY_AS_LONG:
            return geometry.Cylinder(shape.radius, diameter)
    return drake_shape(shape)


def shape_contact(config: ObjectConfig) -> geometry.ProximityProperties:
    """Return the contact properties of an object with a `shape` and a friction."""
    assert config.friction is not None
    # A box has no radius; Drake meshes it the same way at any resolution.
    radius = getattr(config.shape, "radius", 1.0)
    return contact_properties(
        config.friction,
        config.modulus or MODULUS,
        config.resolution or facet_length(radius),
        DISSIPATION if config.dissipation is None else config.dissipation,
    )


def solid_inertia(mass: float, shape: Shape) -> SpatialInertia:
    """Return the inertia of a solid of uniform density about its centre.

    Args:
        mass: [kg].
        shape: The solid.
    """
    I_OOo = mass * _unit_inertia(shape)
    return SpatialInertia.MakeFromCentralInertia(mass, np.zeros(3), I_OOo)


def _unit_inertia(shape: Shape) -> UnitInertia:
    match shape:
        case Cylinder(radius, length):
            return UnitInertia.SolidCylinder(radius, length, [0.0, 0.0, 1.0])
        case Box(size):
            return UnitInertia.SolidBox(*size)
        case Sphere(radius):
            return UnitInertia.SolidSphere(radius)


def SetObject(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    context: Context,
    body_index: BodyIndex,
    config: ObjectConfig,
) -> None:
    """Give an object the shape, mass and friction of another configuration.

    An object from a `model` keeps its shape. This takes a hundredth of the time of
    building another plant.

    Args:
        plant: Plant with the object, finalized.
        scene_graph: Scene graph with the plant's geometry.
        context: Context of the root diagram of both, changed in place.
        body_index: The object's body.
        config: The new configuration.
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
        # The inspector has the model's properties, whatever the context has now.
        properties = ProximityProperties(inspector.GetProximityProperties(geometry))
        if config.friction is not None:
            friction = CoulombFriction(config.friction, config.friction)
            properties.UpdateProperty("material", "coulomb_friction", friction)
        scene_graph.AssignRole(
            geometry_context, source, geometry, properties, RoleAssign.kReplace
        )
