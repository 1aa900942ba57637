"""Pictures of the cameras and blobs of the localizer, for a served station."""

from __future__ import annotations

import contextlib
import dataclasses as dc
import json
import os
import threading
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from pydrake.common.yaml import yaml_dump_typed
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraInfo

from drake_srg.common.real_time import Companion, lower_priority
from drake_srg.common.systems import export_outputs
from drake_srg.recording.camera_topics import camera_info_message
from drake_srg.recording.rosbag import (
    MakeMessage,
    Topic,
    image_message,
    pose_message,
)
from drake_srg.robot.serve.bridge import Outlet
from drake_srg.robot.serve.commands import Warnings
from drake_srg.scenario import Scenario, servo_of
from drake_srg.scenario.typed_yaml import read_typed
from drake_srg.station.cameras import MakeRemoteCameras
from drake_srg.station.perception import AddLocalizer
from drake_srg.types import Blob, Vector

COLOR, DEPTH = "/camera/color/image_raw", "/camera/depth/image_raw"
CAMERA_INFO, BLOBS = "/camera/color/camera_info", "/blobs"
OBJECT_POSE = "/object_pose"
_ROOT = "/camera"


def image_topics(
    camera: str, intrinsics: CameraInfo, root: str = _ROOT
) -> dict[str, Topic]:
    """Return the topics of a camera by COLOR, DEPTH and CAMERA_INFO.

    After the time, their `convert` takes:

    - COLOR: pixels, shape (h, w, 3), uint8
    - DEPTH: Drake's depths [m], shape (h, w), float32
    - CAMERA_INFO: nothing

    Args:
        camera: The camera's name in the scenario.
        intrinsics: Intrinsics of both images.
        root: Prefix of their names in place of "/camera".
    """
    frame_id = f"camera_{camera}"

    def color(make: MakeMessage, time: float, pixels: Any) -> Any:
        return image_message(make, time, frame_id, "rgb8", pixels)

    def depth(make: MakeMessage, time: float, pixels: Any) -> Any:
        # "Too close" is 0 in Drake and -inf in REP 118. "Too far" is inf in both.
        pixels = np.where(pixels == 0.0, np.float32(-np.inf), pixels)
        return image_message(make, time, frame_id, "32FC1", pixels)

    def info(make: MakeMessage, time: float) -> Any:
        return camera_info_message(make, time, frame_id, intrinsics)

    image = "sensor_msgs/msg/Image"
    return {
        name: Topic(root + name.removeprefix(_ROOT), kind, {}, convert, sensor=True)
        for name, kind, convert in (
            (COLOR, image, color),
            (DEPTH, image, depth),
            (CAMERA_INFO, "sensor_msgs/msg/CameraInfo", info),
        )
    }


def camera_topics(
    camera: str, intrinsics: CameraInfo, pick: str = ""
) -> dict[str, Topic]:
    """Return the topics of a camera and of the localizer, by name.

    The camera's topics are `image_topics`. After the time, `convert` of BLOBS and
    OBJECT_POSE takes a list of `Blob`.

    Args:
        camera: The camera's name in the scenario.
        intrinsics: Intrinsics of both images.
        pick: Name of the object whose pose OBJECT_POSE publishes.
    """

    def pose(make: MakeMessage, time: float, blobs: Sequence[Blob]) -> Any:
        certain = [b for b in blobs if b.object_name == pick and b.certain]
        best = max(certain, key=lambda blob: blob.trust, default=None)
        return best and pose_message(make, time, best.X_WO)

    return {
        **image_topics(camera, intrinsics),
        BLOBS: Topic(BLOBS, "std_msgs/msg/String", {}, _blobs),
        OBJECT_POSE: Topic(OBJECT_POSE, "geometry_msgs/msg/PoseStamped", {}, pose),
    }


def _orientation(blob: Blob) -> dict[str, float]:
    quaternion = blob.X_WO.rotation().ToQuaternion()
    return {name: float(getattr(quaternion, name)()) for name in "xyzw"}


def _blobs(make: MakeMessage, time: float, blobs: Sequence[Blob]) -> Any:
    """Return blobs as JSON: no standard message has an object's name and flags."""
    rows = [
        {
            "object_name": blob.object_name,
            "camera": blob.camera,
            "pixel": list(blob.pixel),
            "position": blob.position.tolist(),
            "axis": blob.axis.tolist(),
            "orientation": _orientation(blob),
            "quality": blob.quality,
            "flags": sorted(flag.value for flag in blob.flags),
        }
        for blob in blobs
    ]
    text = json.dumps({"stamp": time, "frame_id": "world", "blobs": rows})
    return make("std_msgs/msg/String", data=text)


