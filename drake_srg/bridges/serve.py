"""Runs a station under outside command, in real time."""

from __future__ import annotations

import contextlib
import dataclasses as dc
import math
import threading
import time as wall
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.bridges.bridge import Bridge
from drake_srg.bridges.commands import CommandInbox, Warnings, station_topics
from drake_srg.bridges.outlet import Outlet
from drake_srg.bridges.pacing import Pacer
from drake_srg.bridges.pictures import Pictures
from drake_srg.bridges.served_station import AddServedStation
from drake_srg.common.errors import ScenarioError, scenario_errors
from drake_srg.common.ports import Ports, output_ports
from drake_srg.recording.output import output_folder
from drake_srg.recording.ros_topics import Topic
from drake_srg.scenario import Scenario
from drake_srg.simulation import failure_time
from drake_srg.simulation.recorders import AddRosbagRecorder, recorded_topics

# Time between status reports [s, real].
_STATUS_PERIOD = 0.5

# Makes the bridges: from what they put commands into and what they publish.
Connect = Callable[[CommandInbox, Sequence[Topic]], Sequence[Bridge]]


@dc.dataclass(frozen=True)
class Served:
    """What came of serving a station."""

    sim_time: float  # s
    wall_time: float  # s
    commands: int  # messages that came, good and bad
    recording: Path | None


def control_period(scenario: Scenario) -> float:
    """Time between looks at the inbox [s]: what the arm's driver samples at."""
    if scenario.arm is not None:
        return scenario.arm.period
    return scenario.plant_config.time_step or 1.0 / 256.0


def Serve(
    scenario: Scenario,
    connect: Connect,
    *,
    name: str = "scenario",
    rate: float = 1.0,
    out: Path | None = None,
    stop: threading.Event | None = None,
    tell: Callable[[str], None] = print,
    report: Callable[[str], None] = lambda _: None,
) -> Served:
    """Run a station under the commands of bridges until it is stopped.

    Its task, planner, script and disturbances are left out: who commands does these.
    Where an object is soft, there are no camera topics. Pictures come from a process
    that imports the caller's main module: a script needs `if __name__ == "__main__":`.

    Args:
        scenario: What to serve.
        connect: Makes the bridges.
        name: The scenario's name, for messages.
        rate: Simulated seconds in a real one; 0: as fast as it can, as in Drake.
        out: Folder for recording.mcap; None records nothing.
        stop: Ends it when it is set, by any thread or a signal's handler.
        tell: Called with warnings for people, from any thread.
        report: Called now and then, and at the start, with a line on how it goes.

    Raises:
        ScenarioError: If the models do not fit the scenario, a bridge wants ports that
            the station does not have, or Drake gives up in the middle; what was
            recorded is complete up to there.
        OSError: If `out` cannot be written, or a bridge's address is taken.
        ValueError: By bridges, if an address is none.
        ImportError: If a bridge's packages are missing.
    """
    stop = stop or threading.Event()
    warnings = Warnings(tell)
    failure: ScenarioError | None = None
    recording: Path | None = None
    with contextlib.ExitStack() as stack:
        with scenario_errors(name):
            builder = DiagramBuilder()
            station = AddServedStation(builder, scenario)
            stack.enter_context(output_folder(out))
            if out is not None:
                bag = AddRosbagRecorder(builder, station, scenario, out)
                recording = stack.enter_context(bag).path
            joints = () if scenario.gripper is None else scenario.gripper.joint_names
            plant = builder.GetSubsystemByName("plant")
            inbox = CommandInbox(
                station_topics(plant, station.inputs, joints), warnings
            )
            topics = recorded_topics(station, scenario)
            station.Export(builder)
            simulator = Simulator(builder.Build())
            ApplySimulatorConfig(scenario.simulator_config, simulator)
            simulator.set_target_realtime_rate(0.0)  # the pacer's
            _fix_defaults(simulator)
            simulator.Initialize()
        pictures = Pictures(scenario, warnings)
        outlet = Outlet(connect(inbox, [*topics, *pictures.topics.values()]), warnings)
        for bridge in outlet.bridges:
            stack.callback(bridge.close)
        stack.callback(pictures.close)
        _check_ports(name, outlet.bridges, station)
        start = wall.monotonic()
        try:
            _run(
                _Loop(name, simulator, topics, pictures, inbox, outlet),
                control_period(scenario),
                name,
                rate,
                stop,
                report,
            )
        except ScenarioError as error:
            failure = error
        elapsed = wall.monotonic() - start
    if failure is not None:
        raise failure
    time = simulator.get_context().get_time()
    return Served(time, elapsed, inbox.received, recording)


