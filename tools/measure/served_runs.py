"""One run through a wire: our planner on one side, our served cell on the other.

`drake-srg serve` runs the cell in one process, and `drake-srg run --hardware` does its
task from another. The judge is the served cell's log, which the planner's side never
sees.
"""

from __future__ import annotations

import dataclasses as dc
import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.log_format import MODES, row_to_pose
from drake_srg.experiments.bridge_client import ServedProcess, free_port, open_wire
from drake_srg.experiments.servo_runs import rounding
from drake_srg.recording.output import read_log
from drake_srg.robot.serve.dynamixel.servo import JOINT
from drake_srg.robot.serve.loop import LONGEST
from drake_srg.scenario import Scenario, load_scenario, servo_of
from drake_srg.station.planners import final_pose
from drake_srg.types import Mode

_PATIENCE = 1200.0  # longest run [s, real]
# Longest silence of the emulated servos [s, real]. They share the processors with
# everything else, so late replies are likely, and a socket loses none.
_SILENCE = 0.04
# Positions of the SRG's servo at closures 0 and 1 [counts], and how far its wires
# stretch; see docs/hardware.md.
_SRG = {"open": 3298, "closed": 1043, "stretch": 1354}


@dc.dataclass(frozen=True)
class Case:
    """What is served, and what lies between it and the planner.

    Attributes:
        scenario: Its name.
        wire: "ROS 1" or "ROS 2".
        servos: What is on a servo bus in place of ROS: "", "gripper" or "all".
        stream: Of the arm's commands, as in a hardware file.
        lead: How far ahead commands are sent [s]; it must exceed the way there and
            back.
        watchdog: Of the safety monitor [s].
        latency: Added in both directions [s].
        loss: Share of the messages lost in both directions.
        camera_period: Between pictures [s].
        settings: Of the scenario on both sides, `KEY=VALUE` each.
        rate: Seconds of both sides per real second.
    """

    scenario: str
    wire: str = "ROS 2"
    servos: str = ""
    stream: str = "trajectory"
    lead: float = 0.05
    watchdog: float = 0.05
    latency: float = 0.0
    loss: float = 0.0
    camera_period: float = 0.1
    settings: tuple[str, ...] = ()
    rate: float = 1.0


@dc.dataclass(frozen=True)
class ServedRun:
    """The outcome of a run.

    Attributes:
        placed: Whether the object is where it must be.
        claimed: Whether the planner says so.
        told: Why it did not; empty if it did.
        error: Larger of the object's distances from its goal in x and y [m].
        rounding: By how much whole counts of the joints' servos may move the object in
            x or y where it is let go [m]; 0 without such servos.
        cycle: Duration of the task by the planner [s]; 0 if it was not done.
        held_up: How long the control loop was held up in all [s].
    """

    placed: bool
    claimed: bool
    told: str
    error: float
    rounding: float
    cycle: float
    held_up: float


def run_served(case: Case, seed: int, rate: float = 1.0) -> ServedRun:
    """Serve a cell, do its task from another process, and judge where the object is.

    Args:
        case: What is served, and how.
        seed: Of the scenario and of the losses.
        rate: Times the case's own.
    """
    rate *= case.rate
    scenario = load_scenario(case.scenario, seed=seed, overrides=case.settings)
    with TemporaryDirectory() as folder, open_wire(case.wire, "hardware_loop") as wire:
        served, ran = Path(folder, "served"), Path(folder, "ran")
        common = [case.scenario, "--seed", str(seed)]
        common += [word for each in case.settings for word in ("--set", each)]
        serving = [*common, *wire.arguments, "--rate", str(rate), "--out", str(served)]
        serving += ["--camera-period", str(case.camera_period)]
        port = free_port()
        if case.servos:
            serving += ["--servo", f"tcp:{port}"]
        if case.servos != "all":
            serving += ["--set", "arm.limits=null"]
        station = ServedProcess(*serving)
        try:
            file = Path(folder, "robot.yaml")
            file.write_text(robot_file(case, scenario, wire.arguments, port, rate))
            command = [sys.executable, "-m", "drake_srg", "run", *common, "--json"]
            command += ["--hardware", str(file), "--out", str(ran)]
            command += ["--set", f"safety={{watchdog: {case.watchdog}}}"]
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=_PATIENCE, check=False
            )
        finally:
            station.stop()
        return _judge(case, scenario, json.loads(done.stdout), served, ran, rate)


