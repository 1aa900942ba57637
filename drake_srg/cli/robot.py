"""The commands serve, twin, identify and calibrate."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses as dc
import functools
import math
import os
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
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
    writing,
)
from drake_srg.cli.results import (
    CALIBRATION,
    REPLACE,
    RUN,
    folder,
    results_folder,
    taken,
)
from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.common.status_line import StatusLine

if TYPE_CHECKING:
    from drake_srg.robot.calibrate.mounting import Board
    from drake_srg.robot.drive import HardwareConfig
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
            f"must be different ones of {', '.join(allowed)}, got {text}"
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
        help="run the servos of gripper and arm for real drivers, at tcp:PORT, "
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
        help="be the hands of a humanoid on SAKE's driver, as DDS topics in --domain: "
        "left, right, center or left,right (one station each)",
    ),
    argument(
        "--name",
        default="drake_srg",
        metavar="NAME",
        help="the node's name, to run several stations (default: %(default)s)",
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
        from drake_srg.robot.serve.connecting import BridgeOptions, own_terminal
        from drake_srg.robot.serve.loop import Serve

        ros1, ros2 = speaks_ros(options)
        sides = options.dex1 or []
        if sides:
            ros2 = options.ros2  # the domain is that of the hands
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
    return 0


@contextlib.contextmanager
def _joined(bridges: BridgeOptions) -> Iterator[BridgeOptions]:
    """Yield bridges whose hands share a participant of their DDS domain."""
    from drake_srg.robot.serve.dex1 import messages  # noqa: F401 # names what is missing
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
    """Serve a station for each, at once; when one ends, all do."""
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

        config = _config(options)
        scenario = load(options)
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


def _config(options: argparse.Namespace) -> HardwareConfig:
    """Return where the robot's topics are."""
    from drake_srg.robot.drive import HardwareConfig, load_hardware
    from drake_srg.robot.drive.arm import Ros1Arm, Ros2Arm
    from drake_srg.robot.drive.gripper import Ros1Gripper, Ros2Gripper
    from drake_srg.robot.serve.connecting import Ros1Config, Ros2Config

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


VENDOR = "vendor"


@command(
    "fit a gripper's motor, friction and heat to its servo's log",
    "It prints intervals, correlations and what the log leaves open, and writes a "
    "scenario.",
    argument(
        "log",
        metavar="FILE",
        help=f"rows of your gripper's tests, or `{VENDOR}` for the maker's own "
        "(columns: docs/gripper.md)",
    ),
    argument(
        "--record",
        metavar="PORT",
        help="test the gripper at a serial device or tcp:HOST:PORT for three minutes, "
        "with nothing between its fingers, and write FILE first",
    ),
    argument(
        "--id",
        type=int,
        default=1,
        metavar="N",
        help="with --record: ID of the servo (default: %(default)s)",
    ),
    argument(
        "--baud",
        type=int,
        default=57600,
        metavar="N",
        help="with --record: of the serial device (default: %(default)s)",
    ),
    argument(
        "--hottest",
        type=float,
        default=60.0,
        metavar="DEGC",
        help="with --record: temperature at which to stop (default: %(default)s)",
    ),
    argument(
        *("-o", "--out"),
        type=Path,
        metavar="FILE",
        default=Path("srg_specimen.yaml"),
        help="the scenario to write (default: %(default)s)",
    ),
    REPLACE,
    argument(
        "--base",
        default="gripper_bench",
        metavar="SCENARIO",
        help="scenario whose gripper is replaced (default: %(default)s)",
    ),
)
def identify(options: argparse.Namespace) -> int:
    """Fit a gripper's parameters to its log and write a scenario with them.

    Raises:
        ScenarioError: If the log or the base is invalid, or writing fails.
    """
    from drake_srg.gripper.srg_tendon_driver import SrgTendonDriver
    from drake_srg.robot.identify.fits import identify as fit_log
    from drake_srg.robot.identify.log import read_log, vendor_log
    from drake_srg.robot.identify.report import overlay, report
    from drake_srg.scenario import load_scenario
    from drake_srg.scenario.typed_yaml import check_tree, parse_yaml
    from drake_srg.sweeps.files import write_file

    gripper = load_scenario(options.base).gripper
    if gripper is None or gripper.wire_motor is None:
        raise ScenarioError(f"--base {options.base}: gripper: needs !SrgTendonDriver")
    base = options.base
    if base.endswith(".yaml"):
        if Path(base).resolve() == options.out.resolve():
            raise ScenarioError(f"-o {options.out}: must differ from --base")
        # A scenario names its base relative to its own folder.
        base = os.path.relpath(base, options.out.parent)
    if options.out.exists() and not options.replace:
        raise taken(options, options.out, ())
    own = options.log != VENDOR
    if options.record is not None:
        if not own:
            raise ScenarioError(f"--record: needs a file to write, got {VENDOR}")
        _record(options, Path(options.log))
    rows = read_log(Path(options.log)) if own else vendor_log()
    result = fit_log(rows)
    source = Path(options.log).stem if own else "an EZGripper measured by its vendor"
    text = overlay(result, base, source)
    # A log of something else may give values that no scenario takes.
    tree = parse_yaml(text, options.log)["gripper"]
    check_tree(tree, SrgTendonDriver | None, options.log, "gripper")
    with writing("-o", options.out):
        write_file(options.out, text.encode("utf-8"))
    options.console.say(*report(result), "", options.out)
    options.console.answer(
        {
            "parameters": {
                e.parameter.name: {
                    "value": e.value,
                    "interval": [e.low, e.high],
                    "unit": e.parameter.unit,
                    "told": e.told,
                }
                for fit in result.fits.values()
                for e in fit.estimates
            },
            "errors": [dc.asdict(error) for error in result.errors],
            "scenario": options.out,
        }
    )
    return SUCCESS


