"""Localizer and planner of a robot, in a process of their own.

An image takes tenths of a second, and a plan takes seconds. In the process of the
control loop, even another thread would delay the loop. Localizer and planner therefore
run as a separate cell, see `PlannerCell`.

The control loop sends ticks with the newest measurements. Each advances the cell by one
planner period, and an answer goes back. While the planner plans, it takes no ticks and
its clock stands still. In simulation, planning takes no simulated time either.
"""

from __future__ import annotations

import contextlib
import dataclasses as dc
import math
import threading
import time as wall
from collections import deque
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.common.yaml import yaml_dump_typed
from pydrake.math import BsplineBasis
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder, System
from pydrake.trajectories import BsplineTrajectory
from scipy.interpolate import make_interp_spline

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.common.real_time import Companion, lower_priority
from drake_srg.lifetime import my_context
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.planner_machine import PlannerMachine, planning_clock
from drake_srg.planning.servoing.config import ServoCommand, ServoStatus
from drake_srg.planning.servoing.tracker import Sighting, Tracker
from drake_srg.robot.drive.cameras import Camera
from drake_srg.robot.drive.config import HardwareConfig
from drake_srg.robot.drive.link import Link
from drake_srg.robot.drive.opening import Hardware, open_cameras
from drake_srg.robot.drive.remote_planner import Answer, Ended, PlannerLink, Tick
from drake_srg.robot.drive.station import AddHardwareStation
from drake_srg.robot.serve.commands import PortValues, Warnings
from drake_srg.scenario import Scenario, robot_arms, servo_of
from drake_srg.scenario.typed_yaml import read_typed
from drake_srg.station import MakeCell
from drake_srg.station.clearing import without_cut_corners
from drake_srg.station.servoing import MakeServoTaskPlanner, MakeTracker


class ServoEye:
    """Finds the object in the newest picture of a camera."""

    def __init__(self, tracker: Tracker, camera: Camera) -> None:
        self._tracker, self._camera = tracker, camera
        self._stamp = -math.inf  # of the last picture [s]

    def look(self) -> Sighting | None:
        """Return what the newest picture shows; None if there is no new one."""
        picture = self._camera.newest()
        if picture is None or picture.stamp <= self._stamp:
            return None
        self._stamp = picture.stamp
        seen = self._tracker.sight(picture.color, picture.depth)
        return dc.replace(seen, stamp=picture.stamp)


class MirrorLink(Link):
    """A link whose measurements come from ticks; it drops the commands.

    Args:
        outputs: Sizes of the measurements, by name.
    """

    def __init__(self, outputs: dict[str, int]) -> None:
        self.outputs = outputs
        self.values: PortValues = {}

    def take(self) -> PortValues:
        """Return what has been measured since the last call, by output port."""
        return self.values

    def send(self, commands: PortValues) -> None:
        """Command the hardware; a failure to do so must not raise."""

    def close(self) -> None:
        """Disconnect, leaving the hardware where it is. A second call does nothing."""


_SAMPLE = 0.005  # time between samples of a motion [s]


def sendable(motion: Motion) -> Motion:
    """Return a motion that pickles. Of Drake's trajectories, only B-splines do.

    Other trajectories become a cubic B-spline through samples, with the same velocities
    at both ends.
    """
    trajectory = motion.trajectory
    if trajectory is None or isinstance(trajectory, BsplineTrajectory):
        return motion
    begin, end = trajectory.start_time(), trajectory.end_time()
    times = np.linspace(begin, end, max(round((end - begin) / _SAMPLE), 3) + 1)
    speeds = [trajectory.EvalDerivative(t, 1)[:, 0] for t in (begin, end)]
    spline = make_interp_spline(
        times,
        trajectory.vector_values(times).T,
        bc_type=tuple([(1, speed)] for speed in speeds),
    )
    points = [point[:, np.newaxis] for point in spline.c]
    sent = BsplineTrajectory(BsplineBasis(4, spline.t.tolist()), points)
    return dc.replace(motion, trajectory=sent)


