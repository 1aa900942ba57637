"""Pick and place through a wire: our planner on one side, our served cell on the other.

For each seed, `drake-srg serve` runs the cell in one process, and `drake-srg run
--hardware` does its task from another. The judge is the served cell's log, which the
planner's side never sees.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml

from drake_srg.cell.goals import final_pose
from drake_srg.experiments.bridge_client import ServedProcess, open_wire
from drake_srg.experiments.kept_trials import KeptTrials
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult, Row
from drake_srg.recording.figure import make_figure, style_axes
from drake_srg.recording.log import read_log
from drake_srg.scenario import load_scenario
from drake_srg.simulation.log_format import row_to_pose

_PATIENCE = 1200.0  # longest run [s, real]


def run(
    track: Track,
    *,
    scenario: str = "kitchen_fast",
    wire: str = "ROS 2",
    seeds: int = 3,
    seed: int = 0,
    latency: float = 0.0,
    loss: float = 0.0,
    rate: float = 0.25,
    watchdog: float = 0.05,
    lead: float = 0.05,
    stream: str = "trajectory",
    settings: Sequence[str] = (),
    keep: str = "",
) -> ExperimentResult:
    """Do the task of a scenario through a wire.

    Args:
        track: Shows progress.
        scenario: To serve and to run.
        wire: "ROS 1" or "ROS 2".
        seeds: How many runs.
        seed: The first one's.
        latency: Added in both directions [s].
        loss: Share of messages lost in both directions.
        rate: Seconds of both sides per real second, for a machine that is too slow.
        watchdog: Of the safety monitor [s].
        lead: How far ahead commands are sent [s]; it must exceed the way there and
            back.
        stream: Of the commands, as in a hardware file.
        settings: Of the scenario on both sides, `KEY=VALUE` each.
        keep: File of finished runs; with it, an experiment that was cut off goes on.
    """
    kept = KeptTrials(keep)
    setting = f"{scenario} {wire} {latency} {loss} {rate} {watchdog} {lead}"
    if stream != "trajectory":
        setting += f" {stream}"
    setting = " ".join([setting, *settings])
    results: list[dict[str, Any]] = []
    for number in track(range(seed, seed + seeds), label=lambda s: f"seed {s}"):
        faults = {"latency": latency, "loss": loss, "seed": number}

        def trial(number: int = number, faults: dict[str, Any] = faults) -> Any:
            return run_trial(
                scenario, wire, number, faults, rate, watchdog, lead, settings, stream
            )

        results.append(dict(kept(f"{setting} {number}", trial)))
    placed = [r for r in results if r["placed"]]
    errors = [r["error_m"] for r in placed]
    claimed = sum(bool(r["claimed"]) for r in results)
    wrong = sum(bool(r["claimed"]) and not r["placed"] for r in results)
    rows = [
        Row.info(setting, "placed", float(len(placed)), f"of {seeds}"),
        Row.info(setting, "claimed by the planner", float(claimed), f"of {seeds}"),
        Row.info(setting, "claimed wrongly", float(wrong), ""),
        Row.info(setting, "placement error, largest", max(errors, default=0.0), "m"),
        Row.info(
            setting,
            "time the loop was held up, sum",
            sum(r["lost_s"] for r in results),
            "s",
        ),
    ]
    columns = {key: [r[key] for r in results] for key in results[0]}
    return ExperimentResult(rows, {"hardware_loop": columns}, draw(results))


def draw(results: Sequence[Mapping[str, Any]]) -> Any:
    """Plot the distance of each run's object from its goal."""
    figure = make_figure(7.0, 2.6)
    axes = figure.subplots()
    axes.plot([r["seed"] for r in results], [1e3 * r["error_m"] for r in results], "o")
    axes.set_xticks([r["seed"] for r in results])
    axes.set_ylim(bottom=0.0)
    style_axes(axes, xlabel="seed", ylabel="distance from the goal [mm]")
    return figure