# Called with a picture's time [s], its topic and the values for the topic's `convert`.
Show = Callable[[float, str, tuple[Any, ...]], None]


class CameraProcess:
    """Renders a camera's pictures and runs the localizer, in another process.

    Args:
        scenario: The plant's scenario. It must not have soft objects, because their
            shape is not part of the state vector.
        camera: Name of the camera to render.
        state: Initial state of the plant, with which the renderers warm up.
        show: Called with each picture, in a thread of this object. Must not raise.
    """

    def __init__(
        self,
        scenario: Scenario,
        camera: str,
        state: Vector,
        show: Show,
        warnings: Warnings,
    ):
        self._show, self._warnings = show, warnings
        self._idle = threading.Event()
        arguments = (yaml_dump_typed(scenario), camera, state)
        self._process = Companion(
            "cameras", _render, arguments, self._receive, self._end
        )

    @property
    def idle(self) -> bool:
        """Whether the next `look` starts at once."""
        return self._idle.is_set()

    def look(self, time: float, state: Vector, topics: Collection[str]) -> None:
        """Start rendering `topics` for a state of the plant at `time` [s].

        Does nothing while the process is busy, and for an empty `topics`.
        """
        if topics and self._idle.is_set():
            self._idle.clear()
            self._process.send((time, state, set(topics)))

    def close(self) -> None:
        """End the process."""
        self._process.close()

    def _receive(self, message: tuple[float, dict[str, tuple[Any, ...]]]) -> None:
        time, pictures = message
        for topic, values in pictures.items():
            self._show(time, topic, values)
        self._idle.set()

    def _end(self) -> None:
        self._idle.clear()
        self._warnings.warn(
            "cameras end", "the camera process has ended: no more pictures"
        )


def _render(connection: Connection, scenario: str, camera: str, state: Vector) -> None:
    """Run the process: render whenever the connection asks for it."""
    lower_priority()
    os.environ.setdefault("LP_NUM_THREADS", "0")  # render on one core only
    viewer = Viewer(read_typed(Scenario, scenario), camera)
    # Renderers initialize themselves the first time they render.
    viewer.look(0.0, state, {COLOR, DEPTH, BLOBS})
    with contextlib.suppress(EOFError, OSError):  # the parent is gone
        connection.send((0.0, {}))  # ready
        while True:
            time, state, topics = connection.recv()
            connection.send((time, viewer.look(time, state, topics)))


class Viewer:
    """A diagram with only the cameras and the localizer.

    Args:
        scenario: The plant's scenario, without soft objects.
        camera: Name of the camera to render.
    """

    def __init__(self, scenario: Scenario, camera: str) -> None:
        builder = DiagramBuilder()
        cameras = builder.AddNamedSystem("cameras", MakeRemoteCameras(scenario))
        builder.ExportInput(cameras.GetInputPort("state"), "state")
        export_outputs(builder, cameras)
        if scenario.localizer.cameras:
            localizer = AddLocalizer(builder, scenario, cameras)
            builder.ExportOutput(localizer.GetOutputPort("blobs"), "blobs")
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self._camera = camera

    def look(
        self, time: float, state: Vector, topics: Collection[str]
    ) -> dict[str, tuple[Any, ...]]:
        """Return the values for each topic's `convert` (see `camera_topics`)."""
        self._context.SetTime(time)
        self._diagram.GetInputPort("state").FixValue(self._context, state)
        values: dict[str, tuple[Any, ...]] = {}
        if CAMERA_INFO in topics:
            values[CAMERA_INFO] = ()
        if COLOR in topics:
            values[COLOR] = (self._image("color")[..., :3].copy(),)
        if DEPTH in topics:
            values[DEPTH] = (self._image("depth")[..., 0].copy(),)
        for name in (BLOBS, OBJECT_POSE):
            if name in topics and self._diagram.HasOutputPort("blobs"):
                port = self._diagram.GetOutputPort("blobs")
                values[name] = (port.Eval(self._context),)
        return values

    def _image(self, kind: str) -> Any:
        port = self._diagram.GetOutputPort(f"camera_{self._camera}.{kind}_image")
        return port.Eval(self._context).data


PERIOD = 0.1  # shortest time between pictures [s, simulated]


