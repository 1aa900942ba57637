"""The commands serve and twin."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses as dc
import functools
import math
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

from drake_srg.cli.command import (
    SCENARIO,
    SUCCESS,
    TASK_FAILED,
    argument,
    command,
    flag,
    load,
    name_of,
    ros,
    speaks_ros,
    stop_on_signals,
)
from drake_srg.cli.results import (
    RUN,
    folder,
    results_folder,
)
from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.status_line import StatusLine

if TYPE_CHECKING:
    from drake_srg.robot.drive.config import HardwareConfig
    from drake_srg.robot.serve.connecting import BridgeOptions
    from drake_srg.robot.serve.loop import Served


def _rate(text: str) -> float:
    rate = _number(text)
    if not 0.0 <= rate < math.inf:
        raise argparse.ArgumentTypeError(f"must be a number of at least 0, got {text}")
    return rate


def _period(text: str) -> float:
    period = _number(text)
    if not 0.0 < period < math.inf:
        raise argparse.ArgumentTypeError(f"must be a positive number, got {text}")
    return period


def _sides(text: str) -> list[str]:
    sides = text.split(",")
    allowed = ("left", "right", "center")
    if len(set(sides)) < len(sides) or not set(sides) <= set(allowed):
        raise argparse.ArgumentTypeError(
            f"must be one or more of {', '.join(allowed)}, without repeats; got {text}"
        )
    return sides


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


@command(
    "let clients command a station: ROS, servo drivers, a humanoid",
    "",
    SCENARIO,
    ros("run a ROS 1 node", "run a ROS 2 node", "clients"),
    argument(
        "--servo",
        metavar="ADDRESS",
        help="emulate the servos of gripper and arm for real drivers, at tcp:PORT, "
        "tcp:HOST:PORT or pty",
    ),
    argument(
        "--protocol",
        type=int,
        metavar="N",
        help="Dynamixel protocol of the servos: 1 or 2 (default: 1)",
    ),
    argument(
        "--dex1",
        type=_sides,
        metavar="SIDES",
        help="emulate hands of a humanoid with SAKE's driver, as DDS topics in "
        "--domain: left, right, center or left,right (one station each)",
    ),
    argument(
        "--name",
        default="drake_srg",
        metavar="NAME",
        help="the node's name, different for each station (default: %(default)s)",
    ),
    argument(
        "--rate",
        type=_rate,
        default=1.0,
        metavar="X",
        help="simulated seconds per real second; 0: as fast as possible (default: 1)",
    ),
    argument(
        "--camera-period",
        type=_period,
        default=0.1,
        metavar="X",
        help="shortest time between pictures [s] (default: %(default)s)",
    ),
    folder("the results", "out/served/SCENARIO"),
    flag("--no-record", "write neither recording nor replay"),
)
def serve(options: argparse.Namespace) -> int:
    """Serve a station until the user stops it; return the exit code.

    Raises:
        ScenarioError: If the input is bad, or an address or folder cannot be used.
    """
    output = options.console
    status = StatusLine(
        sys.stderr if output.json else sys.stdout, shown=output.progress, at_once=True
    )
    with stop_on_signals() as stop, contextlib.closing(status):
        # Imported under the signal handlers, so that a signal ends the command cleanly.
        from drake_srg.robot.serve.connecting import BridgeOptions, own_terminal
        from drake_srg.robot.serve.loop import Serve

        ros1, ros2 = speaks_ros(options)
        sides = options.dex1 or []
        if sides:
            ros2 = options.ros2  # --domain alone is for the hands
        if sides and (ros2 or options.servo):
            raise ScenarioError("serve: --dex1: cannot go with --ros2 or --servo")
        bridges = BridgeOptions(
            ros1=ros1,
            master=options.master,
            ros2=ros2,
            domain=options.domain,
            servo=options.servo,
            protocol=options.protocol,
            host=options.host,
            name=options.name,
            terminal=own_terminal(sys.stdin),
        )
        if not (bridges.ros1 or bridges.ros2 or bridges.servo or sides):
            raise ScenarioError(
                "serve: needs at least one of --ros1, --ros2, --servo and --dex1"
            )
        scenario = load(options)
        name = name_of(options)
        default = Path("out") / "served" / name
        shown: dict[str, str] = {}

        def serve_one(bridges: BridgeOptions, out: Path | None) -> Served:
            side = bridges.dex1 or ""

            def report(text: str) -> None:
                shown[side] = text
                status.show(" | ".join(list(shown.values())))

            return Serve(
                scenario,
                functools.partial(bridges.connect, scenario),
                name=name,
                rate=options.rate,
                camera_period=options.camera_period,
                out=out if out is None or len(sides) < 2 else out / side,
                stop=stop,
                tell=lambda text: status.interrupt(f"drake-srg: warning: {text}"),
                report=report,
            )

        try:
            with contextlib.ExitStack() as stack:
                out = stack.enter_context(_recordings(options, default))
                if sides:
                    bridges = stack.enter_context(_joined(bridges))
                hands = [dc.replace(bridges, dex1=side) for side in sides] or [bridges]
                every = _serve_each(hands, functools.partial(serve_one, out=out), stop)
        except BrokenPipeError:  # the reader of the status line is gone
            raise
        except OSError as error:
            where = f"{error.filename}: " if error.filename else ""
            raise ScenarioError(f"serve: {where}{error.strerror or error}") from error
    for served in every:
        output.say(
            f"served {served.sim_time:.2f} s in {served.wall_time:.2f} s, "
            f"{served.commands} commands"
        )
        output.say(*filter(None, [served.recording, served.replay]))
    answers = [dc.asdict(served) for served in every]
    output.answer(dict(zip(sides, answers, strict=True)) if sides else answers[0])
    return SUCCESS


@contextlib.contextmanager
def _joined(bridges: BridgeOptions) -> Iterator[BridgeOptions]:
    """Yield the options with a participant in a DDS domain, which all hands share."""
    from drake_srg.robot.serve.dex1 import messages  # noqa: F401 # checks the package
    from drake_srg.robot.serve.ros2.bridge import domain_id, open_participant

    try:
        domain = domain_id(bridges.domain)
        with open_participant(domain, bridges.host, bridges.name, 2**20) as participant:
            yield dc.replace(bridges, participant=participant)
    except ValueError as error:
        raise ScenarioError(f"serve: --dex1: {error}") from error


def _serve_each(
    hands: Sequence[BridgeOptions],
    serve_one: Callable[[BridgeOptions], Served],
    stop: threading.Event,
) -> list[Served]:
    """Serve a station for each hand at the same time; when one ends, end all."""
    if len(hands) == 1:
        return [serve_one(hands[0])]

    def run(bridges: BridgeOptions) -> Served:
        try:
            return serve_one(bridges)
        finally:
            stop.set()

    with ThreadPoolExecutor(len(hands)) as pool:
        return list(pool.map(run, hands))


@command(
    "follow a running robot by simulation, report differences",
    "It only listens. Exit code: 0 no difference, 1 at least one, 2 bad input.",
    SCENARIO,
    ros("listen to ROS 1", "listen to ROS 2", "the robot"),
    argument(
        "--hardware",
        type=Path,
        metavar="FILE",
        help="listen to the topics of this hardware file",
    ),
    folder("the results", "out/twin/SCENARIO"),
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
        from drake_srg.robot.twin.run import run_twin

        scenario = load(options)
        config = _config(options, scenario.arms)
        name = name_of(options)
        with _recordings(options, Path("out") / "twin" / name) as out:
            result = run_twin(
                scenario,
                config,
                name=name,
                out=out,
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


@contextlib.contextmanager
def _recordings(options: argparse.Namespace, default: Path) -> Iterator[Path | None]:
    """Yield the folder of a command's recordings; None with `--no-record`."""
    if options.no_record:
        yield None
        return
    with results_folder(options, default, RUN) as out:
        yield out


def _config(options: argparse.Namespace, names: Iterable[str]) -> HardwareConfig:
    """Return the drivers with the robot's topics, given the names of several arms."""
    from drake_srg.robot.drive.arm import Ros1Arm, Ros2Arm
    from drake_srg.robot.drive.config import ArmHardware, HardwareConfig, load_hardware
    from drake_srg.robot.drive.gripper import Ros1Gripper, Ros2Gripper
    from drake_srg.robot.serve.connecting import Ros1Config, Ros2Config

    ros1, ros2 = speaks_ros(options)
    if ros1 + ros2 + (options.hardware is not None) != 1:
        raise ScenarioError("twin: needs one of --ros1, --ros2 and --hardware")
    if options.hardware is not None:
        return load_hardware(options.hardware)
    one = ArmHardware(arm=Ros2Arm(), gripper=Ros2Gripper())
    if ros1:
        one = ArmHardware(arm=Ros1Arm(), gripper=Ros1Gripper())
    return HardwareConfig(
        **vars(one),
        arms=dict.fromkeys(names, one),
        ros1=Ros1Config(master=options.master or "", host=options.host),
        ros2=Ros2Config(domain=options.domain, host=options.host),
    )
