"""Recorders of a run: video and rosbag of a cell or a station."""

from __future__ import annotations

import contextlib
import dataclasses as dc
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, PrismaticJoint
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort

from drake_srg.common.systems import moving_joints, output_ports
from drake_srg.gripper.tendon import motor_load
from drake_srg.recording.camera_topics import calibration_topics
from drake_srg.recording.output import Recorder
from drake_srg.recording.recording import FILES
from drake_srg.recording.rosbag import (
    ArmNames,
    MakeMessage,
    RosbagRecorder,
    Topic,
    cell_topics,
    finger_topics,
    float64,
    float64_array,
    topic_of,
)
from drake_srg.recording.scene_topics import scene_topics as topics_of_scene
from drake_srg.recording.timeline import ArmLabels, Labels
from drake_srg.recording.video import VideoRecorder, View
from drake_srg.scenario import Scenario
from drake_srg.scenario.schema import RobotArm, robot_arms, script_of
from drake_srg.simulation.metrics import kinds_of
from drake_srg.station.plant import AddDirectives, AddObjects, MakeModelsPlant
from drake_srg.station.video_process import RemoteVideoRecorder, VideoProcess
from drake_srg.types import Vector
from drake_srg.vision.camera import calibrated_model

_STATE = "plant_state_cheat"


def scene_topics(cell: Diagram, scenario: Scenario) -> list[Topic]:
    """Return /tf and /scene of a cell or a station; none without the plant's state.

    These topics show the rigid bodies of the scenario, but no soft objects.
    """
    port = output_ports(cell).get(_STATE)
    if port is None:
        return []
    rigid = {n: config for n, config in scenario.objects.items() if not config.soft}
    scenario = dc.replace(scenario, objects=rigid)
    graph, plant = SceneGraph(), MultibodyPlant(time_step=0.0)
    plant.RegisterAsSourceForSceneGraph(graph)
    AddDirectives(plant, scenario)
    AddObjects(plant, scenario)
    plant.Finalize()
    if port.size() != plant.num_multibody_states():
        return []  # the plant is not the scenario's
    context = plant.CreateDefaultContext()
    body_poses = plant.get_body_poses_output_port()

    def to_poses(state: Vector) -> list[RigidTransform]:
        plant.SetPositionsAndVelocities(context, state)
        poses: list[RigidTransform] = body_poses.Eval(context)
        return poses

    inspector, period = graph.model_inspector(), scenario.recording.period
    return topics_of_scene(plant, inspector, _STATE, port.size(), period, to_poses)


__all__ = ["FILES", "AddRecorders"]


def AddRecorders(
    builder: DiagramBuilder,
    cell: Diagram,
    scenario: Scenario,
    out: Path,
    process: VideoProcess | None = None,
) -> dict[str, Recorder]:
    """Add the recorders of video.mp4 and recording.mcap, connected to the cell.

    Args:
        builder: Builder of the root diagram.
        cell: A cell with the ports of `MakeCell`.
        scenario: Its scenario.
        out: Folder of the recordings.
        process: Process that renders the video; None: the cell's own camera does.

    Returns:
        The recorders by kind. They are context managers; close them after the
        simulation.
    """
    recorders: dict[str, Recorder] = {}
    with contextlib.ExitStack() as stack:  # closes the first if the second fails
        if scenario.recording.video_camera:
            video = _AddVideoRecorder(builder, cell, scenario, out, process)
            recorders["video"] = stack.enter_context(video)
        scene = scene_topics(cell, scenario) if scenario.recording.bag_scene else []
        recorders["recording"] = AddRosbagRecorder(builder, cell, scenario, out, scene)
        stack.pop_all()
    return recorders


def _AddVideoRecorder(
    builder: DiagramBuilder,
    cell: Diagram,
    scenario: Scenario,
    out: Path,
    process: VideoProcess | None,
) -> VideoRecorder | RemoteVideoRecorder:
    """Add the recorder of video.mp4, connected to the cell."""
    config, ports = scenario.recording, output_ports(cell)
    name, fps = config.video_camera, config.video_fps
    path, camera = out / FILES["video"], scenario.cameras[name]
    view = None
    if camera.X_PB.base_frame in ("", "world"):
        core = camera.MakeCameras()[0].core()
        view = View(core, camera.X_PB.GetDeterministicValue(), kinds_of(scenario))
    video: VideoRecorder | RemoteVideoRecorder
    if process is None:
        size = camera.width, camera.height
        video = VideoRecorder(path, *size, frame_rate=fps, view=view)
        source = ports[f"camera_{name}.color_image"]
    else:
        source = ports[_STATE]
        video = RemoteVideoRecorder(process, path, source.size(), fps, view)
    builder.AddNamedSystem("video_recorder", video)
    builder.Connect(source, video.get_input_port(0))
    inset = ports.get(f"camera_{config.inset_camera}.color_image")
    if process is None and inset is not None:
        builder.Connect(inset, video.GetInputPort("inset"))
    builder.Connect(ports["planner.status"], video.GetInputPort("caption"))
    if "object_poses_cheat" in ports:
        builder.Connect(ports["object_poses_cheat"], video.GetInputPort("object_poses"))
    return video