class PlannerCell:
    """A cell whose clock advances with ticks.

    Args:
        hardware: The cameras, and a `MirrorLink` as the only link. Pictures of a visual
            servo's camera are evaluated only while the servo tracks.
    """

    def __init__(self, scenario: Scenario, hardware: Hardware) -> None:
        (mirror,) = hardware.links
        assert isinstance(mirror, MirrorLink)
        self._mirror, self._period = mirror, scenario.planner.period

        def make_station(scenario: Scenario) -> Diagram:
            builder = DiagramBuilder()
            AddHardwareStation(builder, scenario, hardware, self._period)
            return builder.Build()

        make_planner: Callable[[Scenario], System] | None = None
        self._eye: ServoEye | None = None
        servo = servo_of(scenario)
        if servo is not None:
            make_planner = MakeServoTaskPlanner
            camera = hardware.cameras[servo.camera]
            self._eye = ServoEye(MakeTracker(scenario), camera)
        cell = MakeCell(without_cut_corners(scenario), make_station, make_planner)
        self._cell = cell
        self._planner = cell.GetSubsystemByName("planner")
        if not isinstance(self._planner, PlannerMachine):
            raise ScenarioError(
                "planner: must not be !Script on hardware, where motions are planned"
            )
        self._simulator = Simulator(cell)
        self._fix_servo(ServoStatus())
        self._simulator.Initialize()
        self._motions: dict[str, Any] = {own.name: None for own in robot_arms(scenario)}
        self._ticks = 0

    def answers(self, tick: Tick) -> list[Answer]:
        """Advance by one planner period; return an answer for each arm."""
        self._mirror.values = tick.values
        if tick.servo is not None:
            self._fix_servo(tick.servo)
        self._ticks += 1
        self._simulator.AdvanceTo(self._ticks * self._period)
        root = self._simulator.get_context()
        context = my_context(self._planner, root)
        memory, answers = self._planner.state(context).memory, []
        for name, before in self._motions.items():
            motion, closure = self._planner.commands(memory, name)
            answer = Answer(
                root.get_time() - self._period,  # when the planner was last updated
                None if motion is before else sendable(motion),
                closure,
                self._planner.GetOutputPort("status").Eval(context),
                planning_wall=planning_clock(),
                arm=name,
                joints=self._planner.own_joints(name),
            )
            answers.append(answer)
            self._motions[name] = motion
        if self._eye is None:
            return answers
        command = self._planner.GetOutputPort("servo_command").Eval(context)
        tracks = command is ServoCommand.TRACK
        sighting = self._eye.look() if tracks else None
        return [dc.replace(a, command=command, sighting=sighting) for a in answers]

    def _fix_servo(self, status: ServoStatus) -> None:
        """Fix the servo's report at the planner's input, if there is a servo."""
        if self._eye is None:
            return
        context = my_context(self._planner, self._simulator.get_context())
        port = self._planner.GetInputPort("servo_status")
        port.FixValue(context, AbstractValue.Make(status))


# Most ticks without an answer. With more, the planner's clock would fall behind the
# robot's. With fewer, the planner would wait for each message.
_UNDER_WAY = 2
_POLL = 0.1  # s
_UNEXPECTED = Ended("the planner's process has ended unexpectedly")


class PlannerProcess(PlannerLink):
    """Runs the localizer and the planner of a scenario in another process.

    Args:
        config: The drivers; the process opens the cameras.
        outputs: Sizes of the measurements in the ticks, by name.
        start: The first measurements.
    """

    def __init__(
        self,
        scenario: Scenario,
        config: HardwareConfig,
        outputs: dict[str, int],
        start: PortValues,
        warnings: Warnings,
    ) -> None:
        self._warnings = warnings
        self._answers: deque[list[Answer] | Ended] = deque()  # to each tick
        self._under_way = 0
        self._ready = threading.Event()
        self.planning_wall = 0.0  # time spent planning so far [s, real]
        # Drake's schema objects do not pickle, but their YAML does.
        texts = (yaml_dump_typed(scenario), yaml_dump_typed(config))
        self._process = Companion(
            "planner",
            _run,
            (*texts, outputs, dict(start)),
            self._receive,
            lambda: self._receive(_UNEXPECTED),
        )

    def wait(self, patience: float, stopped: Callable[[], bool]) -> None:
        """Wait until the planner is ready for ticks.

        Args:
            patience: How long to wait [s, real].
            stopped: Returns whether to give up waiting.

        Raises:
            ScenarioError: If it does not get ready.
        """
        end = wall.monotonic() + patience
        while not self._ready.wait(_POLL):
            if stopped():
                raise ScenarioError("hardware: stopped before the planner was ready")
            if wall.monotonic() > end:
                raise ScenarioError(
                    f"hardware: the planner is not ready after {patience:g} s"
                )
        for message in self.take():
            if isinstance(message, Ended):
                raise ScenarioError(message.reason)

    def post(self, tick: Tick) -> None:
        """Send a tick, or drop it while the planner is busy with earlier ones."""
        if self._under_way < _UNDER_WAY:
            self._under_way += 1
            self._process.send(tick)

    def take(self) -> Sequence[Answer | Ended]:
        """Return what has arrived since the last call, in order."""
        taken: list[Answer | Ended] = []
        while self._answers:
            message = self._answers.popleft()
            self._under_way -= isinstance(message, list)
            taken += message if isinstance(message, list) else [message]
        return taken

    def close(self) -> None:
        """End the process."""
        self._process.close()

    def _receive(self, message: str | list[Answer] | Ended | None) -> None:
        if isinstance(message, str):
            self._warnings.warn(message, message)
            return
        if message is not None:
            self._answers.append(message)
        if isinstance(message, list):
            self.planning_wall = message[0].planning_wall
        else:  # None: ready
            self._ready.set()


def _run(
    connection: Connection,
    scenario_text: str,
    hardware_text: str,
    outputs: dict[str, int],
    start: PortValues,
) -> None:
    """Run the process: answer ticks until the connection or the planner ends."""
    lower_priority()
    sending = threading.Lock()  # warnings come from any thread

    def send(message: Any) -> None:
        with sending:
            connection.send(message)

    try:
        scenario = read_typed(Scenario, scenario_text)
        config = read_typed(HardwareConfig, hardware_text)
        warnings = Warnings(send)
        with open_cameras(scenario, config, warnings) as cameras:
            hardware = Hardware([MirrorLink(outputs)], cameras, start)
            cell = PlannerCell(scenario, hardware)
            send(None)  # ready
            while True:
                send(cell.answers(connection.recv()))
    except (EOFError, OSError) as error:
        reason = one_line(error)
    except Exception as error:  # the control loop must get a reason
        reason = one_line(error) or repr(error)
    with contextlib.suppress(OSError):  # the control loop's process is gone
        send(Ended(reason))
