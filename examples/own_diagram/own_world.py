"""What the programs beside this file have in common: boxes and a camera."""

import numpy as np
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
    MakeRenderEngineVtk,
    ProximityProperties,
    RenderEngineVtkParams,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import RigidBody, SpatialInertia
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraConfig, RgbdSensor

RED, GRAY = (0.8, 0.1, 0.1), (0.6, 0.6, 0.6)


def AddBox(
    plant: MultibodyPlant,
    name: str,
    sides: list[float],
    X_WO: RigidTransform,
    color: tuple[float, float, float] = GRAY,
    mass: float = 0.0,
) -> RigidBody:
    """Add a box to a plant that is not yet finalized, and return its body.

    Args:
        plant: The plant.
        name: Of the model instance and of the body.
        sides: Along x, y, z [m].
        X_WO: Pose of its centre in world; of a free box, at the start [m].
        color: Red, green and blue, 0 .. 1.
        mass: [kg]; 0: it is fixed.
    """
    inertia = SpatialInertia.SolidBoxWithMass(max(mass, 1e-3), *sides)
    body = plant.AddRigidBody(name, plant.AddModelInstance(name), inertia)
    # Two rigid bodies meet in a point, and a box sinks in on one: what is free is
    # compliant. 50 MPa is stiff beside the hand's pads (2 MPa).
    contact = ProximityProperties()
    AddContactMaterial(friction=CoulombFriction(0.8, 0.8), properties=contact)
    if mass:
        AddCompliantHydroelasticProperties(0.05, 5e7, contact)
    else:
        AddRigidHydroelasticProperties(0.05, contact)
    shape, X_BG = Box(*sides), RigidTransform()
    plant.RegisterCollisionGeometry(body, X_BG, shape, name, contact)
    plant.RegisterVisualGeometry(body, X_BG, shape, name, np.array([*color, 1.0]))
    if mass:
        plant.SetDefaultFloatingBaseBodyPose(body, X_WO)
    else:
        plant.WeldFrames(plant.world_frame(), body.body_frame(), X_WO)
    return body


def AddCamera(
    builder: DiagramBuilder, scene_graph: SceneGraph, X_WB: RigidTransform
) -> RgbdSensor:
    """Add a camera of 640 x 480 pixels that is fixed in the world.

    Args:
        builder: Builds the diagram.
        scene_graph: What it sees.
        X_WB: Its pose; z points into the scene, x to the image's right [m].
    """
    scene_graph.AddRenderer("vtk", MakeRenderEngineVtk(RenderEngineVtkParams()))
    views = CameraConfig(renderer_name="vtk").MakeCameras()  # colour and depth
    camera = RgbdSensor(scene_graph.world_frame_id(), X_WB, *views)
    builder.AddNamedSystem("camera", camera)
    query = scene_graph.get_query_output_port()
    builder.Connect(query, camera.query_object_input_port())
    return camera
