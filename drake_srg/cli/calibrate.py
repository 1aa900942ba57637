"""The commands identify and calibrate, which write measured values to a scenario."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses as dc
import os
from pathlib import Path
from typing import TYPE_CHECKING

from drake_srg.cli.command import (
    SCENARIO,
    SUCCESS,
    argument,
    command,
    load,
    name_of,
    stop_on_signals,
    writing,
)
from drake_srg.cli.results import CALIBRATION, REPLACE, folder, results_folder, taken
from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.common.status_line import StatusLine

if TYPE_CHECKING:
    from drake_srg.robot.calibrate.mounting import Board

VENDOR = "vendor"


@command(
    "fit a gripper's motor, friction and heat to its servo's log",
    "It prints confidence intervals, correlations and the limits of the log, and "
    "writes a scenario.",
    argument(
        "log",
        metavar="FILE",
        help=f"a log of your gripper's tests, or `{VENDOR}` for the maker's log "
        "(columns: docs/gripper.md)",
    ),
    argument(
        "--record",
        metavar="PORT",
        help="first test the gripper at a serial device or tcp:HOST:PORT for three "
        "minutes, with nothing between its fingers, and write the log to FILE",
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
        help="with --record: baud rate of the serial device (default: %(default)s)",
    ),
    argument(
        "--hottest",
        type=float,
        default=60.0,
        metavar="DEGC",
        help="with --record: stop above this temperature (default: %(default)s)",
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
    # A log of something else may give values that are invalid in a scenario.
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
                raise RecordingError("stopped before the end of the test")

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
    "find a camera's intrinsics and pose from images of a board",
    "The board is a ChArUco board. In simulation, the arm shows it to the camera. The "
    "command prints standard deviations, and writes a scenario with the result; in "
    "simulation, also the images.",
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
        help="number of images to take in simulation, or a folder of images with "
        "poses.csv (default: %(default)s)",
    ),
    argument(
        "--board",
        metavar="BOARD",
        default=_BOARD,
        help="the board in a folder's images: columns, rows, side of a square [m], "
        "side of a marker [m], dictionary (default: %(default)s)",
    ),
    folder("calibration.yaml and the images", "out/calibrate_SCENARIO"),
)
def calibrate(options: argparse.Namespace) -> int:
    """Calibrate a camera and write a scenario with the result.

    Raises:
        ScenarioError: If images, poses or scenario are invalid, or writing fails.
    """
    from drake_srg.robot.calibrate.mounting import mount
    from drake_srg.robot.calibrate.overlay import answer, overlay, report
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
    found = answer(result, mounting, simulated=count is not None)
    default = Path("out") / f"calibrate_{name_of(options)}"
    with results_folder(options, default, CALIBRATION) as out:
        base = _base(options.scenario, out)
        if count is not None:
            write_folder(out / "images", shot_files(shots))
        file = out / "calibration.yaml"
        write_file(file, overlay(found, base).encode("utf-8"))
    options.console.say(*report(result, mounting, found), "", file)
    options.console.answer({**found, "scenario": file})
    return SUCCESS


def parse_board(text: str) -> Board:
    """Return the board that `--board` describes.

    Raises:
        ScenarioError: If the text is invalid.
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
    """Return the number of images in `--images`; None if it names a folder.

    Raises:
        ScenarioError: If the number is too small or too large.
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
    """Return the scenario's name, or its path relative to `out`."""
    if not scenario.endswith(".yaml"):
        return scenario
    if Path(scenario).resolve() == (out / "calibration.yaml").resolve():
        raise ScenarioError(f"--out {out}: would replace the scenario; choose another")
    return os.path.relpath(scenario, out)