def _judge(
    case: Case,
    scenario: Scenario,
    answer: dict[str, Any],
    served: Path,
    ran: Path,
    rate: float,
) -> ServedRun:
    log = read_log(served / "log.npz")
    if log["time"][-1] > LONGEST - 1.0:
        raise ScenarioError(f"the served cell's log ends at {LONGEST:g} s")
    poses = log[f"object_pose.{scenario.task.pick}"]
    goal = final_pose(scenario, row_to_pose(poses[0])).translation()
    off = poses[-1, :3] - goal
    stops = [stop["reason"] for stop in answer.get("safety_stops") or ()]
    told = [*stops, answer.get("failure") or answer.get("error") or ""]
    counts = 0.0
    if case.servos == "all" and (ran / "log.npz").exists():
        log = read_log(ran / "log.npz")
        released = np.flatnonzero(log["mode"] == MODES.index(Mode.RELEASE))
        if len(released):
            state = log["arm.state_measured"][released[0]]
            counts = rounding(scenario, state[: state.size // 2], poses[-1, :3])
    return ServedRun(
        placed=bool(np.linalg.norm(off) <= scenario.task.place.tolerance),
        claimed=bool(answer.get("claimed")),
        told=", ".join(dict.fromkeys(filter(None, told))),
        error=float(np.max(np.abs(off[:2]))),
        rounding=counts,
        cycle=answer.get("cycle_time_s") or 0.0,
        held_up=(answer.get("wall_time_s") or 0.0) * rate
        - (answer.get("sim_time_s") or 0.0),
    )


def robot_file(
    case: Case, scenario: Scenario, arguments: Sequence[str], port: int, rate: float
) -> str:
    """Return the text of the hardware file for a served cell.

    Args:
        case: How it is served.
        scenario: That is served.
        arguments: Of `drake-srg serve` for the wire.
        port: Of the servo bus.
        rate: Seconds of both sides per real second.
    """
    ros = "Ros1" if case.wire == "ROS 1" else "Ros2"
    bus: dict[str, Any] = {"port": f"tcp:127.0.0.1:{port}", "timeout": _SILENCE}
    arm = f"!{ros}Arm {{lead: {case.lead}, stream: {case.stream}}}"
    gripper = f"!{ros}Gripper {{}}"
    if case.servos == "gripper":
        gripper = f"!DynamixelGripper {bus | {'id': 1} | _SRG}"
    elif case.servos == "all":
        assert scenario.arm is not None
        assert scenario.gripper is not None
        travel, _ = scenario.gripper.empty_hand(1.0)
        closed = round(JOINT.to_counts(-travel))
        ends = {"id": len(scenario.arm.home) + 1, "open": JOINT.zero, "closed": closed}
        arm, gripper = f"!DynamixelArm {bus}", f"!DynamixelGripper {bus | ends}"
    text = f"arm: {arm}\ngripper: {gripper}\ncameras:\n  ceiling: !{ros}Camera {{}}\n"
    servo = servo_of(scenario)
    if servo is not None:
        hand = servo.camera
        text += (
            f"  {hand}: !{ros}Camera\n"
            f"    color: /camera_{hand}/color/image_raw\n"
            f"    depth: /camera_{hand}/depth/image_raw\n"
            f"    info: /camera_{hand}/color/camera_info\n"
        )
    keys = {"--master": "master", "--domain": "domain"}
    given = zip(arguments[1::2], arguments[2::2], strict=True)
    node = {keys[key]: yaml.safe_load(value) for key, value in given}
    faults = {"latency": case.latency, "loss": case.loss, "seed": scenario.random_seed}
    rest = {ros.lower(): node, "faults": faults, "rate": rate, "patience": 120.0}
    return text + yaml.safe_dump(rest)
