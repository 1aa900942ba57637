"""Runs a twin beside a robot, and records it."""

from __future__ import annotations

import contextlib
import dataclasses as dc
import json
import threading
import time as wall
from collections.abc import Callable
from pathlib import Path

from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.common.real_time import real_time_loop
from drake_srg.recording.output import OutputFile, output_folder
from drake_srg.recording.rosbag import Topic, float64_array
from drake_srg.robot.drive.config import HardwareConfig
from drake_srg.robot.drive.opening import MakeRobots, check_arms
from drake_srg.robot.serve.commands import Warnings
from drake_srg.robot.serve.loop import ServedReplay
from drake_srg.robot.twin.comparison import KINDS
from drake_srg.robot.twin.loop import (
    TORQUE_UNITS,
    Listener,
    Parting,
    Told,
    TwinLoop,
)
from drake_srg.robot.twin.station import AddTwin, MakeTwin
from drake_srg.scenario import Scenario, robot_arms
from drake_srg.simulation.flat import MakeRoot
from drake_srg.simulation.recorders import FILES, AddRosbagRecorder

_POLL = 0.002  # time between looks for messages [s, real]
_STATUS_PERIOD = 0.5  # time between status reports [s, real]


@dc.dataclass(frozen=True)
class TwinResult:
    """The result of a twin, for metrics.json.

    Attributes:
        ended: Why the twin ended: "stopped" by the user, or the robot was "silent".
        partings: All reports of differences.
        largest: Largest difference of each of `KINDS`.
        sim_time_s: Time by the robot's clock [s].
        wall_time_s: Real time [s].
    """

    scenario: str
    seed: int
    ended: str
    partings: tuple[Parting, ...]
    largest: dict[str, float]
    sim_time_s: float
    wall_time_s: float
    artifacts: dict[str, str]

    def write(self, path: Path) -> None:
        """Write the result as JSON.

        Raises:
            OSError: If the file cannot be written.
        """
        output = OutputFile(path)
        text = json.dumps(dc.asdict(self), indent=2, default=str) + "\n"
        output.path.write_text(text, encoding="utf-8")
        output.commit()


def run_twin(
    scenario: Scenario,
    config: HardwareConfig,
    *,
    name: str = "scenario",
    out: Path | None = None,
    stop: threading.Event | None = None,
    tell: Callable[[str], None] = print,
    report: Callable[[str], None] = lambda _: None,
) -> TwinResult:
    """Follow a robot with a twin until it falls silent or the user stops.

    The twin only listens. It never sends anything to the robot.

    Args:
        scenario: The twin's scenario.
        config: The drivers, for the robot's topics.
        name: The scenario's name, for messages.
        out: Folder for the results; None: write nothing.
        stop: Ends the twin when set, by any thread or by a signal handler.
        tell: Called with warnings for the user, from any thread.
        report: Called with a status line twice a second.

    Raises:
        ScenarioError: If the scenario does not fit, nothing arrives at the start, or
            Drake fails. The recording is then complete up to the failure.
        OSError: If `out` cannot be written, or an address is in use.
        ImportError: If a package is missing.
    """
    stop = stop or threading.Event()
    warnings = Warnings(tell)
    artifacts: dict[str, str] = {}
    with contextlib.ExitStack() as stack:
        builder, twin = MakeRoot("twin", MakeTwin, AddTwin, scenario, name)
        with scenario_errors(name):
            check_arms(scenario, config)
            stack.enter_context(output_folder(out))
            if out is not None:
                for file in (*FILES.values(), "metrics.json"):
                    (out / file).unlink(missing_ok=True)
                more = twin_topics(scenario)
                bag = AddRosbagRecorder(builder, twin, scenario, out, more)
                artifacts["recording"] = str(stack.enter_context(bag).path)
            root = builder.Build()
            robots = MakeRobots(scenario, config, warnings, "_twin")
            nodes = robots[0].nodes
            listener = Listener(config, scenario.twin, *robots)
            stack.callback(nodes.close)
            nodes.open()
            first = _first(listener, config.patience, stop)
            loop = TwinLoop(name, scenario, root, twin, first)
            replay = None
            if out is not None:
                replay = ServedReplay(name, scenario, root, twin)
        start = wall.monotonic()
        try:
            with real_time_loop():
                ended = _run(loop, listener, scenario, replay, stop, warnings, report)
        finally:
            page = None if out is None or replay is None else replay.write(out)
    if out is not None and page is not None:
        artifacts["replay"] = str(page)
        artifacts |= {kind: str(out / FILES[kind]) for kind in ("log", "timeline")}
    result = TwinResult(
        name,
        scenario.random_seed,
        ended,
        tuple(loop.partings),
        dict(zip(KINDS, loop.largest.tolist(), strict=True)),
        loop.time,
        wall.monotonic() - start,
        artifacts,
    )
    if out is not None:
        result.write(out / "metrics.json")
    return result


def twin_topics(scenario: Scenario) -> list[Topic]:
    """Return the topics to record for a twin, besides those of its station."""
    n = sum(len(own.arm.home) for own in robot_arms(scenario) if own.arm)
    sizes = {
        "difference": len(KINDS),
        "parted": len(KINDS),
        "joint_error": n,
        "torque_expected": n,
        "torque_residual": n,
    }
    return [float64_array(f"/twin/{k}", f"twin.{k}", size) for k, size in sizes.items()]


def _first(listener: Listener, patience: float, stop: threading.Event) -> Told:
    """Return the robot's first messages.

    Raises:
        ScenarioError: If none arrive in time.
    """
    end = wall.monotonic() + patience
    while (told := listener.take()) is None:
        if stop.wait(_POLL):
            raise ScenarioError("twin: stopped before anything arrived")
        if wall.monotonic() > end:
            raise ScenarioError(
                f"twin: no joint states of the arm within {patience:g} s: does the "
                "robot run, and are the topics, the domain and the joints' names right?"
            )
    return told


def _run(
    loop: TwinLoop,
    listener: Listener,
    scenario: Scenario,
    replay: ServedReplay | None,
    stop: threading.Event,
    warnings: Warnings,
    report: Callable[[str], None],
) -> str:
    """Follow the robot until the end; return why it ended."""
    silence, reported = scenario.twin.silence, -float("inf")
    while not stop.is_set():
        told = listener.take()
        if told is None:
            if wall.monotonic() - listener.heard_at > silence:
                return "silent"
            stop.wait(_POLL)
        else:
            for parting in loop.follow(told):
                warnings.warn(parting.text, parting.text)
            if replay is not None:
                replay.sample(loop.context)
            if loop.skipped > 0.0:
                warnings.warn(
                    "skipped",
                    f"messages were more than {silence:g} s apart: the robot's clock "
                    "has been set, or this machine is too slow for the twin",
                )
        if wall.monotonic() - reported >= _STATUS_PERIOD:
            reported = wall.monotonic()
            report(status_text(loop))
    return "stopped"


def status_text(loop: TwinLoop) -> str:
    """Return the present state of the twin, in one line."""
    joint, torque, finger, thing = loop.value("twin.difference")
    force = loop.force
    expected = float(abs(loop.value("twin.torque_expected")).max())
    units = list(dict.fromkeys(loop.joint_units))
    length, effort = " or ".join(units), " or ".join(TORQUE_UNITS[u] for u in units)
    return (
        f"twin: {loop.time:.1f} s, joints {joint:.3f} {length}, "
        f"fingers {finger:.3f} rad, objects {1e3 * thing:.0f} mm, "
        f"torque {torque:.1%} of its limit; expects {force:.0f} N at the fingers, "
        f"{expected:.0f} {effort} at the arm"
    )
