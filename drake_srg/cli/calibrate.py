"""The command `drake-srg calibrate`."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

from drake_srg.cli.command import SCENARIO, argument, command, folder, load
from drake_srg.cli.process import SUCCESS, end_on_sigterm, writing
from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.status_line import StatusLine

if TYPE_CHECKING:
    from drake_srg.calibration.board import Board

_BOARD = "6,5,0.04,0.03,DICT_4X4_50"


@command(
    "find a camera's intrinsics and pose by images of a ChArUco board",
    "In simulation, the arm shows the board to the camera. It prints standard "
    "deviations and writes the images, and a scenario with the result.",
    argument("what", choices=["camera"], help="what to calibrate"),
    SCENARIO,
    argument(
        "--camera",
        metavar="NAME",
        help="a name in `cameras` (default: the first of `localizer.cameras`)",
    ),
    argument(
        "--images",
        metavar="N|DIR",
        default="24",
        help="how many to take in simulation, or a folder of images with poses.csv "
        "(default: %(default)s)",
    ),
    argument(
        "--board",
        metavar="COLUMNS,ROWS,SQUARE,MARKER[,DICTIONARY]",
        default=_BOARD,
        help="the board in a folder's images; sides in metres (default: %(default)s)",
    ),
    folder(
        "folder for calibration.yaml and the images (default: out/calibrate_SCENARIO)"
    ),
)
def calibrate(options: argparse.Namespace) -> int:
    """Calibrate a camera and write a scenario with the result.

    Raises:
        ScenarioError: If images, poses or scenario are invalid, or writing fails.
    """
    from drake_srg.calibration.capture import take_shots
    from drake_srg.calibration.mounting import mount
    from drake_srg.calibration.overlay import answer, overlay, report, true_errors
    from drake_srg.calibration.shots import find_views, read_shots, shot_files
    from drake_srg.calibration.solve import calibrate as solve
    from drake_srg.cell.planners import own_scene
    from drake_srg.sweeps.files import write_file, write_folder

    board, count = parse_board(options.board), parse_count(options.images)
    if count is not None and options.board != _BOARD:
        raise ScenarioError("--board: needs a folder of --images")
    out: Path = options.out or Path("out") / f"calibrate_{Path(options.scenario).stem}"
    base = _base(options.scenario, out)
    scenario = load(options)
    if scenario.arm is None or scenario.gripper is None:
        raise ScenarioError(f"{options.scenario}: needs an arm and a gripper")
    camera = options.camera or next(iter(scenario.localizer.cameras), "")
    scene = own_scene(scenario)
    mounting = mount(scenario, camera, scene, board)
    end_on_sigterm()
    if count is None:
        shots = read_shots(Path(options.images))
    else:
        with StatusLine(shown=options.console.progress) as line:

            def tell(taken: int) -> None:
                line.count(taken, count, "images taken")

            shots = take_shots(scenario, mounting, scene, count, tell)
    result = solve(find_views(shots, mounting), mounting.focal, mounting.center)
    errors = None if count is None else true_errors(result, mounting)
    file = out / "calibration.yaml"
    with writing("--out", out):
        if count is not None:
            write_folder(out / "images", shot_files(shots))
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

    from drake_srg.calibration.board import Board

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
    from drake_srg.calibration.solve import MIN_VIEWS

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
