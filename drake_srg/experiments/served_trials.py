"""One grasp in `kitchen_servoing` through the messages of a served station.

Robot and planner advance in turn: the station of `drake-srg serve`, the control loop of
`drake-srg run --hardware` with drivers, safety monitor and servo, and the cell of its
planner's process. Only sockets and processes are missing.
"""

from __future__ import annotations

import dataclasses as dc
from collections import deque
from collections.abc import Sequence

from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.safety_states import SafetyState
from drake_srg.experiments.direct_node import DirectNode
from drake_srg.experiments.served_robot import PromptCamera, ServedRobot
from drake_srg.experiments.servo_trials import (
    LONGEST,
    SCENARIO,
    Case,
    Grasped,
    GraspWatch,
    grasp_scenario,
)
from drake_srg.lifetime import free_diagrams
from drake_srg.planning.servoing.config import ServoCommand
from drake_srg.robot.drive.arm import Ros2Arm
from drake_srg.robot.drive.cameras import Ros2Camera
from drake_srg.robot.drive.gripper import Ros2Gripper
from drake_srg.robot.drive.opening import Hardware
from drake_srg.robot.drive.planner_process import MirrorLink, PlannerCell
from drake_srg.robot.drive.remote_planner import Answer, Ended, PlannerLink, Tick
from drake_srg.robot.drive.run import ControlLoop, MakeHardwareCell, measurements
from drake_srg.robot.drive.station import MakeHardwareStation
from drake_srg.scenario import Scenario, servo_of
from drake_srg.types import Vector

_STOPPED = (SafetyState.PROTECTIVE_STOP, SafetyState.EMERGENCY_STOP)
_TRIES = 10  # periods before the start, which measurements may take to arrive


@dc.dataclass(frozen=True)
class Served(Grasped):
    """The end of a trial, and why the safety monitor stopped the arm, or ""."""

    stopped: str = ""


class LockstepPlanner(PlannerLink):
    """A planner that takes no simulated time, but waits for the pictures of its looks.

    Args:
        cell: Of the planner.
        robot: Tells the time.
        camera: The localizer's.
        late: How late its pictures arrive [s].
    """

    def __init__(
        self, cell: PlannerCell, robot: ServedRobot, camera: PromptCamera, late: float
    ) -> None:
        self._cell, self._robot, self._camera = cell, robot, camera
        self._late, self._due = late, 0.0
        self._answers: deque[Answer] = deque()

    def post(self, tick: Tick) -> None:
        """See `PlannerLink`."""
        if self._robot.time < self._due:
            return
        looks = self._camera.looks
        answer = self._cell.answer(tick)
        waits = self._late if self._camera.looks > looks else 0.0
        self._due = self._robot.time + waits
        self._robot.pictures.wanted = answer.command is ServoCommand.TRACK
        self._answers.append(answer)

    def take(self) -> Sequence[Answer | Ended]:
        """See `PlannerLink`."""
        if self._robot.time < self._due:
            return []
        taken, self._answers = list(self._answers), deque()
        return taken


class ServedTrial:
    """A robot and its planner, which advance in turn.

    Args:
        scenario: With a visual servo, and with `arm.limits` null.
        late: How late the pictures arrive [s].

    Attributes:
        robot: The robot.
        loop: The control loop of its planner.
        told: Warnings of either side.
    """

    def __init__(self, scenario: Scenario, late: float) -> None:
        servo = servo_of(scenario)
        assert servo is not None
        node = DirectNode()
        self.told = node.told
        parts = node.robot(scenario)
        links = [Ros2Arm().connect(parts), Ros2Gripper().connect(parts)]
        ceiling, hand = scenario.localizer.cameras[0], servo.camera
        root = f"/camera_{hand}"
        seeing = Ros2Camera(
            color=f"{root}/color/image_raw",
            depth=f"{root}/depth/image_raw",
            info=f"{root}/color/camera_info",
        )
        self.robot = robot = ServedRobot(scenario, node, late, SCENARIO)
        looking = PromptCamera(robot, ceiling, Ros2Camera().connect(ceiling, parts))
        cameras = {ceiling: looking, hand: seeing.connect(hand, parts)}
        start: dict[str, Vector] = {}
        for _ in range(_TRIES):
            robot.advance()
            for link in links:
                start |= link.take()
        hardware = Hardware(links, {}, start)
        station = MakeHardwareStation(scenario, hardware)
        mirror = MirrorLink(measurements(station))
        planning = PlannerCell(scenario, Hardware([mirror], cameras, start))
        planner = LockstepPlanner(planning, robot, looking, late)
        cell = MakeHardwareCell(scenario, station, planner, LONGEST, hardware.lag)
        builder = DiagramBuilder()
        builder.AddNamedSystem("cell", cell)
        self.loop = ControlLoop(SCENARIO, scenario, builder.Build(), cell)

    @property
    def stopped(self) -> str:
        """Why the safety monitor has stopped the arm, or ""."""
        state, reason = self.loop.safety
        return reason.value if state in _STOPPED else ""

    def advance(self) -> bool:
        """Advance both by one control period; return whether the run goes on."""
        self.robot.advance()
        return self.loop.advance()


def grasp_served(
    case: Case, method: str, seed: int, late: float, overrides: Sequence[str] = ()
) -> Served:
    """Try one grasp, as `grasp_once` does, but through a served station's messages.

    Args:
        case: What makes it hard.
        method: "pbvs" or "ibvs".
        seed: Of the draws.
        late: How late pictures arrive [s].
        overrides: Further settings of the scenario.
    """
    overrides = ["arm.limits=null", *overrides]
    served = _run(grasp_scenario(case, method, seed, overrides), late)
    free_diagrams()
    return served


def _run(scenario: Scenario, late: float) -> Served:
    trial = ServedTrial(scenario, late)
    watch = GraspWatch(scenario, trial.robot.station, trial.robot.context)
    grasped: Grasped | None = None
    try:
        while grasped is None and trial.robot.time < LONGEST:
            goes_on = trial.advance()
            if trial.stopped or not goes_on:
                grasped = watch.ended("stopped")
            else:
                grasped = watch.look(trial.loop.status.mode)
    except ScenarioError:
        grasped = watch.ended("simulation")
    grasped = grasped or watch.ended("time")
    return Served(**dc.asdict(grasped), stopped=trial.stopped)
