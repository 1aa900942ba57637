"""Run a station in real time under the commands of external clients."""

from __future__ import annotations

import contextlib
import dataclasses as dc
import math
import threading
import time as wall
from collections.abc import Callable, Sequence
from pathlib import Path

from pydrake.systems.framework import Diagram

from drake_srg.bridges.bridge import Bridge
from drake_srg.bridges.commands import CommandInbox, Warnings
from drake_srg.bridges.outlet import Outlet
from drake_srg.bridges.pacing import Pacer
from drake_srg.bridges.pictures import PERIOD, Pictures
from drake_srg.bridges.served_loop import (
    MakeActionServer,
    ServedLoop,
    control_period,
    fix_defaults,
    station_inbox,
)
from drake_srg.bridges.served_replay import ServedReplay
from drake_srg.bridges.served_station import AddServedStation, MakeServedStation
from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.common.ports import output_ports
from drake_srg.common.real_time import real_time_loop
from drake_srg.common.simulator import MakeSimulator
from drake_srg.lifetime import my_context
from drake_srg.recording.output import output_folder
from drake_srg.recording.ros_topics import Topic
from drake_srg.scenario import Scenario
from drake_srg.simulation.flat import MakeRoot
from drake_srg.simulation.recorders import AddRosbagRecorder, recorded_topics
from drake_srg.station.sleeping import MakeAdvance

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


def Serve(
    scenario: Scenario,
    connect: Connect,
    *,
    name: str = "scenario",
    rate: float = 1.0,
    camera_period: float = PERIOD,
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
        camera_period: Shortest time between pictures, except those of a visual servo's
            camera [s, simulated].
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
            actions = MakeActionServer(scenario, station)
            requests, replies = ([], []) if actions is None else actions.topics
            inbox = station_inbox(scenario, station, warnings, requests)
            topics = recorded_topics(station, scenario)
            root = builder.Build()
            simulator = MakeSimulator(root, scenario.simulator_config)
            simulator.set_target_realtime_rate(0.0)  # the Pacer sets the pace
            fix_defaults(station, my_context(station, simulator.get_mutable_context()))
            simulator.Initialize()
            advance = MakeAdvance(simulator, station, scenario)
            if out is not None and scenario.arm is not None:
                replay = ServedReplay(name, scenario, root, station)
        pictures = Pictures(scenario, warnings, camera_period)
        published = [*topics, *pictures.topics.values(), *replies]
        outlet = Outlet(connect(inbox, published), warnings)
        if actions is not None:
            actions.connect(inbox, outlet)
        for bridge in outlet.bridges:
            stack.callback(bridge.close)
        stack.callback(pictures.close)
        _check_ports(name, outlet.bridges, station)
        start = wall.monotonic()
        loop = ServedLoop(
            name,
            simulator,
            advance,
            station,
            topics,
            pictures,
            inbox,
            outlet,
            replay,
            actions,
        )
        try:
            with real_time_loop():
                _run(loop, control_period(scenario), name, rate, stop, report)
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


def _run(
    loop: ServedLoop,
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
