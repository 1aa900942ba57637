"""The cell that plans for a robot: its clock is moved by messages.

A tick with the newest measurements lets it advance by one planner period, and an answer
goes back. While the planner thinks it takes no ticks, so its clock stands still, as it
does in simulation, where planning takes no simulated time either.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable
from typing import Any

from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder, System

from drake_srg.bridges.commands import PortValues
from drake_srg.cell import MakeCell
from drake_srg.cell.clearing import without_cut_corners
from drake_srg.cell.servoing import MakeServoTaskPlanner, MakeTracker
from drake_srg.common.exceptions import ScenarioError
from drake_srg.hardware.exchange import Answer, Tick
from drake_srg.hardware.link import Link
from drake_srg.hardware.opening import Hardware
from drake_srg.hardware.servo_eye import ServoEye
from drake_srg.hardware.station import AddHardwareStation
from drake_srg.lifetime import my_context
from drake_srg.planning.planner_machine import PlannerMachine, planning_clock
from drake_srg.scenario import Scenario, servo_of
from drake_srg.servoing.status import ServoCommand, ServoStatus


class MirrorLink(Link):
    """A link whose measurements come from ticks; it drops the commands.

    Args:
        outputs: Sizes of the measurements, by name.
    """

    def __init__(self, outputs: dict[str, int]) -> None:
        self.outputs = outputs
        self.values: PortValues = {}

    def take(self) -> PortValues:
        """See `Link`."""
        return self.values

    def send(self, commands: PortValues) -> None:
        """See `Link`."""

    def close(self) -> None:
        """See `Link`."""


class PlannerCell:
    """A cell whose clock ticks move.

    Args:
        scenario: That runs on the hardware.
        hardware: With a `MirrorLink` as its only link, and the cameras. The one of a
            visual servo is looked through only while the servo tracks.
    """

    def __init__(self, scenario: Scenario, hardware: Hardware) -> None:
        (mirror,) = hardware.links
        assert isinstance(mirror, MirrorLink)
        self._mirror, self._period = mirror, scenario.planner.period

        def make_station(scenario: Scenario) -> Diagram:
            builder = DiagramBuilder()
            AddHardwareStation(builder, scenario, hardware, None, self._period)
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
        self._motion: Any = None
        self._ticks = 0

    def answer(self, tick: Tick) -> Answer:
        """Advance by one planner period, and return what is commanded then."""
        self._mirror.values = tick.values
        if tick.servo is not None:
            self._fix_servo(tick.servo)
        self._ticks += 1
        self._simulator.AdvanceTo(self._ticks * self._period)
        root = self._simulator.get_context()
        context = my_context(self._planner, root)
        motion = self._planner.motion(context)
        new = motion is not self._motion
        self._motion = motion
        answer = Answer(
            root.get_time() - self._period,  # when the planner was last updated
            motion if new else None,
            float(self._planner.GetOutputPort("closure_commanded").Eval(context)[0]),
            self._planner.GetOutputPort("status").Eval(context),
            planning_wall=planning_clock(),
        )
        if self._eye is None:
            return answer
        command = self._planner.GetOutputPort("servo_command").Eval(context)
        tracks = command is ServoCommand.TRACK
        sighting = self._eye.look() if tracks else None
        return dc.replace(answer, command=command, sighting=sighting)

    def _fix_servo(self, status: ServoStatus) -> None:
        """Tell the planner what the servo reports, if it has one."""
        if self._eye is None:
            return
        context = my_context(self._planner, self._simulator.get_context())
        port = self._planner.GetInputPort("servo_status")
        port.FixValue(context, AbstractValue.Make(status))