def run_trial(
    scenario: str,
    wire: str,
    seed: int,
    faults: dict[str, Any],
    rate: float,
    watchdog: float,
    lead: float,
    settings: Sequence[str] = (),
    stream: str = "trajectory",
) -> dict[str, Any]:
    """Serve a cell, do its task from another process, and judge where the object is.

    Args:
        scenario: Its name.
        wire: "ROS 1" or "ROS 2".
        seed: Of the scenario.
        faults: As in a hardware file.
        rate: Seconds of both sides per real second.
        watchdog: Of the safety monitor [s].
        lead: How far ahead commands are sent [s].
        settings: Of the scenario on both sides, `KEY=VALUE` each.
        stream: Of the commands, as in a hardware file.
    """
    loaded = load_scenario(scenario, seed=seed, overrides=settings)
    servoing = loaded.servoing
    hand = "" if servoing is None else servoing.camera
    with TemporaryDirectory() as folder, open_wire(wire, "hardware_loop") as opened:
        served, ran = Path(folder, "served"), Path(folder, "ran")
        common = [scenario, "--seed", str(seed)]
        common += [word for each in settings for word in ("--set", each)]
        station = ServedProcess(
            *common,
            *("--rate", str(rate), "--out", str(served), "--set", "arm.limits=null"),
            *opened.arguments,
        )
        try:
            file = Path(folder, "robot.yaml")
            file.write_text(
                robot_file(wire, opened.arguments, faults, rate, lead, hand, stream)
            )
            safety = f"safety={{watchdog: {watchdog}}}"
            command = [sys.executable, "-m", "drake_srg", "run", *common, "--json"]
            command += ["--hardware", str(file), "--out", str(ran), "--set", safety]
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=_PATIENCE, check=False
            )
        finally:
            station.stop()
        answer = json.loads(done.stdout)
        poses = read_log(served / "log.npz")[f"object_pose.{loaded.task.pick}"]
    goal = final_pose(loaded, row_to_pose(poses[0])).translation()
    error = float(np.linalg.norm(poses[-1, :3] - goal))
    return {
        "seed": seed,
        "claimed": bool(answer.get("claimed")),
        "failure": answer.get("failure") or answer.get("error") or "",
        "stops": ", ".join(stop["reason"] for stop in answer.get("safety_stops") or ()),
        "attempts": answer.get("attempts", 0),
        "placed": error <= loaded.task.place.tolerance,
        "error_m": error,
        "cycle_s": answer.get("cycle_time_s") or 0.0,
        "lost_s": (answer.get("wall_time_s") or 0.0) * rate
        - (answer.get("sim_time_s") or 0.0),
    }


def robot_file(
    wire: str,
    serve_arguments: Any,
    faults: dict[str, Any],
    rate: float,
    lead: float,
    hand: str = "",
    stream: str = "trajectory",
) -> str:
    """Return the text of the hardware file for a served cell.

    Args:
        wire: "ROS 1" or "ROS 2".
        serve_arguments: Of `drake-srg serve`.
        faults: As in a hardware file.
        rate: Seconds of both sides per real second.
        lead: How far ahead commands are sent [s].
        hand: Name of a visual servo's camera; "" without one.
        stream: Of the commands.
    """
    ros = "Ros1" if wire == "ROS 1" else "Ros2"
    node = {"--master": "master", "--domain": "domain"}
    given = dict(zip(serve_arguments[1::2], serve_arguments[2::2], strict=True))
    nodes = {node[key]: yaml.safe_load(value) for key, value in given.items()}
    rest = {ros.lower(): nodes, "faults": faults, "rate": rate, "patience": 120.0}
    tags = (
        f"arm: !{ros}Arm {{lead: {lead}, stream: {stream}}}\n"
        f"gripper: !{ros}Gripper {{}}\n"
        f"cameras:\n  ceiling: !{ros}Camera {{}}\n"
    )
    if hand:
        tags += (
            f"  {hand}: !{ros}Camera\n"
            f"    color: /camera_{hand}/color/image_raw\n"
            f"    depth: /camera_{hand}/depth/image_raw\n"
            f"    info: /camera_{hand}/color/camera_info\n"
        )
    return tags + yaml.safe_dump(rest)
