"""Publish pictures and blobs of a served station."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pydrake.systems.sensors import CameraInfo

from drake_srg.bridges.camera_process import CameraProcess
from drake_srg.bridges.commands import Warnings
from drake_srg.bridges.outlet import Outlet
from drake_srg.bridges.topics import camera_topics
from drake_srg.recording.ros_topics import Topic
from drake_srg.scenario import Scenario
from drake_srg.types import Vector

_PERIOD = 0.1  # shortest time between pictures [s, simulated]


def served_camera(scenario: Scenario) -> tuple[str, CameraInfo] | None:
    """Return the name and intrinsics of the camera that clients can subscribe to.

    It is the localizer's first camera, or else the scenario's first. Returns None if
    there is no camera or if an object is soft.
    """
    if any(config.soft for config in scenario.objects.values()):
        return None
    for name in (*scenario.localizer.cameras, *scenario.cameras):
        color, _ = scenario.cameras[name].MakeCameras()
        return name, color.core().intrinsics()
    return None


class Pictures:
    """Publishes the topics of the camera and of the localizer.

    A `CameraProcess` renders them; it starts with the first subscription.

    Args:
        scenario: The scenario that is served.
        warnings: Where failures are reported.

    Attributes:
        topics: The topics that can be subscribed to, by name.
    """

    def __init__(self, scenario: Scenario, warnings: Warnings):
        self._scenario, self._warnings = scenario, warnings
        camera = served_camera(scenario)
        self.topics: dict[str, Topic] = {}
        if camera is not None:
            self._camera, intrinsics = camera
            pick = scenario.task.pick
            self.topics = camera_topics(self._camera, intrinsics, pick)
        self._process: CameraProcess | None = None
        self._next = 0.0

    def look(
        self, time: float, plant_state: Callable[[], Vector], outlet: Outlet
    ) -> None:
        """Render the plant's state if a picture is due and has a subscriber."""
        if time < self._next or not (self._process is None or self._process.idle):
            return
        wanted = [name for name in self.topics if outlet.has_subscribers(name)]
        if not wanted:
            return
        if self._process is None:

            def show(seen_at: float, topic: str, values: tuple[Any, ...]) -> None:
                outlet.send(self.topics[topic], seen_at, values)

            self._process = CameraProcess(
                self._scenario, self._camera, plant_state(), show, self._warnings
            )
        else:
            self._process.look(time, plant_state(), wanted)
            self._next = time + _PERIOD

    def close(self) -> None:
        """End the camera process."""
        if self._process is not None:
            self._process.close()
