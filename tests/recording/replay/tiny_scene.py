"""A scene of a few shapes: a red box falls on a green floor, a bar swings."""

import numpy as np
from pydrake.geometry import (
    Box,
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    MakeRenderEngineVtk,
    RenderCameraCore,
    RenderEngineVtkParams,
    Sphere,
)
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraInfo, RgbdSensor

from drake_srg.recording.output import write_log
from drake_srg.recording.replay.recorder import ReplayRecorder
from drake_srg.recording.timeline import Labels
from drake_srg.types import Mode

RED, GREEN = (0.8, 0.1, 0.08), (0.1, 0.6, 0.2)
PERIOD, SAMPLES = 0.02, 26


def MakeScene(contacts=True):
    """Return a diagram with a plant and a camera, and the plant."""
    builder = DiagramBuilder()
    plant, graph = AddMultibodyPlantSceneGraph(builder, time_step=0.002)
    inertia = SpatialInertia.SolidBoxWithMass(1.0, 0.1, 0.1, 0.1)
    friction = CoulombFriction(0.8, 0.8)
    box, world = plant.AddModelInstance("box"), plant.world_body()
    body = plant.AddRigidBody("body", box, inertia)
    shape, X = Box(0.2, 0.2, 0.2), RigidTransform()
    plant.RegisterVisualGeometry(body, X, shape, "seen", [*RED, 1.0])
    plant.RegisterCollisionGeometry(body, X, shape, "felt", friction)
    X_WF = RigidTransform([0, 0, -0.5])
    floor = Box(3, 3, 1)
    plant.RegisterVisualGeometry(world, X_WF, floor, "seen floor", [*GREEN, 1.0])
    plant.RegisterCollisionGeometry(world, X_WF, floor, "felt floor", friction)
    bar = plant.AddRigidBody("bar", plant.AddModelInstance("swing"), inertia)
    X_BG = RigidTransform([0, 0, -0.2])
    plant.RegisterVisualGeometry(bar, X_BG, Sphere(0.1), "ball", [0.2, 0.2, 0.9, 1.0])
    X_WJ = RigidTransform([0, 0, 0.5])
    pivot = plant.AddFrame(FixedOffsetFrame("pivot", plant.world_frame(), X_WJ))
    hinge = RevoluteJoint("hinge", pivot, bar.body_frame(), [0, 1, 0])
    plant.AddJoint(hinge)
    hinge.set_default_angle(1.0)
    plant.SetDefaultFloatingBaseBodyPose(
        body,
        RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [0.5, 0.0, 0.3]),
    )
    plant.Finalize()
    add_camera(builder, graph, "side")
    if contacts:
        port = plant.get_contact_results_output_port()
        builder.ExportOutput(port, "contact_results_cheat")
    return builder.Build(), plant


def add_camera(builder, graph, name):
    """Add a small camera that looks at the origin from the side."""
    if not graph.HasRenderer("vtk"):
        graph.AddRenderer("vtk", MakeRenderEngineVtk(RenderEngineVtkParams()))
    core = RenderCameraCore(
        "vtk", CameraInfo(64, 48, 0.8), ClippingRange(0.01, 10), RigidTransform()
    )
    sensor = RgbdSensor(
        graph.world_frame_id(),
        RigidTransform(RollPitchYaw(-2.0, 0, 0), [0.2, -2.0, 1.2]),
        ColorRenderCamera(core),
        DepthRenderCamera(core, DepthRange(0.02, 9)),
    )
    builder.AddNamedSystem(f"rgbd_sensor_{name}", sensor)
    builder.Connect(graph.get_query_output_port(), sensor.query_object_input_port())
    return sensor


def record(folder, title="tiny, seed 0", contacts=True):
    """Record the scene into a folder, and return X_WB by body name and sample."""
    diagram, plant = MakeScene(contacts)
    simulator = Simulator(diagram)
    simulator.Initialize()
    root = simulator.get_context()
    recorder = ReplayRecorder(diagram, diagram, ["box"])
    names = {"box::body": "body", "swing::bar": "bar"}
    poses = {name: [] for name in names}
    for k in range(SAMPLES):
        simulator.AdvanceTo(k * PERIOD)
        recorder.sample(root)
        for scoped, name in names.items():
            X_WB = plant.GetBodyByName(name).EvalPoseInWorld(
                plant.GetMyContextFromRoot(root)
            )
            poses[scoped].append(X_WB)
    labels = Labels(title, "box", ("left_joint",), ("left",))
    recorder.write(folder / "replay.glb", labels, "side", 0.05)
    write_log(folder / "log.npz", made_log())
    return poses


def made_log():
    """Return a log of the same duration, with a mode for each half."""
    time = PERIOD * np.arange(SAMPLES)
    modes = list(Mode)
    half = SAMPLES // 2
    mode = [modes.index(Mode.PRE_GRASP)] * half + [modes.index(Mode.CLOSE)] * half
    ramp = np.linspace(0.0, 1.0, SAMPLES)[:, None]
    return {
        "time": time,
        "mode": np.array(mode, dtype=float),
        "arm.state_measured": ramp * [1.0, 2.0, 3.0, 4.0],
        "arm.torque_measured": ramp * [5.0, 6.0],
        "gripper.state_measured": ramp * [0.5, 0.1],
        "gripper.proximity": np.where(ramp > 0.5, 0.02, np.inf),
        "contact_force": 9.81 * ramp[:, 0],
        "object_pose.box": np.repeat([[0, 0, 0.1, 1, 0, 0, 0]], SAMPLES, axis=0),
    }