def AddRosbagRecorder(
    builder: DiagramBuilder,
    cell: Diagram,
    scenario: Scenario,
    out: Path,
    more: Sequence[Topic] = (),
) -> RosbagRecorder:
    """Add the recorder of recording.mcap, connected to a cell or a station.

    Args:
        builder: Builder of the root diagram.
        cell: A cell with the ports of `MakeCell`, or a station.
        scenario: Its scenario.
        out: Folder of the recording.
        more: Topics besides those of `recorded_topics`.

    Returns:
        The recorder. It is a context manager; close it after the simulation.
    """
    topics = [*recorded_topics(cell, scenario), *more]
    bag = RosbagRecorder(
        out / FILES["recording"], topics, period=scenario.recording.period
    )
    builder.AddNamedSystem("rosbag_recorder", bag)
    ports = output_ports(cell)
    for i in range(bag.num_input_ports()):
        port = bag.get_input_port(i)
        if port.get_name() in ports:
            builder.Connect(ports[port.get_name()], port)
    return bag


def recorded_topics(cell: Diagram, scenario: Scenario) -> list[Topic]:
    """Return the topics for which a cell or a station has ports."""
    config, ports = scenario.recording, output_ports(cell)
    arms = []
    for robot in robot_arms(scenario):
        gripper_joints, sensors = _gripper_names(robot)
        watched = robot.safety is not None and robot.arm is not None
        joints = [joint.name() for joint in _arm_joints(scenario, robot)]
        arms.append(
            ArmNames(
                [robot.system(name) for name in joints],
                [robot.system(name) for name in gripper_joints],
                len(sensors),
                robot.arm_model,
                robot.gripper_model,
                f"{robot.prefix}safety" if watched else "",
                felt=f"{robot.arm_model}.external_torque" in ports,
            )
        )
    topics = cell_topics(
        arms,
        dict.fromkeys(config.bag_cameras, config.bag_camera_period),
        located=scenario.task.clear is None and not script_of(scenario),
    )
    for robot in robot_arms(scenario):
        if robot.gripper is not None:
            links = robot.gripper.layout.sensor_links
            topics += finger_topics(robot.gripper_model, links)
        topics += _motor_topics(robot, ports)
    for name in config.bag_cameras:
        if f"camera_{name}.color_image" in ports:
            calibration = scenario.camera_calibrations.get(name)
            topics += calibration_topics(
                name,
                calibrated_model(scenario.cameras[name], calibration),
                config.bag_camera_period,
                depth=config.bag_depth,
            )
    return [t for t in topics if t.ports.keys() - t.optional <= ports.keys()]


def _motor_topics(robot: RobotArm, ports: Mapping[str, OutputPort]) -> list[Topic]:
    """Return the topics of a gripper's motors, as far as there are ports for them.

    The current [A] is that in the servo's register; see `motor_load`.
    """
    root = topic_of(robot.gripper_model)
    pwm, state, temperature = (
        f"{robot.gripper_model}.{name}"
        for name in ("pwm", "motor_state", "motor_temperature")
    )
    if pwm not in ports:
        return []
    topics = [float64_array(f"{root}/pwm", pwm, ports[pwm].size())]
    motor = None if robot.gripper is None else robot.gripper.wire_motor
    if motor is None or not {state, temperature} <= ports.keys():
        return topics
    kind = "std_msgs/msg/Float64"

    def current(make: MakeMessage, time: float, duty: Vector, spool: Vector) -> Any:
        load = motor_load(motor.drive, float(duty[0]), float(spool[1]))
        return make(kind, data=load * motor.temperature.stall_current)

    return [
        *topics,
        Topic(f"{root}/motor_current", kind, {pwm: 1, state: 2}, current),
        float64(f"{root}/motor_temperature", temperature),
    ]


def _arm_joints(scenario: Scenario, robot: RobotArm) -> list[Joint]:
    """Return an arm's joints in the order of its state; empty without an arm."""
    if robot.arm is None:
        return []
    plant = MakeModelsPlant(scenario)
    return moving_joints(plant, plant.GetModelInstanceByName(robot.arm_model))


def _gripper_names(robot: RobotArm) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of the gripper's measured joints and of its finger sensors."""
    driver = robot.gripper
    return ((), ()) if driver is None else (driver.joint_names, driver.sensor_names)


def run_labels(name: str, scenario: Scenario) -> Labels:
    """Return labels for the columns of a run's log, which does not contain them."""
    arms = [_arm_labels(scenario, robot) for robot in robot_arms(scenario)]
    title, pick = f"{name}, seed {scenario.random_seed}", scenario.task.pick
    if scenario.arms:
        return Labels(title, pick, arms=tuple(arms))
    (only,) = arms
    return Labels(title, pick, only.gripper_joints, only.sensors, only.arm_slides)


def _arm_labels(scenario: Scenario, robot: RobotArm) -> ArmLabels:
    joints, sensors = _gripper_names(robot)
    arm = _arm_joints(scenario, robot)
    slides = bool(arm) and arm[0].type_name() == PrismaticJoint.kTypeName
    return ArmLabels(robot.name, joints, sensors, slides)
