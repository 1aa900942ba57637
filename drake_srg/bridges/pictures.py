"""What a served station's camera and localizer see."""

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

# Time between pictures [s, simulated]; rendering decides how many there really are.
_PERIOD = 0.1


def served_camera(scenario: Scenario) -> tuple[str, CameraInfo] | None:
    """Return name and intrinsics of the camera that clients see through, if any.

    It is the localizer's first, or else the scenario's.
    """
    if any(config.soft for config in scenario.objects.values()):
        return None
    for name in (*scenario.localizer.cameras, *scenario.cameras):
        color, _ = scenario.cameras[name].MakeCameras()
        return name, color.core().intrinsics()
    return None


class Pictures:
    """Sends the topics of the camera and of the localizer.

    They are rendered in a `CameraProcess`, which begins when somebody first listens.

    Attributes:
        topics: What there may be to listen to, by name.
    """

    def __init__(self, scenario: Scenario, warnings: Warnings):
        self._scenario, self._warnings = scenario, warnings
        camera = served_camera(scenario)
        self.topics: dict[str, Topic] = {}
        if camera is not None:
            self._camera, intrinsics = camera
            self.topics = camera_topics(self._camera, intrinsics)
        self._process: CameraProcess | None = None
        self._next = 0.0

    def look(
        self, time: float, plant_state: Callable[[], Vector], outlet: Outlet
    ) -> None:
        """Look at a state of the plant, if it is time and somebody wants to see it."""
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
        """End the process."""
        if self._process is not None:
            self._process.close()