def _record(options: argparse.Namespace, path: Path) -> None:
    """Test the gripper at a port and write its log.

    Raises:
        ScenarioError: If the file exists, or the test was given up.
    """
    from drake_srg.robot.drive.dynamixel.bus import BusError, ServoBus, open_line
    from drake_srg.robot.identify.log import log_text
    from drake_srg.robot.identify.press_test import (
        RecordingError,
        WatchedServo,
        record,
    )
    from drake_srg.sweeps.files import write_file

    if path.exists() and not options.replace:
        raise ScenarioError(f"{path}: already exists; choose another, or add --replace")
    if not 0 <= options.id <= 252:
        raise ScenarioError(f"--id: must be 0 to 252, got {options.id}")
    rows = []
    with stop_on_signals() as stop:

        def pause(duration: float) -> None:
            if stop.wait(duration):
                raise RecordingError("stopped before its end")

        try:
            with contextlib.ExitStack() as stack:
                bus = ServoBus(open_line(options.record, options.baud))
                stack.callback(bus.close)
                servo = WatchedServo(bus, options.id, options.hottest, pause=pause)
                for row in stack.enter_context(contextlib.closing(record(servo))):
                    options.console.say(f"{row.label}: {row.current_ma:.0f} mA")
                    rows.append(row)
        except (BusError, RecordingError, OSError, ValueError) as error:
            reason = f"{one_line(error)}; no log is written"
            raise ScenarioError(f"--record {options.record}: {reason}") from None
    with writing("FILE", path):
        write_file(path, log_text(rows).encode("utf-8"))


_BOARD = "6,5,0.04,0.03,DICT_4X4_50"


