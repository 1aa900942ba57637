"""Household objects taken from above and from the side, lifted and shaken at 1 g, 2 Hz.

How each is presented and taken, and why so, is in household.yaml beside this file.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from drake_srg.common.srg_geometry import SRG
from drake_srg.experiments.grasping import (
    ACCELERATION,
    HELD,
    GraspConfig,
    Outcome,
    present,
    simulate,
    width_between_pads,
)
from drake_srg.experiments.objects import household_objects
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult, Row
from drake_srg.experiments.still import take_picture
from drake_srg.gripper.tendon import TendonDriveConfig
from drake_srg.recording.figure import COLORS, make_figure
from drake_srg.scenario.yaml_tree import load_typed, parse_yaml

Picture = tuple[npt.NDArray[np.uint8], str, str]  # image, caption and its colour

_GRASPS = Path(__file__).parent / "household.yaml"

# Gap between parallel pads with the base links sideways [m].
OPENING = SRG.parallel_gap
_PIXELS = 190  # of a picture's side
# Held firmly is what is within this of where it was when it was lifted.
MOST_SLIP, MOST_TURN = 0.005, np.deg2rad(10.0)


@dc.dataclass(frozen=True)
class Case:
    """An object and one way to take it."""

    name: str  # of the object
    approach: str  # above, side; with a remark: in another way than one would choose
    grasp: GraspConfig

    def __str__(self) -> str:
        return f"{self.name}, {self.approach}"

    @property
    def width(self) -> float:
        """Extent of the object across the pads [m]; NaN of one that is not convex."""
        return width_between_pads(household_objects()[self.name], self.grasp)

    @property
    def possible(self) -> bool:
        """Whether the pads open as far, as far as is known beforehand."""
        return not self.width > OPENING


def household_cases() -> list[Case]:
    """Return every way in which household.yaml takes an object."""
    tree = parse_yaml(_GRASPS.read_text(encoding="utf-8"), _GRASPS.name)
    return [
        Case(
            name,
            approach,
            load_typed(GraspConfig, grasp, f"{_GRASPS.name}: {name}: {approach}"),
        )
        for name, grasps in tree.items()
        for approach, grasp in grasps.items()
    ]


def run(track: Track) -> ExperimentResult:
    """Take, lift and shake every object in every way."""
    rows: list[Row] = []
    table: dict[str, list[Any]] = {}
    pictures: dict[str, Picture] = {}
    things = household_objects()
    for case in track(household_cases()):
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
            "all", "hand's acceleration", ACCELERATION, least, "m/s²", relative=0.05
        )
    )
    return ExperimentResult(rows, {"grasps": table}, draw(pictures))


def judge(case: Case, outcome: Outcome) -> list[Row]:
    """Expect that what fits between the pads is held firmly, and the rest not.

    Pads that cannot be parallel press on a wide thing's edges, from which it slips.
    """
    name = str(case)
    full = TendonDriveConfig().full_wire_force
    rows = [Row.at_most(name, "wire force", full, outcome.wire_force, "N")]
    if not case.possible:
        width, opening = 1e3 * case.width, 1e3 * OPENING
        return [
            Row.at_least(name, "cannot: opening needed", opening, width, "mm"),
            Row.at_least(
                name, "and so it slips", 1e3 * MOST_SLIP, 1e3 * outcome.slip, "mm"
            ),
            *rows,
        ]
    turn, most_turn = np.rad2deg([outcome.turn, MOST_TURN])
    return [
        Row.at_least(name, "held, alone in the hand, for", HELD, outcome.held_for, "s"),
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
    """Say in a line what came of it, and in which colour."""
    slip, grip = 1e3 * outcome.slip, outcome.grip_force
    if not passed:
        return f"fails: {outcome.held_for:.1f} s, slips {slip:.1f} mm", COLORS[1]
    if not case.possible:
        wide = f"{1e3 * case.width:.0f} > {1e3 * OPENING:.0f} mm"
        return f"cannot: {wide}, slips {slip:.0f} mm", COLORS[6]
    return f"slips {slip:.1f} mm at {grip:.0f} N", COLORS[2]


def draw(pictures: Mapping[str, Picture]) -> Any:
    """Draw pictures of the end, by object from above and from the side below it.

    Args:
        pictures: By the case's name.
    """
    # What is taken in yet another way comes last.
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