@dc.dataclass(frozen=True)
class ServedCamera:
    """A camera whose pictures clients can subscribe to.

    Attributes:
        name: The camera's name in the scenario.
        scenario: The scenario that its process renders.
        topics: Its topics, by the keys of `camera_topics`. Their own names may differ.
        period: Shortest time between pictures [s, simulated].
    """

    name: str
    scenario: Scenario
    topics: Mapping[str, Topic]
    period: float = PERIOD


def served_camera(scenario: Scenario) -> tuple[str, CameraInfo] | None:
    """Return the name and intrinsics of the camera that clients can subscribe to.

    It is the localizer's first camera, or else the scenario's first. Returns None if
    there is no camera or if an object is soft.
    """
    if any(config.soft for config in scenario.objects.values()):
        return None
    for name in (*scenario.localizer.cameras, *scenario.cameras):
        return name, _intrinsics(scenario, name)
    return None


def served_cameras(
    scenario: Scenario, period: float = PERIOD
) -> Iterator[ServedCamera]:
    """Yield the camera of `served_camera`, then others of planner and visual servo.

    Args:
        scenario: The served scenario.
        period: Shortest time between pictures, except those of a visual servo's camera
            [s, simulated].
    """
    first = served_camera(scenario)
    if first is None:
        return
    if scenario.task.clear is None:
        topics = camera_topics(*first, scenario.task.pick)
        yield ServedCamera(first[0], scenario, topics, period)
    else:  # objects have any shape, and no localizer finds them
        alone = _with_one_camera(scenario, first[0])
        yield ServedCamera(first[0], alone, image_topics(*first), period)
    used = (*scenario.localizer.cameras, *scenario.task.place.cameras)
    others = dict.fromkeys(used, period)
    servo = servo_of(scenario)
    if servo is not None:
        others[servo.camera] = servo.camera_period
    for name, shortest in others.items():
        if name == first[0]:
            continue
        topics = image_topics(name, _intrinsics(scenario, name), f"/camera_{name}")
        alone = _with_one_camera(scenario, name)
        yield ServedCamera(name, alone, topics, shortest)


def _with_one_camera(scenario: Scenario, name: str) -> Scenario:
    """Return a scenario with one camera, and without a localizer."""
    localizer = dc.replace(scenario.localizer, cameras=[])
    cameras = {name: scenario.cameras[name]}
    return dc.replace(scenario, cameras=cameras, localizer=localizer)


def _intrinsics(scenario: Scenario, name: str) -> CameraInfo:
    color, _ = scenario.cameras[name].MakeCameras()
    return color.core().intrinsics()


class Pictures:
    """Publishes the topics of the cameras and of the localizer.

    A `CameraProcess` renders each camera. It starts with the camera's first subscriber.

    Args:
        period: Shortest time between pictures, except those of a visual servo's camera
            [s, simulated].

    Attributes:
        topics: The topics that clients can subscribe to, by name.
    """

    def __init__(
        self, scenario: Scenario, warnings: Warnings, period: float = PERIOD
    ) -> None:
        cameras = served_cameras(scenario, period)
        self._cameras = [_Published(camera, warnings) for camera in cameras]
        topics = [t for c in self._cameras for t in c.camera.topics.values()]
        self.topics = {topic.name: topic for topic in topics}

    def look(
        self, time: float, plant_state: Callable[[], Vector], outlet: Outlet
    ) -> None:
        """Render the plant's state for each camera that is due and has a subscriber."""
        for camera in self._cameras:
            camera.look(time, plant_state, outlet)

    def close(self) -> None:
        """End the camera processes."""
        for camera in self._cameras:
            camera.close()


class _Published:
    """Publishes the topics of one camera."""

    def __init__(self, camera: ServedCamera, warnings: Warnings) -> None:
        self.camera, self._warnings = camera, warnings
        self._process: CameraProcess | None = None
        self._next = 0.0

    def look(
        self, time: float, plant_state: Callable[[], Vector], outlet: Outlet
    ) -> None:
        if time < self._next or not (self._process is None or self._process.idle):
            return
        camera = self.camera
        wanted = [
            key
            for key, topic in camera.topics.items()
            if outlet.has_subscribers(topic.name)
        ]
        if not wanted:
            return
        if self._process is None:

            def show(seen_at: float, key: str, values: tuple[Any, ...]) -> None:
                outlet.send(camera.topics[key], seen_at, values)

            self._process = CameraProcess(
                camera.scenario, camera.name, plant_state(), show, self._warnings
            )
        else:
            self._process.look(time, plant_state(), wanted)
            self._next = time + camera.period

    def close(self) -> None:
        if self._process is not None:
            self._process.close()
