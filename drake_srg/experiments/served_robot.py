"""A served station that talks to a `DirectNode`, and whose pictures are late.

Nothing depends on the speed of the machine: whoever advances it decides when.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from drake_srg.common.systems import MakeSimulator
from drake_srg.experiments.direct_node import DirectNode, make_message
from drake_srg.lifetime import my_context
from drake_srg.recording.rosbag import Topic
from drake_srg.robot.drive.cameras import Camera, Picture
from drake_srg.robot.serve.bridge import Bridge, Outlet
from drake_srg.robot.serve.commands import Warnings
from drake_srg.robot.serve.loop import (
    AddServedStation,
    MakeServedStation,
    ServedLoop,
    control_period,
    fix_defaults,
    station_inbox,
)
from drake_srg.robot.serve.pictures import (
    CAMERA_INFO,
    COLOR,
    DEPTH,
    Viewer,
    served_cameras,
)
from drake_srg.scenario import Scenario, servo_of
from drake_srg.simulation.flat import MakeRoot
from drake_srg.simulation.recorders import recorded_topics
from drake_srg.station.sleeping import MakeAdvance
from drake_srg.types import Vector

_IMAGES = (COLOR, DEPTH, CAMERA_INFO)
_ROUNDING = 1e-9  # s


class DirectBridge(Bridge):
    """Carries a station's messages to a node in the same process.

    Args:
        node: That subscribes.
    """

    def __init__(self, node: DirectNode) -> None:
        self._node = node

    def has_subscribers(self, topic: str) -> bool:
        """See `Bridge`."""
        return self._node.hears(topic)

    def publish(self, topic: Topic, time: float, values: Sequence[Any]) -> None:
        """See `Bridge`."""
        message = topic.convert(make_message, time, *values)
        self._node.told += self._node.deliver(topic.name, message)


class LatePictures:
    """Pictures of a visual servo's camera that arrive late, and others on demand.

    Args:
        scenario: With a visual servo.
        late: How late they arrive [s].

    Attributes:
        wanted: Whether anybody looks at those of the servo's camera; else they are not
            rendered.
        fault: "frozen": it shows the same for ever; "silent": nothing arrives; "": it
            works.
    """

    def __init__(self, scenario: Scenario, late: float) -> None:
        servo = servo_of(scenario)
        assert servo is not None
        self._cameras = {camera.name: camera for camera in served_cameras(scenario)}
        self._viewers = {
            name: Viewer(camera.scenario, name)
            for name, camera in self._cameras.items()
        }
        self._name, self._late = servo.camera, late
        self._taken: deque[tuple[float, Vector]] = deque()
        self._frozen: Vector | None = None
        self._next = 0.0
        self.wanted, self.fault = False, ""

    def look(
        self, time: float, plant_state: Callable[[], Vector], outlet: Outlet
    ) -> None:
        """Take a picture when one is due, and publish what arrives now."""
        if time > self._next - _ROUNDING:
            self._next = time + self._cameras[self._name].period
            self._taken.append((time, plant_state()))
        while self._taken and self._taken[0][0] + self._late < time + _ROUNDING:
            taken, state = self._taken.popleft()
            if self.fault != "frozen" or self._frozen is None:
                self._frozen = state
            if self.wanted and self.fault != "silent":
                self.show(self._name, taken, self._frozen, outlet)

    def show(self, name: str, time: float, state: Vector, outlet: Outlet) -> None:
        """Publish what a camera sees of a state of the plant, taken at a time [s]."""
        values = self._viewers[name].look(time, state, _IMAGES)
        for key, topic in self._cameras[name].topics.items():
            if key in values:
                outlet.send(topic, time, values[key])


class ServedRobot:
    """A served station in the same process as its client.

    Args:
        scenario: With a visual servo; without `arm.limits` it follows trajectories.
        node: The client's.
        late: How late the pictures of the servo's camera arrive [s].
        name: The scenario's.

    Attributes:
        pictures: Those of the servo's camera.
        period: Of its control [s].
        station: The station.
        context: Its context.
    """

    def __init__(
        self, scenario: Scenario, node: DirectNode, late: float, name: str
    ) -> None:
        builder, self.station = MakeRoot(
            "served_station", MakeServedStation, AddServedStation, scenario, name
        )
        simulator = MakeSimulator(builder.Build(), scenario.simulator_config)
        self._root = simulator.get_mutable_context()
        self.context = my_context(self.station, self._root)
        fix_defaults(self.station, self.context)
        simulator.Initialize()
        warnings = Warnings(node.told.append)
        self.period = control_period(scenario)
        self.pictures = LatePictures(scenario, late)
        self._node, self._outlet = node, Outlet([DirectBridge(node)], warnings)
        self._inbox = station_inbox(scenario, self.station, warnings)
        plant = self.station.GetSubsystemByName("station").GetSubsystemByName("plant")
        self._plant, self._steps = plant, 0
        self._loop = ServedLoop(
            name,
            simulator,
            MakeAdvance(simulator, self.station, scenario),
            self.station,
            recorded_topics(self.station, scenario),
            self.pictures,
            self._inbox,
            self._outlet,
        )

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self._root.get_time())

    def advance(self) -> None:
        """Obey what the node has sent, and advance by one period."""
        for topic, message in self._node.sent:
            self._inbox.receive_message(topic.name, message)
        self._node.sent.clear()
        self._steps += 1
        self._loop.advance(self._steps * self.period)

    def show(self, camera: str) -> None:
        """Publish what a camera sees now."""
        context = self._plant.GetMyContextFromRoot(self._root)
        state = self._plant.get_state_output_port().Eval(context)
        self.pictures.show(camera, self.time, state.copy(), self._outlet)


class PromptCamera(Camera):
    """A camera that takes a picture when it is asked for one.

    Args:
        robot: Whose camera it is.
        name: The camera's.
        camera: Receives the messages with the picture.

    Attributes:
        looks: How often it has been asked.
    """

    def __init__(self, robot: ServedRobot, name: str, camera: Camera) -> None:
        self._robot, self._name, self._camera = robot, name, camera
        self.looks = 0

    def picture(self, after: float, patience: float | None = None) -> Picture:
        """See `Camera`."""
        self.looks += 1
        self._robot.show(self._name)
        return self._camera.picture(-float("inf"), patience)

    def newest(self) -> Picture | None:
        """See `Camera`."""
        return self._camera.newest()
