"""A run's recorders: video, rosbag topics, log samples.

Foxglove and RViz draw them: a transform per moving body, and, once, markers of
triangles in the bodies' frames. These are standard messages, so any ROS 2 reads them.
"""

from __future__ import annotations

import contextlib
import dataclasses as dc
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, Joint, PrismaticJoint, RigidBody
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_srg.common.systems import output_ports
from drake_srg.recording.output import Recorder, write_log
from drake_srg.recording.replay import ReplayRecorder
from drake_srg.recording.replay.glb import Part
from drake_srg.recording.replay.scene import frame_parts, pose_row
from drake_srg.recording.rosbag import (
    MakeMessage,
    RosbagRecorder,
    Topic,
    cell_topics,
    header,
)
from drake_srg.recording.timeline import Labels, draw_timeline, run_timeline
from drake_srg.recording.video import VideoRecorder
from drake_srg.scenario import Scenario
from drake_srg.scenario.schema import script_of
from drake_srg.station.plant import AddDirectives, AddObjects, MakeModelsPlant
from drake_srg.station.video_process import RemoteVideoRecorder, VideoProcess
from drake_srg.types import Vector

_STATE = "plant_state_cheat"
_WORLD = "world"
_TRANSFORMS, _MARKERS = "tf2_msgs/msg/TFMessage", "visualization_msgs/msg/MarkerArray"
# Points are rounded to a 16,384th of a metre, 0.06 mm, which compresses better.
_GRID = 2.0**14


def scene_topics(cell: Diagram, scenario: Scenario) -> list[Topic]:
    """Return /tf and /scene of a cell or a station; none if it lacks the plant's state.

    They show the rigid bodies of the scenario. Soft objects are left out.

    Args:
        cell: The cell.
        scenario: Its scenario.
    """
    port = output_ports(cell).get(_STATE)
    if port is None:
        return []
    scene = _Scene(scenario)
    if port.size() != scene.plant.num_multibody_states():
        return []  # the cell has a plant of its own
    every = scenario.recording.period
    return [
        Topic("/tf", _TRANSFORMS, {_STATE: port.size()}, scene.transforms),
        Topic(
            "/scene",
            _MARKERS,
            {},
            # Only the first time: nothing of it changes.
            lambda make, t: scene.markers(make, t) if t < 1.5 * every else None,
            period=every,
        ),
    ]


class _Scene:
    """A plant apart from the simulation's, with what its bodies look like."""

    def __init__(self, scenario: Scenario) -> None:
        rigid = {n: config for n, config in scenario.objects.items() if not config.soft}
        scenario = dc.replace(scenario, objects=rigid)
        self._graph = SceneGraph()
        self.plant = MultibodyPlant(time_step=0.0)
        self.plant.RegisterAsSourceForSceneGraph(self._graph)
        AddDirectives(self.plant, scenario)
        AddObjects(self.plant, scenario)
        self.plant.Finalize()
        self._context = self.plant.CreateDefaultContext()
        # A body without geometry has no frame in the scene graph's eyes.
        self._seen = [(body, parts) for body, parts in self._bodies() if parts]
        self._moving = [body for body, _ in self._seen if not self._anchored(body)]

    def _bodies(self) -> Iterator[tuple[RigidBody, list[Part]]]:
        inspector = self._graph.model_inspector()
        for index in map(BodyIndex, range(self.plant.num_bodies())):
            frame = self.plant.GetBodyFrameIdIfExists(index)
            if frame is not None:
                yield self.plant.get_body(index), frame_parts(inspector, frame)

    def _anchored(self, body: RigidBody) -> bool:
        return bool(self.plant.IsAnchored(body))

    def _pose(self, body: RigidBody) -> Vector:
        return pose_row(self.plant.EvalBodyPoseInWorld(self._context, body))

    def transforms(self, make: MakeMessage, time: float, state: Vector) -> Any:
        """Return the poses of all moving bodies in world."""
        self.plant.SetPositionsAndVelocities(self._context, state)
        stamped = []
        for body in self._moving:
            x, y, z, *xyzw = self._pose(body).astype(np.float32).tolist()
            stamped.append(
                make(
                    "geometry_msgs/msg/TransformStamped",
                    header=header(make, time, _WORLD),
                    child_frame_id=_frame(body),
                    transform=make(
                        "geometry_msgs/msg/Transform",
                        translation=make("geometry_msgs/msg/Vector3", x, y, z),
                        rotation=make("geometry_msgs/msg/Quaternion", *xyzw),
                    ),
                )
            )
        return make(_TRANSFORMS, transforms=stamped)

    def markers(self, make: MakeMessage, time: float) -> Any:
        """Return the surfaces of all bodies, a marker per body and colour."""
        found = []
        for body, parts in self._seen:
            still = self._anchored(body)
            frame = _WORLD if still else _frame(body)
            pose = self._pose(body) if still else np.eye(7)[6]
            for number, part in enumerate(parts):
                found.append(_marker(make, time, body, number, frame, pose, part))
        return make(_MARKERS, markers=found)


def _frame(body: RigidBody) -> str:
    """Return the name of a body's frame: ROS has slashes where Drake has colons."""
    return str(body.scoped_name().get_full()).replace("::", "/")


def _marker(
    make: MakeMessage,
    time: float,
    body: RigidBody,
    number: int,
    frame: str,
    pose: Vector,
    part: Part,
) -> Any:
    """Return a visualization_msgs/msg/Marker of triangles.

    Args:
        make: Makes messages.
        time: Simulated time [s].
        body: The body.
        number: Of the marker, among the body's.
        frame: The marker's frame.
        pose: Of the body in that frame, as from `pose_row`.
        part: The triangles, in the body's frame.
    """
    surface = part.surface
    corners = np.round(surface.points[surface.faces.ravel()] * _GRID) / _GRID
    x, y, z, *xyzw = pose.tolist()
    nothing = np.zeros(0, np.uint8)
    return make(
        "visualization_msgs/msg/Marker",
        header=header(make, time, frame),
        ns=_frame(body),
        id=number,
        type=11,  # TRIANGLE_LIST
        action=0,  # ADD
        pose=make(
            "geometry_msgs/msg/Pose",
            position=make("geometry_msgs/msg/Point", x, y, z),
            orientation=make("geometry_msgs/msg/Quaternion", *xyzw),
        ),
        scale=make("geometry_msgs/msg/Vector3", 1.0, 1.0, 1.0),
        color=make("std_msgs/msg/ColorRGBA", *part.color),
        lifetime=make("builtin_interfaces/msg/Duration", 0, 0),  # for good
        frame_locked=True,  # it follows its frame
        points=[make("geometry_msgs/msg/Point", *row) for row in corners.tolist()],
        colors=[],
        texture_resource="",
        texture=make(
            "sensor_msgs/msg/CompressedImage", header(make, time), "", nothing
        ),
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=make("visualization_msgs/msg/MeshFile", "", nothing),
        mesh_use_embedded_materials=False,
    )


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
