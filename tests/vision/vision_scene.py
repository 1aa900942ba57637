"""Rendered scenes: coloured primitives seen by Drake's cameras."""

import dataclasses as dc

import numpy as np
from pydrake.geometry import (
    Box,
    ClippingRange,
    ColorRenderCamera,
    Convex,
    Cylinder,
    DepthRange,
    DepthRenderCamera,
    GeometryInstance,
    LightParameter,
    MakeRenderEngineVtk,
    PerceptionProperties,
    RenderCameraCore,
    RenderEngineVtkParams,
    RenderLabel,
    Rgba,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraInfo, RgbdSensor

from drake_srg import types
from drake_srg.common.geometry import ConvexPieces, Solid
from drake_srg.vision.blob_localizer import BlobLocalizer, BlobTarget
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.color import ColorRange

RED, BLUE, GREEN, GREY = (
    (0.9, 0.1, 0.1),
    (0.1, 0.2, 0.9),
    (0.1, 0.7, 0.2),
    (0.4, 0.4, 0.4),
)
CAN = types.Cylinder(0.0339, 0.1018)
# A camera above the table that looks down: it sees 1.6 m x 1.2 m from 1.5 m.
DOWN = RotationMatrix(np.diag([1.0, -1.0, -1.0]))
FOV_Y = 2 * np.arctan(0.6 / 1.5)


def directional(direction, intensity):
    """Return a light that is infinitely far away."""
    return LightParameter(
        type="directional", frame="world", direction=direction, intensity=intensity
    )


# A lamp above and a ring of five around, as in a photographer's light tent: surfaces
# that lean by up to 45 degrees show their own colour within 5 %.
TENT = [directional([0.0, 0.0, -1.0], 0.9)] + [
    directional([np.cos(angle), np.sin(angle), -0.09], 0.26)
    for angle in 2 * np.pi * np.arange(5) / 5
]


@dc.dataclass
class Thing:
    shape: Solid
    position: tuple[float, float, float]
    color: tuple[float, float, float] = RED
    rotation: RotationMatrix = dc.field(default_factory=RotationMatrix)


@dc.dataclass
class Camera:
    X_WB: RigidTransform = dc.field(
        default_factory=lambda: RigidTransform(DOWN, [0.0, 0.0, 1.5])
    )
    width: int = 640
    height: int = 480
    fov_y: float = FOV_Y
    # Of the depth imager, if it is not the colour imager.
    depth_size: tuple[int, int] | None = None
    X_BD: RigidTransform = dc.field(default_factory=RigidTransform)


def target(name="can", shape=CAN, color=RED):
    return BlobTarget(name, shape, ColorRange.around(color))


def standing(shape, x, y, **kwargs):
    """Return a thing that stands on the table."""
    return Thing(shape, (x, y, shape.height / 2), **kwargs)


def make_sensors(builder, things, cameras, table=True, lights=()):
    """Add the scene and a sensor for each camera; return the sensors by name."""
    scene_graph = builder.AddSystem(SceneGraph())
    engine = MakeRenderEngineVtk(RenderEngineVtkParams(lights=list(lights)))
    scene_graph.AddRenderer("vtk", engine)
    source = scene_graph.RegisterSource("scene")
    if table:
        things = [*things, Thing(types.Box((3.0, 3.0, 0.1)), (0, 0, -0.05), GREY)]
    for i, thing in enumerate(things):
        match thing.shape:
            case types.Cylinder(radius=radius, length=length):
                shapes = [Cylinder(radius, length)]
            case types.Box(size=size):
                shapes = [Box(*size)]
            case types.Sphere(radius=radius):
                shapes = [Sphere(radius)]
            case ConvexPieces(pieces=pieces):
                shapes = [Convex(piece.T, "piece") for piece in pieces]
        pose = RigidTransform(thing.rotation, thing.position)
        for k, shape in enumerate(shapes):
            instance = GeometryInstance(pose, shape, f"thing_{i}_{k}")
            properties = PerceptionProperties()
            properties.AddProperty("phong", "diffuse", Rgba(*thing.color))
            properties.AddProperty("label", "id", RenderLabel(i + 1))
            instance.set_perception_properties(properties)
            scene_graph.RegisterAnchoredGeometry(source, instance)
    sensors = {}
    for name, camera in cameras.items():
        clip = ClippingRange(0.05, 10.0)
        size = (camera.width, camera.height)
        color = RenderCameraCore(
            "vtk", CameraInfo(*size, camera.fov_y), clip, RigidTransform()
        )
        depth = RenderCameraCore(
            "vtk",
            CameraInfo(*(camera.depth_size or size), camera.fov_y),
            clip,
            camera.X_BD,
        )
        sensor = RgbdSensor(
            SceneGraph.world_frame_id(),
            camera.X_WB,
            ColorRenderCamera(color),
            DepthRenderCamera(depth, DepthRange(0.1, 5.0)),
        )
        sensors[name] = builder.AddNamedSystem(name, sensor)
        builder.Connect(
            scene_graph.get_query_output_port(), sensor.query_object_input_port()
        )
    return sensors


def render(things, camera=None, table=True):
    """Return the colour (h, w, 4) and depth (h, w) that a camera sees."""
    builder = DiagramBuilder()
    sensor = make_sensors(builder, things, {"camera": camera or Camera()}, table)
    diagram = builder.Build()
    root = diagram.CreateDefaultContext()
    context = sensor["camera"].GetMyContextFromRoot(root)
    color = sensor["camera"].color_image_output_port().Eval(context).data
    depth = sensor["camera"].depth_image_32F_output_port().Eval(context).data
    return color.copy(), depth[..., 0].copy()


def make_diagram(things, targets, cameras=None, lights=(), **config):
    """Return a diagram of the scene, its cameras and a localizer, and the localizer."""
    builder = DiagramBuilder()
    cameras = cameras or {"camera": Camera()}
    sensors = make_sensors(builder, things, cameras, lights=lights)
    models = {name: CameraModel.from_sensor(s) for name, s in sensors.items()}
    localizer = builder.AddSystem(BlobLocalizer(targets, models, **config))
    for name, sensor in sensors.items():
        for port, output in (
            ("color_image", sensor.color_image_output_port()),
            ("depth_image", sensor.depth_image_32F_output_port()),
            ("body_pose_in_world", sensor.body_pose_in_world_output_port()),
        ):
            builder.Connect(output, localizer.GetInputPort(f"{name}.{port}"))
    return builder.Build(), localizer


def locate(things, targets=None, cameras=None, **config):
    """Return the blobs in a rendered scene."""
    diagram, localizer = make_diagram(things, targets or [target()], cameras, **config)
    root = diagram.CreateDefaultContext()
    context = localizer.GetMyContextFromRoot(root)
    return localizer.GetOutputPort("blobs").Eval(context)
