"""The command `drake-srg import-arm`."""

from __future__ import annotations

import argparse
import dataclasses as dc
import json
import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drake_srg.cli.command import SUCCESS, TASK_FAILED, argument, command, writing
from drake_srg.cli.results import folder, new_folder
from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.common.status_line import StatusLine

if TYPE_CHECKING:
    from drake_srg.importing.arm_cell import Placement
    from drake_srg.importing.arm_file import ArmFile, GivenLimits

_MODEL, _SCENARIO, _PICTURE, _REPORT = "model.sdf", "arm.yaml", "arm.png", "arm.json"
_FILES = (_MODEL, _SCENARIO, _PICTURE, _REPORT, "*.obj")
_FORMATS = (".urdf", ".sdf")


def _numbers(text: str) -> list[float]:
    return [float(word) for word in text.split(",")]


def _limit(name: str, unit: str) -> Any:
    return argument(
        f"--{name}",
        type=_numbers,
        default=[],
        metavar="N,N,...",
        help=f"{name} limits of the joints that replace the file's [{unit}]: one "
        "number for all joints, or one per joint from the base",
    )


@command(
    "make a checked arm for the kitchen from a URDF or an SDF file",
    "It makes the collision meshes convex, adds motors and gains, ignores contacts "
    "between links that always or never touch, and chooses the arm's base and home in "
    "the kitchen. In simulation, it checks that the arm holds still, follows commands "
    "and keeps its limits. Then: drake-srg run DIR/arm.yaml. Exit code: 0 the arm "
    "passes, 1 it is written but fails a check, 2 bad input.",
    argument("file", type=Path, metavar="FILE", help="a .urdf or an .sdf"),
    folder("the arm", "out/arms/NAME"),
    argument(
        "--tip",
        default="",
        metavar="LINK",
        help="the link or frame that carries the gripper; links beyond it are left out "
        "(default: the end of the chain)",
    ),
    _limit("effort", "N m or N"),
    _limit("velocity", "rad/s or m/s"),
    _limit("acceleration", "rad/s2 or m/s2"),
    name="import-arm",
)
@scenario_errors()
def import_arm(options: argparse.Namespace) -> int:
    """Make an arm from a file; print the repairs, and whether it passes the checks."""
    from drake_srg.importing.arm_file import GivenLimits

    file: Path = options.file
    if file.suffix.lower() not in _FORMATS:
        allowed = ", ".join(_FORMATS)
        raise ScenarioError(f"{file}: unknown format (allowed: {allowed})")
    name = re.sub(r"\W+", "_", file.stem)
    given = GivenLimits(options.velocity, options.acceleration, options.effort)
    with (
        new_folder(options, Path("out") / "arms" / name, _FILES) as out,
        writing("--out", out),
    ):
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".", dir=out.parent) as there:
            new = Path(there) / name
            new.mkdir()
            with StatusLine(shown=options.console.progress) as line:
                report = _make(file.absolute(), options.tip, given, new, line)
            new.rename(out)
    files = [out / name for name in (_SCENARIO, _MODEL, _PICTURE)]
    options.console.say(*_description(report), "", *files)
    options.console.answer(report | {"files": files})
    return TASK_FAILED if report["problems"] else SUCCESS


def _make(
    file: Path, tip: str, given: GivenLimits, folder: Path, line: StatusLine
) -> dict[str, Any]:
    """Fill a folder with an arm; return its report."""
    import cv2

    from drake_srg.importing.arm_cell import draw_reach, place_arm
    from drake_srg.importing.arm_check import check_arm
    from drake_srg.importing.arm_file import read_arm
    from drake_srg.importing.arm_model import write_model
    from drake_srg.scenario import load_scenario

    line.show(f"{file.name}: reading the file and making meshes convex")
    arm = read_arm(file, tip, given)
    ignored = write_model(arm, folder / _MODEL)
    line.show(f"{file.name}: computing the arm's reach")
    placement = place_arm(arm, folder / _SCENARIO)
    line.show(f"{file.name}: checking the arm")
    scenario = load_scenario(folder / _SCENARIO)
    check, picture = check_arm(scenario, folder / _MODEL)
    image = draw_reach(picture, placement)
    cv2.imwrite(str(folder / _PICTURE), image[:, :, ::-1])
    report = {
        **_facts(arm, placement),
        "ignored_pairs": ignored,
        "check": dc.asdict(check),
        "problems": check.problems(),
        "warnings": list(arm.warnings),
    }
    text = json.dumps(report, indent=2)
    (folder / _REPORT).write_text(text + "\n", encoding="utf-8")
    return report


def _facts(arm: ArmFile, placement: Placement) -> dict[str, Any]:
    keys = ("lower", "upper", "velocity", "acceleration", "effort")
    limits = {key: [getattr(j, key) for j in arm.joints] for key in keys}
    # JSON has no infinity.
    limits = {
        key: [value if abs(value) < 1e15 else None for value in values]
        for key, values in limits.items()
    }
    return {
        "joints": [joint.name for joint in arm.joints],
        "mass": sum(link.contents.mass or 0.0 for link in arm.links),
        **limits,
        "base": list(placement.base),
        "home": placement.home.tolist(),
        "reach": float(placement.radii[placement.reached.any(axis=0)].max()),
        "places_within_reach": placement.places,
        "camera_sees_past_it": placement.sees,
    }


def _description(report: dict[str, Any]) -> list[str]:
    """Return repairs and measurements, one per line."""
    x, y, _ = report["base"]
    check = report["check"]

    def listed(values: Sequence[float | None]) -> str:
        return ", ".join("-" if value is None else f"{value:.4g}" for value in values)

    hidden = "" if report["camera_sees_past_it"] else ", hides places from the camera"
    return [
        *(f"warning: {warning}" for warning in report["warnings"]),
        f"{'joints':14} {', '.join(report['joints'])}",
        f"{'mass':14} {report['mass']:.3g} kg",
        f"{'effort':14} {listed(report['effort'])} N m or N",
        f"{'velocity':14} {listed(report['velocity'])} rad/s or m/s",
        f"{'acceleration':14} {listed(report['acceleration'])} rad/s² or m/s²",
        f"{'ignored':14} {', '.join(report['ignored_pairs']) or 'only neighbours'}",
        f"{'base':14} at ({x:.2f}, {y:.2f}) m on the kitchen's table",
        f"{'home':14} {listed(report['home'])}{hidden}",
        f"{'reach':14} {report['reach']:.2f} m with the hand down, "
        f"{100 * report['places_within_reach']:.0f} % of the task's places",
        f"{'holds still':14} within {1e3 * check['moved']:.2f} mrad or mm, with "
        f"{100 * check['gravity']:.0f} % of a torque limit",
        f"{'follows':14} within {1e3 * check['behind']:.1f} mrad or mm at half of "
        "its limits",
        f"{'limits':14} overrun by {1e3 * check['overrun']:.1f} mrad or mm, torque "
        f"{100 * check['strained']:.0f} %",
        *(f"problem: {problem}" for problem in report["problems"]),
    ]
