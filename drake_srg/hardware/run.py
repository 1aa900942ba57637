"""Run a scenario's task on hardware, and record it."""

from __future__ import annotations

import contextlib
import dataclasses as dc
import threading
import time as wall
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from pydrake.systems.framework import DiagramBuilder

from drake_srg.bridges.commands import CommandInbox, Warnings
from drake_srg.bridges.keyboard import KeyboardBridge
from drake_srg.bridges.pacing import Pacer
from drake_srg.bridges.safety_commands import safety_topics
from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.common.real_time import real_time_loop
from drake_srg.common.status_line import StatusLine
from drake_srg.hardware.cell import MakeHardwareCell, measurements
from drake_srg.hardware.config import HardwareConfig
from drake_srg.hardware.link import STAMP
from drake_srg.hardware.loop import ControlLoop
from drake_srg.hardware.opening import Hardware, open_hardware
from drake_srg.hardware.planner_process import PlannerProcess
from drake_srg.hardware.station import MakeHardwareStation
from drake_srg.recording.log import write_log
from drake_srg.recording.output import output_folder
from drake_srg.recording.run_timeline import run_timeline
from drake_srg.recording.timeline import draw_timeline
from drake_srg.scenario import Scenario, servo_of
from drake_srg.simulation.metrics import Metrics, RunTimes, calc_metrics
from drake_srg.simulation.recorders import FILES, AddRosbagRecorder, run_labels
from drake_srg.simulation.simulate import Result
from drake_srg.types import Mode, Vector

# How far from home the arm may be at the start [rad or m].
_HOME = 0.05
# A lag of the control loop up to this is caught up with [s].
_CATCH_UP = 0.02
# Topics that command the safety monitor.
_COMMANDS = ("estop", "release")
# Longest time for a plan, and until the planner is ready once its cameras are [s].
_PLANNING = 60.0


def run_on_hardware(
    scenario: Scenario,
    config: HardwareConfig,
    *,
    name: str = "scenario",
    out: Path | None = None,
    record: bool = True,
    progress: bool = False,
    stop: threading.Event | None = None,
    tell: Callable[[str], None] = print,
    terminal: int | None = None,
) -> Result:
    """Do a scenario's task on hardware, in real time.

    The control loop (measurements, safety monitor, commands) and the planner run in two
    processes; see `planner_process`. The files are those of `Simulate`, but for video
    and replay. Nobody knows where the objects are: `metrics.claimed` is the planner's
    word.

    A safety stop ends the run, unless the hardware file lets it wait for a release.
    Topics (/estop, /release) and keys (e, r) command the monitor. Disturbances are left
    out.

    Args:
        scenario: To run.
        config: Of the drivers.
        name: The scenario's name, for metrics.json and messages.
        out: Folder for the results; None writes nothing.
        record: Whether to write rosbag and timeline too.
        progress: Whether to show progress on standard error.
        stop: Stops the arm when set, by any thread or by a signal handler.
        tell: Called with warnings for the user, from any thread.
        terminal: Descriptor of a terminal whose keys are commands; None: no keys.

    Raises:
        ScenarioError: If the scenario does not fit the hardware, the arm is not at
            home, or nothing arrives at the start.
        OSError: If `out` cannot be written, or an address is in use.
        ImportError: If a driver's packages are missing.
    """
    stop = stop or threading.Event()
    warnings = Warnings(tell)
    scenario = dc.replace(scenario, disturbances=[])
    inbox = CommandInbox(safety_topics(["safety.estop"], _COMMANDS), warnings)
    with contextlib.ExitStack() as stack:
        stack.enter_context(output_folder(out))
        if out is not None:
            for file in (*FILES.values(), "metrics.json"):
                (out / file).unlink(missing_ok=True)
        with scenario_errors(name):
            hardware = stack.enter_context(
                open_hardware(
                    scenario, config, warnings, inbox=inbox, stopped=stop.is_set
                )
            )
            _check_home(scenario, hardware)
            check_servo(scenario, config, hardware)
            station = MakeHardwareStation(scenario, hardware)
            planner = stack.enter_context(
                contextlib.closing(
                    PlannerProcess(
                        scenario,
                        config,
                        measurements(station),
                        hardware.start,
                        warnings,
                    )
                )
            )
            builder = DiagramBuilder()
            cell = builder.AddNamedSystem(
                "cell",
                MakeHardwareCell(scenario, station, planner, _PLANNING, hardware.lag),
            )
            if out is not None and record:
                stack.enter_context(AddRosbagRecorder(builder, cell, scenario, out))
            loop = ControlLoop(name, scenario, builder.Build(), cell, config.release)
            planner.wait(_PLANNING + config.patience, stop.is_set)
            if terminal is not None:
                keys = KeyboardBridge(inbox, terminal)
                stack.callback(keys.close)
        try:
            with real_time_loop():
                elapsed = _run(loop, inbox, name, config.rate, stop, progress)
        finally:
            log = loop.log.arrays() if loop.log else {}
            written = _write(out, log, scenario, name, record)
    times = RunTimes(loop.time, elapsed, planner.planning_wall)
    metrics = _metrics(scenario, name, loop, log, times, written)
    if out is not None:
        metrics.write(out / "metrics.json")
    return Result(metrics, log, loop.status)


