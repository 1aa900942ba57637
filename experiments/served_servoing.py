"""Visual servoing through a served station's messages, with pictures that are late.

The can stands on a tray that moves. Arm, gripper and cameras exchange the messages of
`drake-srg serve`. Control loop, safety monitor, servo and planner are those of
`drake-srg run --hardware`. Both sides advance in turn, so no result depends on the
machine's speed. Grasps and criteria are those of `visual_servoing`.
"""

from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
from pydrake.systems.framework import DiagramBuilder

import experiments.runner as ex
from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.safety_states import SafetyState
from drake_srg.common.systems import MakeSimulator
from drake_srg.lifetime import free_diagrams, my_context
from drake_srg.planning.servoing.config import ServoCommand
from drake_srg.robot.drive.arm import Ros2Arm
from drake_srg.robot.drive.cameras import Camera, Picture, Ros2Camera
from drake_srg.robot.drive.gripper import Ros2Gripper
from drake_srg.robot.drive.opening import Hardware
from drake_srg.robot.drive.planner_process import MirrorLink, PlannerCell
from drake_srg.robot.drive.remote_planner import Answer, Ended, PlannerLink, Tick
from drake_srg.robot.drive.run import ControlLoop, MakeHardwareCell, measurements
from drake_srg.robot.drive.station import MakeHardwareStation
from drake_srg.robot.serve import loop as serving
from drake_srg.robot.serve import pictures as served
from drake_srg.robot.serve.bridge import Outlet
from drake_srg.robot.serve.commands import Warnings
from drake_srg.scenario import Scenario, servo_of
from drake_srg.simulation.flat import MakeRoot
from drake_srg.simulation.recorders import recorded_topics
from drake_srg.station.sleeping import MakeAdvance
from drake_srg.types import Vector
from experiments import visual_servoing as prompt
from experiments.stands.direct_node import DirectBridge, DirectNode

_STOPPED = (SafetyState.PROTECTIVE_STOP, SafetyState.EMERGENCY_STOP)
_TRIES = 10  # periods before the start, which measurements may take to arrive
_ROUNDING = 1e-9  # s
_LATE = 0.1  # that pictures arrive [s]


class LatePictures:
    """Publishes late images of a visual servo's camera, and other images on demand.

    Attributes:
        wanted: Whether anybody looks at those of the servo's camera; else they are not
            rendered.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._cameras = {
            camera.name: camera for camera in served.served_cameras(scenario)
        }
        self._viewers = {
            name: served.Viewer(camera.scenario, name)
            for name, camera in self._cameras.items()
        }
        self._name = servo_of(scenario).camera
        self._taken: deque[tuple[float, Vector]] = deque()
        self._next, self.wanted = 0.0, False

    def look(
        self, time: float, plant_state: Callable[[], Vector], outlet: Outlet
    ) -> None:
        """Take a picture when one is due, and publish what arrives now."""
        if time > self._next - _ROUNDING:
            self._next = time + self._cameras[self._name].period
            self._taken.append((time, plant_state()))
        while self._taken and self._taken[0][0] + _LATE < time + _ROUNDING:
            taken, state = self._taken.popleft()
            if self.wanted:
                self.show(self._name, taken, state, outlet)

    def show(self, name: str, time: float, state: Vector, outlet: Outlet) -> None:
        images = (served.COLOR, served.DEPTH, served.CAMERA_INFO)
        values = self._viewers[name].look(time, state, images)
        for key, topic in self._cameras[name].topics.items():
            if key in values:
                outlet.send(topic, time, values[key])


class ServedRobot:
    """A served station in the same process as its client, which has the `node`."""

    def __init__(self, scenario: Scenario) -> None:
        builder, self.station = MakeRoot(
            "served_station",
            serving.MakeServedStation,
            serving.AddServedStation,
            scenario,
            prompt.SCENARIO,
        )
        simulator = MakeSimulator(builder.Build(), scenario.simulator_config)
        self._root = simulator.get_mutable_context()
        self.context = my_context(self.station, self._root)
        serving.fix_defaults(self.station, self.context)
        simulator.Initialize()
        self.node, self.pictures = DirectNode(), LatePictures(scenario)
        warnings = Warnings(self.node.told.append)
        self._outlet = Outlet([DirectBridge(self.node)], warnings)
        self._inbox = serving.station_inbox(scenario, self.station, warnings)
        self._steps, self._period = 0, serving.control_period(scenario)
        self._loop = serving.ServedLoop(
            prompt.SCENARIO,
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
        return float(self._root.get_time())

    def advance(self) -> None:
        """Obey what the node has sent, and advance by one period."""
        for topic, message in self.node.sent:
            self._inbox.receive_message(topic.name, message)
        self.node.sent.clear()
        self._steps += 1
        self._loop.advance(self._steps * self._period)

    def show(self, camera: str) -> None:
        plant = self.station.GetSubsystemByName("station").GetSubsystemByName("plant")
        context = plant.GetMyContextFromRoot(self._root)
        state = plant.get_state_output_port().Eval(context)
        self.pictures.show(camera, self.time, state.copy(), self._outlet)


class PromptCamera(Camera):
    """A robot's camera that takes a picture when asked: `looks` times so far."""

    def __init__(self, robot: ServedRobot, name: str, camera: Camera) -> None:
        self._robot, self._name, self._camera = robot, name, camera
        self.looks = 0

    def picture(self, after: float, patience: float | None = None) -> Picture:
        self.looks += 1
        self._robot.show(self._name)
        return self._camera.picture(-float("inf"), patience)

    def newest(self) -> Picture | None:
        return self._camera.newest()


