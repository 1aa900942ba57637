"""Recordings of a run: video, rosbag, log, timeline and replay."""

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path

from pydrake.multibody.tree import Joint, PrismaticJoint
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_srg.common.ports import output_ports
from drake_srg.recording.log import write_log
from drake_srg.recording.output import Recorder
from drake_srg.recording.ros_topics import Topic, cell_topics
from drake_srg.recording.rosbag import RosbagRecorder
from drake_srg.recording.run_timeline import Labels, run_timeline
from drake_srg.recording.timeline import draw_timeline
from drake_srg.recording.video import VideoRecorder
from drake_srg.replay import ReplayRecorder
from drake_srg.scenario import Scenario
from drake_srg.scenario.schema import script_of
from drake_srg.simulation.scene_topics import scene_topics
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.station.video_process import RemoteVideoRecorder, VideoProcess
from drake_srg.types import Vector

__all__ = ["FILES", "AddRecorders", "write_samples"]

# Files of a run's artifacts, by kind.
FILES = {
    "video": "video.mp4",
    "recording": "recording.mcap",
    "log": "log.npz",
    "timeline": "timeline.png",
    "replay_glb": "replay.glb",
    "replay": "replay.html",
}


def AddRecorders(
    builder: DiagramBuilder,
    cell: Diagram,
    scenario: Scenario,
    out: Path,
    process: VideoProcess | None = None,
) -> dict[str, Recorder]:
    """Add the recorders of video.mp4 and recording.mcap, connected to the cell.

    Args:
        builder: The root's.
        cell: A cell with the ports of `MakeCell`'s.
        scenario: Its scenario.
        out: Folder of the recordings.
        process: Renders the video; None: the cell's own camera does.

    Returns:
        The recorders by kind. They are context managers; close them after the
        simulation.
    """
    recorders: dict[str, Recorder] = {}
    with contextlib.ExitStack() as stack:  # closes the first if the second fails
        if scenario.recording.video_camera:
            video = _AddVideoRecorder(builder, cell, scenario, out, process)
            recorders["video"] = stack.enter_context(video)
            builder.Connect(
                cell.GetOutputPort("planner.mode"), video.GetInputPort("caption")
            )
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
    """Add the recorder of video.mp4, connected to the cell but for the caption."""
    name, fps = scenario.recording.video_camera, scenario.recording.video_fps
    path, camera = out / FILES["video"], scenario.cameras[name]
    video: VideoRecorder | RemoteVideoRecorder
    if process is None:
        video = VideoRecorder(path, camera.width, camera.height, frame_rate=fps)
        source = cell.GetOutputPort(f"camera_{name}.color_image")
    else:
        source = cell.GetOutputPort("plant_state_cheat")
        video = RemoteVideoRecorder(process, path, source.size(), fps)
    builder.AddNamedSystem("video_recorder", video)
    builder.Connect(source, video.get_input_port(0))
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
        builder: The root's.
        cell: A cell with the ports of `MakeCell`'s, or a station.
        scenario: Its scenario.
        out: Folder of the recording.
        more: Topics beside those of `recorded_topics`.

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
    gripper_joints, sensors = _gripper_names(scenario)
    topics = cell_topics(
        [joint.name() for joint in _arm_joints(scenario)],
        gripper_joints,
        len(sensors),
        dict.fromkeys(config.bag_cameras, config.bag_camera_period),
        located=scenario.task.clear is None and not script_of(scenario),
        watched=scenario.safety is not None and scenario.arm is not None,
        felt="arm.external_torque" in ports,
    )
    return [t for t in topics if t.ports.keys() - t.optional <= ports.keys()]


def _arm_joints(scenario: Scenario) -> list[Joint]:
    """Return the arm's joints in the order of its state; none without an arm."""
    if scenario.arm is None:
        return []
    plant = MakeModelsPlant(scenario)
    arm = plant.GetModelInstanceByName("arm")
    joints = [plant.get_joint(index) for index in plant.GetJointIndices(arm)]
    joints = [joint for joint in joints if joint.num_positions() == 1]
    return sorted(joints, key=lambda joint: joint.position_start())


def _gripper_names(scenario: Scenario) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of the gripper's measured joints and of its finger sensors."""
    driver = scenario.gripper
    return ((), ()) if driver is None else (driver.joint_names, driver.sensor_names)


def write_samples(
    name: str,
    log: Mapping[str, Vector],
    scenario: Scenario,
    out: Path,
    replay: ReplayRecorder | None,
) -> dict[str, str]:
    """Write log.npz and, with `replay`, timeline.png and replay.glb; see `Simulate`.

    Returns:
        Paths of the files by kind.
    """
    written = {"log": write_log(out / FILES["log"], log)}
    if replay is not None:
        labels, video = run_labels(name, scenario), scenario.recording
        written["timeline"] = draw_timeline(
            run_timeline(log, labels), out / FILES["timeline"]
        )
        written["replay_glb"] = replay.write(
            out / FILES["replay_glb"],
            labels,
            video.video_camera,
            1.0 / video.video_fps if video.video_camera else 0.0,
        )
    return {kind: str(path) for kind, path in written.items()}


def run_labels(name: str, scenario: Scenario) -> Labels:
    """Return what a run's log does not tell about its columns."""
    joints, sensors = _gripper_names(scenario)
    arm = _arm_joints(scenario)
    return Labels(
        title=f"{name}, seed {scenario.random_seed}",
        pick=scenario.task.pick,
        gripper_joints=joints,
        sensors=sensors,
        arm_slides=bool(arm) and arm[0].type_name() == PrismaticJoint.kTypeName,
    )
