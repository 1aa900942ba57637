"""Run a station in real time under the commands of external clients."""

from __future__ import annotations

import contextlib
import dataclasses as dc
import math
import threading
import time as wall
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import Context, Diagram

from drake_srg.bridges.bridge import Bridge
from drake_srg.bridges.commands import CommandInbox, Warnings, station_topics
from drake_srg.bridges.outlet import Outlet
from drake_srg.bridges.pacing import Pacer
from drake_srg.bridges.pictures import Pictures
from drake_srg.bridges.safety_commands import SafetyGate, safety_topics
from drake_srg.bridges.served_replay import ServedReplay
from drake_srg.bridges.served_station import AddServedStation, MakeServedStation
from drake_srg.bridges.trajectory_topics import trajectory_topics
from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.common.ports import input_ports, output_ports
from drake_srg.lifetime import my_context
from drake_srg.recording.output import output_folder
from drake_srg.recording.ros_topics import Topic
from drake_srg.scenario import Scenario
from drake_srg.simulation import failure_time
from drake_srg.simulation.flat import MakeRoot
from drake_srg.simulation.recorders import AddRosbagRecorder, recorded_topics
from drake_srg.simulation.sleeping import Advance, MakeAdvance
from drake_srg.types import Vector

_STATUS_PERIOD = 0.5  # time between status reports [s, real]

# Makes the bridges, given the inbox for their commands and the topics to publish.
Connect = Callable[[CommandInbox, Sequence[Topic]], Sequence[Bridge]]


@dc.dataclass(frozen=True)
class Served:
    """The result of serving a station."""

    sim_time: float  # s
    wall_time: float  # s
    commands: int  # messages received, good and bad
    recording: Path | None = None
    replay: Path | None = None