class LockstepPlanner(PlannerLink):
    """A planner that takes no simulated time, but waits for pictures it asks for."""

    def __init__(
        self, cell: PlannerCell, robot: ServedRobot, camera: PromptCamera
    ) -> None:
        self._cell, self._robot, self._camera, self._due = cell, robot, camera, 0.0
        self._answers: list[Answer] = []

    def post(self, tick: Tick) -> None:
        if self._robot.time < self._due:
            return
        looks = self._camera.looks
        (answer,) = self._cell.answers(tick)
        waits = _LATE if self._camera.looks > looks else 0.0
        self._due = self._robot.time + waits
        self._robot.pictures.wanted = answer.command is ServoCommand.TRACK
        self._answers.append(answer)

    def take(self) -> Sequence[Answer | Ended]:
        if self._robot.time < self._due:
            return []
        taken, self._answers = self._answers, []
        return taken


def make_loop(robot: ServedRobot, scenario: Scenario) -> ControlLoop:
    """Return the control loop of a robot's planner."""
    parts = robot.node.robot(scenario)
    links = [Ros2Arm().connect(parts), Ros2Gripper().connect(parts)]
    ceiling, hand = scenario.localizer.cameras[0], servo_of(scenario).camera
    looking = PromptCamera(robot, ceiling, Ros2Camera().connect(ceiling, parts))
    seeing = Ros2Camera(
        color=f"/camera_{hand}/color/image_raw",
        depth=f"/camera_{hand}/depth/image_raw",
        info=f"/camera_{hand}/color/camera_info",
    )
    cameras = {ceiling: looking, hand: seeing.connect(hand, parts)}
    start: dict[str, Vector] = {}
    for _ in range(_TRIES):
        robot.advance()
        for link in links:
            start |= link.take()
    hardware = Hardware(links, {}, start)
    station = MakeHardwareStation(scenario, hardware)
    mirror = Hardware([MirrorLink(measurements(station))], cameras, start)
    planner = LockstepPlanner(PlannerCell(scenario, mirror), robot, looking)
    cell = MakeHardwareCell(scenario, station, planner, prompt.LONGEST, hardware.lag)
    builder = DiagramBuilder()
    builder.AddNamedSystem("cell", cell)
    return ControlLoop(prompt.SCENARIO, scenario, builder.Build(), cell)


def cases(trials: int = 200, seed: int = 930_000) -> list[ex.Case]:
    """Grasp with both servos at every speed."""
    return ex.grid(
        seed=range(seed, seed + trials),
        case=("0 mm/s", "20 mm/s", "50 mm/s"),
        method=prompt.SERVOS,
    )


def trial(seed: int, case: str, method: str) -> ex.Measures:
    """Try one grasp, as `visual_servoing` does, but through messages."""
    free_diagrams()  # of the last trial
    # Without limits, the served arm follows trajectories.
    scenario = prompt.grasp_scenario(case, method, seed, ["arm.limits=null"])
    robot = ServedRobot(scenario)
    loop = make_loop(robot, scenario)
    watch = prompt.GraspWatch(scenario, robot.station, robot.context)
    ended = None
    try:
        while ended is None and robot.time < prompt.LONGEST:
            robot.advance()
            goes_on = loop.advance() and loop.safety[0] not in _STOPPED
            ended = watch.look(loop.status.mode) if goes_on else watch.ended("stopped")
    except ScenarioError:
        ended = watch.ended("simulation")
    state, why = loop.safety
    stopped = why.value if state in _STOPPED else ""
    return (ended or watch.ended("time")) | {"stopped": stopped}


def summary(own: ex.Trials) -> ex.Values:
    found = prompt.grasp_values(own, held=True, off=True)
    found["stopped by the safety monitor []"] = sum(bool(t["stopped"]) for t in own)
    errors = own.known("error")
    return found | ({"grasp error, worst [m]": np.max(errors)} if len(errors) else {})


served_servoing = ex.Experiment(
    "Visual servoing through a served station's messages, with pictures that are late.",
    cases,
    trial,
    {"stopped by the safety monitor": ex.at_most(0)},
    by=("case", "method"),
    summary=summary,
    picture=[ex.Histogram("error", limit=3e-3), ex.Bars(["held"])],
)
