"""The command `drake-srg serve`."""

import argparse
import contextlib
import functools
import math
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from drake_srg.cli.status_line import StatusLine
from drake_srg.common.errors import ScenarioError


def add_arguments(serve: argparse.ArgumentParser) -> None:
    """Add what the command takes, besides the scenario."""
    serve.add_argument("--ros1", action="store_true", help="be a node of ROS 1")
    serve.add_argument(
        "--master", metavar="URI", help="of ROS 1 (default: $ROS_MASTER_URI)"
    )
    serve.add_argument("--ros2", action="store_true", help="be a node of ROS 2")
    serve.add_argument(
        "--domain", type=int, metavar="N", help="of ROS 2 (default: $ROS_DOMAIN_ID)"
    )
    serve.add_argument(
        "--servo",
        metavar="tcp:PORT|pty",
        help="be the gripper's servo, for the real one's driver (HOST: tcp:HOST:PORT)",
    )
    serve.add_argument(
        "--host",
        default="127.0.0.1",
        metavar="ADDRESS",
        help="this machine's address to be reached at (default: %(default)s)",
    )
    serve.add_argument(
        "--name",
        default="drake_srg",
        metavar="NODE",
        help="of the node, for several beside each other (default: %(default)s)",
    )
    serve.add_argument(
        "--rate",
        type=_rate,
        default=1.0,
        metavar="FACTOR",
        help="simulated seconds in a real one; 0: as fast as it can (default: 1)",
    )
    serve.add_argument(
        "--out", type=Path, metavar="DIR", help="results (default: out/served/SCENARIO)"
    )
    serve.add_argument(
        "--no-record", action="store_true", help="write no recording.mcap"
    )


def _rate(text: str) -> float:
    try:
        rate = float(text)
    except ValueError:
        rate = math.nan
    if not 0.0 <= rate < math.inf:
        raise argparse.ArgumentTypeError(f"{text}: must be a number from 0 on")
    return rate


def serve(options: argparse.Namespace) -> int:
    """Serve a station until somebody asks it to stop; returns the exit code.

    Raises:
        ScenarioError: For bad input, and where an address or a folder cannot be used.
    """
    status = StatusLine(sys.stdout)
    with _stop_on_signals() as stop, contextlib.closing(status):
        # Only now: what is asked to stop while it imports Drake shall not be torn.
        from drake_srg.bridges.connecting import BridgeOptions
        from drake_srg.bridges.serve import Serve
        from drake_srg.scenario import load_scenario

        bridges = BridgeOptions(
            ros1=options.ros1 or options.master is not None,
            master=options.master,
            ros2=options.ros2 or options.domain is not None,
            domain=options.domain,
            servo=options.servo,
            host=options.host,
            name=options.name,
        )
        if not (bridges.ros1 or bridges.ros2 or bridges.servo):
            raise ScenarioError(
                "serve: needs at least one of --ros1, --ros2 and --servo"
            )
        scenario = load_scenario(
            options.scenario, seed=options.seed, overrides=options.set
        )
        name = Path(options.scenario).stem
        out: Path = options.out or Path("out") / "served" / name
        try:
            served = Serve(
                scenario,
                functools.partial(bridges.connect, scenario),
                name=name,
                rate=options.rate,
                out=None if options.no_record else out,
                stop=stop,
                tell=lambda text: status.interrupt(f"drake-srg: warning: {text}"),
                report=status.show,
            )
        except BrokenPipeError:  # the reader of the status line has gone
            raise
        except OSError as error:
            where = f"{error.filename}: " if error.filename else ""
            raise ScenarioError(f"serve: {where}{error.strerror or error}") from error
    print(
        f"served {served.sim_time:.2f} s in {served.wall_time:.2f} s, "
        f"{served.commands} commands"
    )
    if served.recording is not None:
        print(served.recording)
    return 0


@contextlib.contextmanager
def _stop_on_signals() -> Iterator[threading.Event]:
    """Set an event where the user asks for an end; asking again does what it did.

    That is Ctrl-C, SIGTERM, and SIGHUP of a terminal that is closed.
    """
    stop = threading.Event()
    before: dict[int, Any] = {}

    def end(number: int, _: object) -> None:
        stop.set()
        signal.signal(number, before[number])

    if threading.current_thread() is threading.main_thread():  # Python's own limit
        numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        before = {number: signal.signal(number, end) for number in numbers}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
