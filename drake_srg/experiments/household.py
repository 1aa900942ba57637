"""Household objects grasped from above and the side, lifted and shaken at 1 g, 2 Hz.

data/grasps.yaml says how each object is presented and grasped, and why.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from drake_srg.common.exceptions import ScenarioError, suggest
from drake_srg.common.srg_geometry import SRG
from drake_srg.experiments.data import household_objects, read_yaml
from drake_srg.experiments.grasping import (
    ACCELERATION,
    HELD,
    GraspConfig,
    Outcome,
    present,
    simulate,
    width_between_pads,
)
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.experiments.still import take_picture
from drake_srg.gripper.tendon import TendonDriveConfig
from drake_srg.recording.timeline import COLORS, make_figure
from drake_srg.scenario.typed_yaml import load_typed

Picture = tuple[npt.NDArray[np.uint8], str, str]  # image, caption, colour of both

_GRASPS = "grasps.yaml"

# Gap between parallel pads with the base links sideways [m].
OPENING = SRG.parallel_gap
_PIXELS = 190  # width and height of a picture
# An object is held firmly if it ends this close to its pose in the hand after the lift.
MOST_SLIP, MOST_TURN = 0.005, np.deg2rad(10.0)


@dc.dataclass(frozen=True)
class Case:
    """An object and one way to grasp it.

    Attributes:
        name: Of the object.
        approach: `above` or `side`; a remark after a comma marks an unusual grasp.
        grasp: The grasp itself.
    """

    name: str
    approach: str
    grasp: GraspConfig

    def __str__(self) -> str:
        return f"{self.name}, {self.approach}"

    @property
    def width(self) -> float:
        """Extent of the object across the pads [m]; NaN if it is not convex."""
        return width_between_pads(household_objects()[self.name], self.grasp)

    @property
    def possible(self) -> bool:
        """Whether the pads open wide enough; True where the width is unknown."""
        return not self.width > OPENING


def household_cases() -> list[Case]:
    """Return every grasp of data/grasps.yaml."""
    return [
        Case(
            name,
            approach,
            load_typed(GraspConfig, grasp, f"{_GRASPS}: {name}: {approach}"),
        )
        for name, grasps in read_yaml(_GRASPS).items()
        for approach, grasp in grasps.items()
    ]


def run(track: Track, *, objects: Sequence[str] = ()) -> ExperimentResult:
    """Grasp, lift and shake objects in every way.

    Args:
        track: Shows progress.
        objects: Names of the objects to grasp; all by default.
    """
    cases = household_cases()
    if objects:
        known = {case.name for case in cases}
        for name in objects:
            if name not in known:
                raise ScenarioError(
                    f"household: objects: unknown object {name!r} "
                    f"{suggest(name, known)}"
                )
        cases = [case for case in cases if case.name in objects]
    rows: list[Row] = []
    table: dict[str, list[Any]] = {}
    pictures: dict[str, Picture] = {}
    things = household_objects()
    for case in track(cases):
        scenario = present(things[case.name], case.grasp)
        outcome = simulate(scenario, case.grasp)
        judged = judge(case, outcome)
        rows += judged
        passed = all(row.passed for row in judged)
        for column, value in columns(case, outcome, passed).items():
            table.setdefault(column, []).append(value)
        image = take_picture(scenario, outcome.q, outcome.p_WL, _PIXELS)
        pictures[str(case)] = (image, *verdict(case, outcome, passed))
    least = min(table["shaken at [m/s²]"])
    rows.append(
        Row.within(
            "all",
            "acceleration of the hand",
            ACCELERATION,
            least,
            "m/s²",
            relative=0.05,
        )
    )
    return ExperimentResult(rows, {"grasps": table}, draw(pictures))


def judge(case: Case, outcome: Outcome) -> list[Row]:
    """Expect a firm hold of objects that fit between the pads, and slip of the others.

    Pads that cannot become parallel press on a wide object's edges and slip off them.
    """
    name = str(case)
    full = TendonDriveConfig().full_wire_force
    rows = [Row.at_most(name, "wire force", full, outcome.wire_force, "N")]
    if not case.possible:
        width, opening = 1e3 * case.width, 1e3 * OPENING
        return [
            Row.at_least(name, "too wide: opening needed", opening, width, "mm"),
            Row.at_least(name, "slip", 1e3 * MOST_SLIP, 1e3 * outcome.slip, "mm"),
            *rows,
        ]
    turn, most_turn = np.rad2deg([outcome.turn, MOST_TURN])
    return [
        Row.at_least(name, "held by the hand alone for", HELD, outcome.held_for, "s"),
        Row.at_most(name, "slip", 1e3 * MOST_SLIP, 1e3 * outcome.slip, "mm"),
        Row.at_most(name, "turn in the hand", most_turn, turn, "degrees"),
        *rows,
    ]


def columns(case: Case, outcome: Outcome, passed: bool) -> dict[str, Any]:
    """Return a line of the table."""
    return {
        "object": case.name,
        "approach": case.approach,
        "success": passed and case.possible,
        "as expected": passed,
        "lifted [mm]": 1e3 * outcome.lifted,
        "held for [s]": outcome.held_for,
        "shaken at [m/s²]": outcome.acceleration,
        "settled [mm]": 1e3 * outcome.settled,
        "sway [mm]": 1e3 * outcome.sway,
        "slip [mm]": 1e3 * outcome.slip,
        "turn [degrees]": float(np.rad2deg(outcome.turn)),
        "grip force [N]": outcome.grip_force,
        "wire force [N]": outcome.wire_force,
        "why": case.grasp.why,
    }


def verdict(case: Case, outcome: Outcome, passed: bool) -> tuple[str, str]:
    """Return a caption that sums up an outcome, and its colour."""
    slip, grip = 1e3 * outcome.slip, outcome.grip_force
    if not passed:
        return f"fails: held {outcome.held_for:.1f} s, slips {slip:.1f} mm", COLORS[1]
    if not case.possible:
        wide = f"{1e3 * case.width:.0f} > {1e3 * OPENING:.0f} mm"
        return f"too wide: {wide}, slips {slip:.0f} mm", COLORS[6]
    return f"slips {slip:.1f} mm at {grip:.0f} N", COLORS[2]


def draw(pictures: Mapping[str, Picture]) -> Any:
    """Draw pictures of the final states, a column per object.

    Args:
        pictures: By the name of the case.
    """
    # Unusual grasps come last.
    stacks: dict[str, list[str]] = {}
    for name in sorted(pictures, key=lambda name: name.count(",") > 1):
        thing = name if name.count(",") > 1 else name.partition(",")[0]
        stacks.setdefault(thing, []).append(name)
    across = 6
    down = 2 * -(-len(stacks) // across)
    figure = make_figure(11.0, 2.25 * down, "Lifted, then shaken at 1 g and 2 Hz")
    all_axes = figure.subplots(down, across, squeeze=False)
    for axes in all_axes.ravel():
        axes.set_axis_off()
    for k, names in enumerate(stacks.values()):
        for j, name in enumerate(names):
            _draw_picture(
                all_axes[2 * (k // across) + j, k % across], name, pictures[name]
            )
    return figure


def _draw_picture(axes: Any, name: str, picture: Picture) -> None:
    image, text, color = picture
    axes.set_axis_on()
    axes.imshow(image, interpolation="none")
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set(color=color, lw=2.0)
    axes.set_title(name.replace("_", " "), fontsize=7.5, loc="left", pad=3)
    axes.set_xlabel(text, fontsize=7.5, loc="left", color=color)
