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

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraInfo

from drake_srg.bridges.bridge import Bridge
from drake_srg.bridges.camera_process import CameraProcess
from drake_srg.bridges.commands import CommandInbox, Warnings, station_topics
from drake_srg.bridges.pacing import Pacer
from drake_srg.bridges.served_station import AddServedStation
from drake_srg.bridges.topics import camera_topics
from drake_srg.errors import ScenarioError, scenario_errors
from drake_srg.ports import Ports, output_ports
from drake_srg.recorders import AddRosbagRecorder, recorded_topics
from drake_srg.recording.output import output_folder
from drake_srg.recording.ros_topics import Topic
from drake_srg.scenario import Scenario
from drake_srg.simulation import failure_time
from drake_srg.types import Vector

# Time between pictures [s, simulated]; rendering decides how many there really are.
_CAMERA_PERIOD = 0.1
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
                recording.unlink(missing_ok=True)  # what is there then is of this run
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
        camera = served_camera(scenario)
        pictures = {} if camera is None else camera_topics(*camera)
        bridges = connect(inbox, [*topics, *pictures.values()])
        for bridge in bridges:
            stack.callback(bridge.close)
        _check_ports(name, bridges, station)
        outlet = _Outlet(simulator, topics, bridges)
        if camera is not None:
            cameras = CameraProcess(
                scenario,
                camera[0],
                outlet.plant_state(),
                show=lambda time, topic, values: outlet.send(
                    pictures[topic], time, values
                ),
                failed=lambda: warnings.warn(
                    "cameras", "the cameras' process has ended: no pictures any more"
                ),
            )
            stack.callback(cameras.close)
            outlet.cameras, outlet.pictures = cameras, list(pictures)
        start = wall.monotonic()
        try:
            _run(simulator, scenario, name, rate, inbox, outlet, stop, report)
        except ScenarioError as error:
            failure = error
        elapsed = wall.monotonic() - start
    if failure is not None:
        raise failure
    time = simulator.get_context().get_time()
    return Served(time, elapsed, inbox.received, recording)


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


class _Outlet:
    """What goes from the station to the bridges."""

    cameras: CameraProcess | None = None
    pictures: Sequence[str] = ()

    def __init__(
        self, simulator: Simulator, topics: Sequence[Topic], bridges: Sequence[Bridge]
    ) -> None:
        self.bridges = bridges
        self._topics = topics
        self._context = simulator.get_context()
        self._ports = output_ports(simulator.get_system())
        self._wanted = sorted({name for bridge in bridges for name in bridge.ports})
        self._next_picture = 0.0

    def plant_state(self) -> Vector:
        """The plant's [q; v] now."""
        return np.array(self._ports["plant.state"].Eval(self._context))

    def tell(self, time: float) -> None:
        """Send what the station is like at `time`, now."""
        values = {name: self._ports[name].Eval(self._context) for name in self._wanted}
        for bridge in self.bridges:
            bridge.update(time, {name: values[name] for name in bridge.ports})
        for topic in self._topics:
            if self._has_subscribers(topic.name):
                ports = (self._ports.get(name) for name in topic.ports)
                self.send(topic, time, [p and p.Eval(self._context) for p in ports])
        if self.cameras and self.cameras.idle and time >= self._next_picture:
            wanted = [name for name in self.pictures if self._has_subscribers(name)]
            if wanted:
                self.cameras.look(time, self.plant_state(), wanted)
                self._next_picture = time + _CAMERA_PERIOD

    def send(self, topic: Topic, time: float, values: Sequence[Any]) -> None:
        """Send a message to whom it may concern."""
        for bridge in self.bridges:
            if bridge.has_subscribers(topic.name):
                bridge.publish(topic, time, values)

    def _has_subscribers(self, topic: str) -> bool:
        return any(bridge.has_subscribers(topic) for bridge in self.bridges)


def _run(
    simulator: Simulator,
    scenario: Scenario,
    name: str,
    rate: float,
    inbox: CommandInbox,
    outlet: _Outlet,
    stop: threading.Event,
    report: Callable[[str], None],
) -> None:
    """Step from look to look at the inbox until it is stopped."""
    diagram, context = simulator.get_system(), simulator.get_mutable_context()
    period = control_period(scenario)
    pacer = Pacer(rate or math.inf, stop)
    addresses = ", ".join(bridge.status for bridge in outlet.bridges)
    step, reported = 0, -math.inf
    while not stop.is_set():
        if wall.monotonic() - reported >= _STATUS_PERIOD:
            reported = wall.monotonic()
            report(
                f"{name}: {addresses}; {step * period:.1f} s at {pacer.factor:.2f} x "
                f"real time, {inbox.received} commands"
            )
        for port, value in inbox.take().items():
            diagram.GetInputPort(port).FixValue(context, value)
        step += 1
        with failure_time(name, simulator):
            simulator.AdvanceTo(step * period)
        outlet.tell(step * period)
        pacer.wait(step * period)
        if pacer.lost:
            inbox.warnings.warn(
                "pace",
                f"this machine cannot keep {rate:g} x real time with {name}, it does "
                f"{pacer.factor:.2f}; ask for less by --rate, or for a faster scenario",
            )
