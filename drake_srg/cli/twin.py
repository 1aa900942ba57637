"""The command `drake-srg twin`."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses as dc
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from drake_srg.cli.command import (
    SCENARIO,
    argument,
    command,
    flag,
    folder,
    load,
    ros,
    speaks_ros,
)
from drake_srg.cli.process import SUCCESS, TASK_FAILED, stop_on_signals, writing
from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.status_line import StatusLine

if TYPE_CHECKING:
    from drake_srg.hardware import HardwareConfig


@command(
    "follow a running robot with a simulated twin, and report where they differ",
    "It only listens. Exit code: 0 no difference, 1 at least one, 2 bad input.",
    SCENARIO,
    ros("listen to ROS 1", "listen to ROS 2", "the robot"),
    argument(
        "--hardware",
        type=Path,
        metavar="FILE.yaml",
        help="listen to the topics of this hardware file",
    ),
    folder("results (default: out/twin/SCENARIO)"),
    flag("--no-record", "write nothing"),
)
def twin(options: argparse.Namespace) -> int:
    """Follow a robot with a twin; return the exit code.

    Raises:
        ScenarioError: If the input is bad, or the robot cannot be reached.
    """
    output = options.console
    status = StatusLine(
        sys.stderr if output.json else sys.stdout, shown=output.progress, at_once=True
    )
    # Imported under the signal handlers, so that a signal ends the command cleanly.
    with stop_on_signals() as stop, contextlib.closing(status):
        from drake_srg.twin.run import run_twin

        config = _config(options)
        scenario = load(options)
        name = Path(options.scenario).stem
        out: Path = options.out or Path("out") / "twin" / name
        with writing("--out", out):
            result = run_twin(
                scenario,
                config,
                name=name,
                out=None if options.no_record else out,
                stop=stop,
                tell=lambda text: status.interrupt(f"drake-srg: warning: {text}"),
                report=status.show,
            )
    why = "stopped" if result.ended == "stopped" else "the robot is silent"
    count = len(result.partings)
    differences = f"{count} difference" + ("" if count == 1 else "s")
    output.say(f"{why} after {result.sim_time_s:.2f} s: {differences} reported")
    output.say(*result.artifacts.values())
    output.answer(dc.asdict(result))
    return TASK_FAILED if result.partings else SUCCESS


def _config(options: argparse.Namespace) -> HardwareConfig:
    """Return where the robot's topics are."""
    from drake_srg.bridges.connecting import Ros1Config, Ros2Config
    from drake_srg.hardware import HardwareConfig, load_hardware
    from drake_srg.hardware.arm import Ros1Arm, Ros2Arm
    from drake_srg.hardware.gripper import Ros1Gripper, Ros2Gripper

    ros1, ros2 = speaks_ros(options)
    if ros1 + ros2 + (options.hardware is not None) != 1:
        raise ScenarioError("twin: needs one of --ros1, --ros2 and --hardware")
    if options.hardware is not None:
        return load_hardware(options.hardware)
    if ros1:
        return HardwareConfig(
            arm=Ros1Arm(),
            gripper=Ros1Gripper(),
            ros1=Ros1Config(master=options.master or "", host=options.host),
        )
    return HardwareConfig(
        arm=Ros2Arm(),
        gripper=Ros2Gripper(),
        ros2=Ros2Config(domain=options.domain, host=options.host),
    )