def control_period(scenario: Scenario) -> float:
    """Return the time between reads of the inbox [s]: the arm driver's period."""
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

    The scenario's task, planner, script and disturbances are left out: they are up to
    the clients. A scenario with a soft object has no camera topics. Pictures come from
    a process that imports the caller's main module, so a script needs
    `if __name__ == "__main__":`.

    Args:
        scenario: The scenario to serve.
        connect: Makes the bridges.
        name: The scenario's name, for messages.
        rate: Simulated seconds per real second; 0 means as fast as possible, as in
            Drake.
        out: Folder for recording.mcap and replay.html; None records nothing.
        stop: Ends the run when set, by any thread or by a signal handler.
        tell: Called with warnings for the user, from any thread.
        report: Called with a status line at the start and twice a second.

    Raises:
        ScenarioError: If the models do not fit the scenario, a bridge needs ports that
            the station lacks, or Drake fails during the run. The recording is then
            complete up to the failure.
        OSError: If `out` cannot be written, or a bridge's address is in use.
        ValueError: If a bridge gets an invalid address.
        ImportError: If a bridge's packages are missing.
    """
    stop = stop or threading.Event()
    warnings = Warnings(tell)
    failure: ScenarioError | None = None
    recording: Path | None = None
    replay: ServedReplay | None = None
    with contextlib.ExitStack() as stack:
        builder, station = MakeRoot(
            "served_station", MakeServedStation, AddServedStation, scenario, name
        )
        with scenario_errors(name):
            stack.enter_context(output_folder(out))
            if out is not None:
                bag = AddRosbagRecorder(builder, station, scenario, out)
                recording = stack.enter_context(bag).path
            joints = () if scenario.gripper is None else scenario.gripper.joint_names
            plant = station.GetSubsystemByName("station").GetSubsystemByName("plant")
            inputs = input_ports(station)
            commands = station_topics(plant, inputs, joints)
            commands += trajectory_topics(plant, inputs, control_period(scenario))
            inbox = CommandInbox(commands + safety_topics(inputs), warnings)
            topics = recorded_topics(station, scenario)
            root = builder.Build()
            simulator = Simulator(root)
            ApplySimulatorConfig(scenario.simulator_config, simulator)
            simulator.set_target_realtime_rate(0.0)  # the Pacer sets the pace
            _fix_defaults(station, my_context(station, simulator.get_mutable_context()))
            simulator.Initialize()
            advance = MakeAdvance(simulator, station, scenario)
            if out is not None and scenario.arm is not None:
                replay = ServedReplay(name, scenario, root, station)
        pictures = Pictures(scenario, warnings)
        outlet = Outlet(connect(inbox, [*topics, *pictures.topics.values()]), warnings)
        for bridge in outlet.bridges:
            stack.callback(bridge.close)
        stack.callback(pictures.close)
        _check_ports(name, outlet.bridges, station)
        start = wall.monotonic()
        try:
            _run(
                _Loop(
                    name,
                    simulator,
                    advance,
                    station,
                    topics,
                    pictures,
                    inbox,
                    outlet,
                    replay,
                ),
                control_period(scenario),
                name,
                rate,
                stop,
                report,
            )
        except ScenarioError as error:
            failure = error
        elapsed = wall.monotonic() - start
    page = None if out is None or replay is None else replay.write(out)
    if failure is not None:
        raise failure
    time = simulator.get_context().get_time()
    return Served(time, elapsed, inbox.received, recording, page)


def _check_ports(name: str, bridges: Sequence[Bridge], station: Diagram) -> None:
    wanted = {port for bridge in bridges for port in bridge.ports}
    outputs = output_ports(station)
    missing = sorted(wanted - outputs.keys())
    if missing:
        raise ScenarioError(
            f"{name}: the station has no {', '.join(missing)}; "
            f"it has {', '.join(outputs)}"
        )


def _fix_defaults(station: Diagram, context: Context) -> None:
    """Open the gripper until somebody commands it: these ports need a value."""
    for name in ("gripper.closure_commanded", "gripper.closure_messages"):
        if station.HasInputPort(name):
            station.GetInputPort(name).FixValue(context, [0.0])


class _Loop:
    """Advances a served station: commands in, one control period, messages out."""

    def __init__(
        self,
        name: str,
        simulator: Simulator,
        advance: Advance,
        station: Diagram,
        topics: Sequence[Topic],
        pictures: Pictures,
        inbox: CommandInbox,
        outlet: Outlet,
        replay: ServedReplay | None,
    ) -> None:
        self._replay = replay
        self._name, self._simulator, self._advance = name, simulator, advance
        self.inbox, self.outlet = inbox, outlet
        self._topics, self._pictures = topics, pictures
        self._root = simulator.get_mutable_context()
        self._station = station
        self._context = my_context(station, self._root)
        self._ports = output_ports(station)
        self._gate = SafetyGate(station, inbox.warnings)
        # The integrator of a continuous plant chooses its own steps: there, a control
        # period counts as one.
        self._plant = station.GetSubsystemByName("station").GetSubsystemByName("plant")
        self._plant_step = self._plant.time_step() or math.inf
        self._wanted = sorted({name for b in outlet.bridges for name in b.ports})

    def advance(self, until: float) -> None:
        """Apply the commands, advance to a time [s] and publish.

        Messages go out after the plant's first step, which already shows the effect of
        the commands. The remaining steps of the control period take real time, for
        which clients would otherwise wait.
        """
        for name, value in self._gate.admit(self.inbox.take(), self._context).items():
            self._station.GetInputPort(name).FixValue(self._context, value)
        time = min(self._root.get_time() + self._plant_step, until)
        self._advance_to(time)
        values = {name: self._value(name) for name in self._wanted}
        self.outlet.update(time, values)
        for topic in self._topics:
            if self.outlet.has_subscribers(topic.name):
                payload = [self._value(name) for name in topic.ports]
                self.outlet.send(topic, time, payload)
        self._pictures.look(time, self._plant_state, self.outlet)
        if time < until:  # CENIC takes no step of zero length
            self._advance_to(until)
        if self._replay is not None:
            self._replay.sample(self._root)

    def _advance_to(self, time: float) -> None:
        with failure_time(self._name, self._simulator):
            self._advance(time)

    def _plant_state(self) -> Vector:
        context = self._plant.GetMyContextFromRoot(self._root)
        return np.array(self._plant.get_state_output_port().Eval(context))

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
    """Advance one control period at a time until `stop` or until no bridge is open."""
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
                f"this machine cannot keep {rate:g} x real time with {name} (it does "
                f"{pacer.too_slow:.2f} x): lower --rate or choose a faster scenario",
            )