def _check_home(scenario: Scenario, hardware: Hardware) -> None:
    """Raise a ScenarioError unless the arm is where the planner begins."""
    assert scenario.arm is not None
    home = np.array(scenario.arm.home)
    away = np.abs(hardware.start["arm.state_measured"][: len(home)] - home)
    if away.max() > _HOME:
        worst = int(np.argmax(away))
        raise ScenarioError(
            f"arm.home: the arm must start there, but joint {worst + 1} is "
            f"{away[worst]:.3f} rad away (allowed: {_HOME})"
        )


def check_servo(scenario: Scenario, config: HardwareConfig, hardware: Hardware) -> None:
    """Raise a ScenarioError if a visual servo cannot work."""
    if servo_of(scenario) is None:
        return
    if config.release:
        raise ScenarioError(
            "release: must be 0 with planner: !Servoing, where a stop is final"
        )
    if STAMP not in hardware.start:
        raise ScenarioError(
            "planner: !Servoing needs an arm whose states have time stamps "
            "(allowed: !Ros1Arm, !Ros2Arm)"
        )


def _run(
    loop: ControlLoop,
    inbox: CommandInbox,
    name: str,
    rate: float,
    stop: threading.Event,
    progress: bool,
) -> float:
    """Advance in real time until the run has ended; return how long it took [s]."""
    start = wall.monotonic()
    never = threading.Event()  # the pacer goes on while the arm is being stopped
    pacer = Pacer(rate, never, patience=_CATCH_UP)
    goes_on = True
    with StatusLine(shown=progress) as line:
        while goes_on:
            if stop.is_set():
                loop.press_estop()
            goes_on = loop.advance(inbox.take())
            if goes_on and loop.waits:
                inbox.warnings.warn(
                    "stop",
                    f"the arm is stopped ({loop.waits}); it waits for a /release, or "
                    "the key r",
                )
            else:
                inbox.warnings.forget("stop")
            mode = loop.status.mode.value.replace("_", " ")
            line.show(f"{name}: {loop.time:6.2f} s, {mode}", last=not goes_on)
            pacer.wait(loop.time)
    if pacer.lost > 0.0:
        inbox.warnings.warn(
            "lost", f"the control loop was held up for {pacer.lost:.2f} s"
        )
    return wall.monotonic() - start


def _write(
    out: Path | None,
    log: Mapping[str, Vector],
    scenario: Scenario,
    name: str,
    record: bool,
) -> dict[str, str]:
    """Write log and timeline; return paths by kind."""
    if out is None or not log:
        return {}
    written = {"log": str(write_log(out / FILES["log"], log))}
    if record:
        timeline = run_timeline(log, run_labels(name, scenario))
        written["timeline"] = str(draw_timeline(timeline, out / FILES["timeline"]))
        written["recording"] = str(out / FILES["recording"])
    return written


def _metrics(
    scenario: Scenario,
    name: str,
    loop: ControlLoop,
    log: Mapping[str, Vector],
    times: RunTimes,
    written: Mapping[str, str],
) -> Metrics:
    """Return the metrics, as far as they can be told without ground truth."""
    status = loop.status
    metrics = calc_metrics(
        scenario,
        name,
        log,
        status,
        set(),
        times,
        {kind: written.get(kind) for kind in FILES},
    )
    return dc.replace(
        metrics,
        success=False,
        claimed=status.mode is Mode.DONE,
        failure=None if status.failure is None else status.failure.value,
    )