@command(
    "find a camera's intrinsics and pose by images of a board",
    "The board is a ChArUco board. In simulation, the arm shows it to the camera. It "
    "prints standard deviations and writes the images, and a scenario with the result.",
    argument("what", choices=["camera"], metavar="WHAT", help="the word camera"),
    SCENARIO,
    argument(
        "--camera",
        metavar="NAME",
        help="a name in `cameras` (default: the first of `localizer.cameras`)",
    ),
    argument(
        "--images",
        metavar="IMAGES",
        default="24",
        help="how many to take in simulation, or a folder of images with poses.csv "
        "(default: %(default)s)",
    ),
    argument(
        "--board",
        metavar="BOARD",
        default=_BOARD,
        help="the board in a folder's images: columns, rows, sides of a square and of "
        "a marker [m], dictionary (default: %(default)s)",
    ),
    folder("calibration.yaml and the images", "out/calibrate_SCENARIO"),
)
def calibrate(options: argparse.Namespace) -> int:
    """Calibrate a camera and write a scenario with the result.

    Raises:
        ScenarioError: If images, poses or scenario are invalid, or writing fails.
    """
    from drake_srg.robot.calibrate.mounting import mount
    from drake_srg.robot.calibrate.overlay import answer, overlay, report, true_errors
    from drake_srg.robot.calibrate.shots import (
        find_views,
        read_shots,
        shot_files,
        take_shots,
    )
    from drake_srg.robot.calibrate.solve import calibrate as solve
    from drake_srg.scenario.schema import check_single_arm
    from drake_srg.station.planners import own_scene
    from drake_srg.sweeps.files import write_file, write_folder

    board, count = parse_board(options.board), parse_count(options.images)
    if count is not None and options.board != _BOARD:
        raise ScenarioError("--board: needs a folder of --images")
    scenario = load(options)
    check_single_arm(scenario, "calibrate camera")
    if scenario.arm is None or scenario.gripper is None:
        raise ScenarioError(f"{options.scenario}: needs an arm and a gripper")
    camera = options.camera or next(iter(scenario.localizer.cameras), "")
    scene = own_scene(scenario)
    mounting = mount(scenario, camera, scene, board)
    if count is None:
        shots = read_shots(Path(options.images))
    else:
        with StatusLine(shown=options.console.progress) as line:

            def tell(taken: int) -> None:
                line.count(taken, count, "images taken")

            shots = take_shots(scenario, mounting, scene, count, tell)
    result = solve(find_views(shots, mounting), mounting.focal, mounting.center)
    errors = None if count is None else true_errors(result, mounting)
    default = Path("out") / f"calibrate_{name_of(options)}"
    with results_folder(options, default, CALIBRATION) as out:
        base = _base(options.scenario, out)
        if count is not None:
            write_folder(out / "images", shot_files(shots))
        file = out / "calibration.yaml"
        write_file(file, overlay(result, mounting, base).encode("utf-8"))
    options.console.say(*report(result, mounting, errors), "", file)
    found = answer(result, mounting, errors)
    options.console.answer({**found, "scenario": file})
    return SUCCESS


def parse_board(text: str) -> Board:
    """Return the board that `--board` describes.

    Raises:
        ScenarioError: If it describes none.
    """
    import cv2

    from drake_srg.robot.calibrate.mounting import Board

    words = text.split(",")
    if len(words) == 4:
        words.append("DICT_4X4_50")
    try:
        first, second, side, inner, dictionary = words
        columns, rows = int(first), int(second)
        square, marker = float(side), float(inner)
    except ValueError:
        raise ScenarioError(
            f"--board: must be COLUMNS,ROWS,SQUARE,MARKER[,DICTIONARY], got {text!r}"
        ) from None
    if not (min(columns, rows) >= 3 and max(columns, rows) <= 50):
        raise ScenarioError(f"--board: needs 3 to 50 columns and rows, got {text!r}")
    if not 0.0 < marker < square <= 1.0:
        raise ScenarioError(
            f"--board: needs 0 < MARKER < SQUARE <= 1 m, got {marker:g} and {square:g}"
        )
    if not dictionary.startswith("DICT_") or not hasattr(cv2.aruco, dictionary):
        known = [name for name in dir(cv2.aruco) if name.startswith("DICT_")]
        raise ScenarioError(
            f"--board: unknown dictionary {dictionary!r} (allowed: {', '.join(known)})"
        )
    markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    if columns * rows // 2 > len(markers.bytesList):
        raise ScenarioError(
            f"--board: {dictionary} has too few markers for {columns} x {rows} squares"
        )
    return Board(columns, rows, square, marker, dictionary)


def parse_count(text: str) -> int | None:
    """Return the number of images that `--images` asks for; None: it is a folder.

    Raises:
        ScenarioError: If it is a number that is too small or too large.
    """
    from drake_srg.robot.calibrate.solve import MIN_VIEWS

    try:
        count = int(text)
    except ValueError:
        return None
    if not MIN_VIEWS <= count <= 200:
        raise ScenarioError(f"--images: must be {MIN_VIEWS} .. 200, got {count}")
    return count


def _base(scenario: str, out: Path) -> str:
    """Return the scenario's name as a file in `out` refers to it."""
    if not scenario.endswith(".yaml"):
        return scenario
    if Path(scenario).resolve() == (out / "calibration.yaml").resolve():
        raise ScenarioError(f"--out {out}: would replace the scenario; choose another")
    return os.path.relpath(scenario, out)
