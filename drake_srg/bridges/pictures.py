"""Publish pictures and blobs of a served station."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from pydrake.systems.sensors import CameraInfo

from drake_srg.bridges.camera_process import CameraProcess
from drake_srg.bridges.commands import Warnings
from drake_srg.bridges.outlet import Outlet
from drake_srg.bridges.topics import camera_topics, image_topics
from drake_srg.recording.ros_topics import Topic
from drake_srg.scenario import Scenario, servo_of
from drake_srg.types import Vector

PERIOD = 0.1  # shortest time between pictures [s, simulated]


@dc.dataclass(frozen=True)
class ServedCamera:
    """A camera whose pictures clients can subscribe to.

    Attributes:
        name: In the scenario.
        scenario: What renders its pictures.
        topics: By the names of `camera_topics`, whatever they are published as.
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
    """Yield the camera of `served_camera`, then the planner's others, the servo's last.

    Args:
        scenario: What is served.
        period: Shortest time between pictures of the first one [s, simulated].
    """
    first = served_camera(scenario)
    if first is None:
        return
    if scenario.task.clear is None:
        topics = camera_topics(*first, scenario.task.pick)
        yield ServedCamera(first[0], scenario, topics, period)
    else:  # objects of any shape, for which there is no localizer
        alone = _with_one_camera(scenario, first[0])
        yield ServedCamera(first[0], alone, image_topics(*first), period)
    others = dict.fromkeys(scenario.task.place.cameras, period)
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

    A `CameraProcess` renders each camera; it starts with the first subscription.

    Args:
        scenario: The scenario that is served.
        warnings: Where failures are reported.
        period: Shortest time between pictures, except those of a visual servo's camera
            [s, simulated].

    Attributes:
        topics: The topics that can be subscribed to, by name.
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