def _check_ports(name: str, bridges: Sequence[Bridge], station: Ports) -> None:
    wanted = {port for bridge in bridges for port in bridge.ports}
    missing = sorted(wanted - station.outputs.keys())
    if missing:
        raise ScenarioError(
            f"{name}: the station has no {', '.join(missing)}; "
            f"it has {', '.join(station.outputs)}"
        )


def _fix_defaults(simulator: Simulator) -> None:
    """Let an input that must have a value have it: an open gripper."""
    diagram = simulator.get_system()
    if diagram.HasInputPort("gripper.closure_commanded"):
        port = diagram.GetInputPort("gripper.closure_commanded")
        port.FixValue(simulator.get_mutable_context(), [0.0])


class _Loop:
    """One step of what is served: commands in, a control period, what is told out."""

    def __init__(
        self,
        name: str,
        simulator: Simulator,
        topics: Sequence[Topic],
        pictures: Pictures,
        inbox: CommandInbox,
        outlet: Outlet,
    ) -> None:
        self._name, self._simulator = name, simulator
        self.inbox, self.outlet = inbox, outlet
        self._topics, self._pictures = topics, pictures
        self._diagram = simulator.get_system()
        self._context = simulator.get_mutable_context()
        self._ports = output_ports(self._diagram)
        # Of a continuous plant the integrator decides: a control period is one step.
        plant = self._diagram.GetSubsystemByName("plant")
        self._plant_step = plant.time_step() or math.inf
        self._wanted = sorted({name for b in outlet.bridges for name in b.ports})

    def advance(self, until: float) -> None:
        """Obey what was commanded, go on until a time [s], and tell how it goes.

        It is told after the plant's first step, which shows what the commands do: all
        steps of a control period take real time, and clients wait.
        """
        for name, value in self.inbox.take().items():
            self._diagram.GetInputPort(name).FixValue(self._context, value)
        time = min(self._context.get_time() + self._plant_step, until)
        self._advance_to(time)
        values = {name: self._value(name) for name in self._wanted}
        self.outlet.update(time, values)
        for topic in self._topics:
            if self.outlet.has_subscribers(topic.name):
                told = [self._value(name) for name in topic.ports]
                self.outlet.send(topic, time, told)
        self._pictures.look(time, lambda: self._value("plant.state"), self.outlet)
        if time < until:  # CENIC knows no step of nothing
            self._advance_to(until)

    def _advance_to(self, time: float) -> None:
        with failure_time(self._name, self._simulator):
            self._simulator.AdvanceTo(time)

    def _value(self, name: str) -> Any:
        port = self._ports.get(name)
        return None if port is None else port.Eval(self._context)


def _run(
    loop: _Loop,
    period: float,
    name: str,
    rate: float,
    stop: threading.Event,
    report: Callable[[str], None],
) -> None:
    """Step from look to look at the inbox until it is stopped, or nobody is left."""
    pacer = Pacer(rate or math.inf, stop)
    bridges = loop.outlet.bridges
    step, reported = 0, -math.inf
    while not stop.is_set() and not all(bridge.closed for bridge in bridges):
        if wall.monotonic() - reported >= _STATUS_PERIOD:
            reported = wall.monotonic()
            report(
                f"{name}: {loop.outlet.status}; {step * period:.1f} s at "
                f"{pacer.factor:.2f} x real time, {loop.inbox.received} commands"
            )
        step += 1
        loop.advance(step * period)
        pacer.wait(step * period)
        if pacer.too_slow is not None:
            loop.inbox.warnings.warn(
                "pace",
                f"this machine cannot keep {rate:g} x real time with {name}, it does "
                f"{pacer.too_slow:.2f}; ask for less by --rate, or for a faster "
                "scenario",
            )
