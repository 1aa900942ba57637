"""The command `drake-srg serve`."""

import argparse
import contextlib
import dataclasses as dc
import functools
import math
import sys
from pathlib import Path

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
from drake_srg.cli.process import stop_on_signals
from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.status_line import StatusLine


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


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


@command(
    "run a scenario's station under outside command: ROS 1, ROS 2, a servo driver",
    "",
    SCENARIO,
    ros("run a ROS 1 node", "run a ROS 2 node", "clients"),
    argument(
        "--servo",
        metavar="tcp:PORT|pty",
        help="run the servos of gripper and arm for real drivers (or tcp:HOST:PORT)",
    ),
    argument(
        "--protocol",
        type=int,
        metavar="1|2",
        help="Dynamixel protocol of the servos (default: 1)",
    ),
    argument(
        "--name",
        default="drake_srg",
        metavar="NODE",
        help="node name, to run several stations (default: %(default)s)",
    ),
    argument(
        "--rate",
        type=_rate,
        default=1.0,
        metavar="FACTOR",
        help="simulated seconds per real second; 0: as fast as possible (default: 1)",
    ),
    argument(
        "--camera-period",
        type=_period,
        default=0.1,
        metavar="SECONDS",
        help="shortest time between pictures [s] (default: %(default)s)",
    ),
    folder("results (default: out/served/SCENARIO)"),
    flag("--no-record", "write no recording and replay"),
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
        # Imported here, under the signal handlers, so that a signal during the import
        # of Drake ends the command cleanly.
        from drake_srg.bridges.connecting import BridgeOptions
        from drake_srg.bridges.keyboard import own_terminal
        from drake_srg.bridges.serve import Serve

        ros1, ros2 = speaks_ros(options)
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
        if not (bridges.ros1 or bridges.ros2 or bridges.servo):
            raise ScenarioError(
                "serve: needs at least one of --ros1, --ros2 and --servo"
            )
        scenario = load(options)
        name = Path(options.scenario).stem
        out: Path = options.out or Path("out") / "served" / name
        try:
            served = Serve(
                scenario,
                functools.partial(bridges.connect, scenario),
                name=name,
                rate=options.rate,
                camera_period=options.camera_period,
                out=None if options.no_record else out,
                stop=stop,
                tell=lambda text: status.interrupt(f"drake-srg: warning: {text}"),
                report=status.show,
            )
        except BrokenPipeError:  # nobody reads the status line any more
            raise
        except OSError as error:
            where = f"{error.filename}: " if error.filename else ""
            raise ScenarioError(f"serve: {where}{error.strerror or error}") from error
    output.say(
        f"served {served.sim_time:.2f} s in {served.wall_time:.2f} s, "
        f"{served.commands} commands"
    )
    output.say(*filter(None, [served.recording, served.replay]))
    output.answer(dc.asdict(served))
    return 0
