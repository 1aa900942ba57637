"""Where closing fingers bring a cylinder, and the tip frame that makes up for it.

The thesis of the five-axis arm measured by hand how far the object shifts while its
fingers close, one after the other, and moved the tip of its arm by that. Here cycles
without a correction by sight tell how far beside the recess the object ends; the tip,
where the planner takes a held object to be, is moved by the mean, and the cycles are
run again. `assistive_arm_tip.dmd.yaml` is the frame; written to the models' folder
`calibration`, it is the one that the scenarios use.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from drake_srg.errors import ScenarioError
from drake_srg.experiments.cycles import Cycle, run_cycle
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult, Row
from drake_srg.recording.figure import COLORS, make_figure, style_axes
from drake_srg.types import Vector

SCENARIO = "assistive_arm"
FILE = "assistive_arm_tip.dmd.yaml"
SEEDS = range(20)
# What systematic error may be left, a tenth of the recess's radial clearance [mm].
_BIAS = 0.1
_DIRECTIVE = """directives:
- add_frame:
    name: gripper::tip
    X_PF:
      base_frame: gripper::grasp_center
      translation: [{x:.6f}, {y:.6f}, 0.0]
"""


def run(track: Track) -> ExperimentResult:
    """Measure with the tip as drawn, correct it, and measure again."""
    cases = [(stage, seed) for stage in ("as drawn", "corrected") for seed in SEEDS]
    cycles: dict[str, list[Cycle]] = {"as drawn": [], "corrected": []}
    tip = np.zeros(3)
    for stage, seed in track(cases, lambda case: f"tip {case[0]}, seed {case[1]}"):
        if stage == "corrected" and not cycles[stage]:
            tip = correction(cycles["as drawn"])
        cycles[stage].append(calibration_cycle(seed, tip))
    return make_result(cycles, tip)


def calibration_cycle(seed: int, tip: Vector) -> Cycle:
    """Run a cycle with the tip frame moved by `tip` (3,) [m] from the drawing."""
    frame = (
        "{add_frame: {name: gripper::tip, X_PF: {base_frame: gripper::grasp_center, "
        f"translation: {tip.tolist()}}}}}}}"
    )
    overrides = [f"directives.11={frame}", "planner.look_before_place=false"]
    return run_cycle(SCENARIO, seed, overrides)


def correction(cycles: Sequence[Cycle]) -> Vector:
    """Return what the tip is to be moved by, in the palm's x and y, (3,) [m].

    An object that ends in front of its goal was further out in the hand, or was pushed
    out when it was let go; either way the tip is moved to where it ends.

    Raises:
        ScenarioError: If fewer than half of the cycles placed the object.
    """
    errors = [c.error_G for c in cycles if c.metrics.success and c.error_G is not None]
    if 2 * len(errors) < len(cycles):
        raise ScenarioError(
            f"grasp_calibration: only {len(errors)} of {len(cycles)} cycles placed "
            "the object; more than half are needed"
        )
    mean = np.mean(errors, axis=0)
    return np.array([mean[0], mean[1], 0.0])  # the recess's floor sets the height


def make_result(cycles: dict[str, list[Cycle]], tip: Vector) -> ExperimentResult:
    """Judge what the correction leaves."""
    rows, columns = [], []
    for stage, runs in cycles.items():
        good = [c for c in runs if c.metrics.success]
        rows.append(Row.at_least(stage, "seated", len(runs), len(good), ""))
        shifts = [
            1e3 * (c.p_GO_held - c.p_GO_open)
            for c in good
            if c.p_GO_held is not None and c.p_GO_open is not None
        ]
        errors = [1e3 * c.error_G for c in good if c.error_G is not None]
        for what, values in (("shift while closing", shifts), ("placement", errors)):
            for i, axis in enumerate("xy"):
                along = np.array([v[i] for v in values])
                mean = float(np.mean(along)) if len(along) else np.nan
                name = f"mean {what}, palm's {axis}"
                if stage == "corrected" and what == "placement":
                    rows.append(Row.within(stage, name, 0, mean, "mm", absolute=_BIAS))
                else:
                    rows.append(Row.info(stage, name, mean, "mm"))
        for c in runs:
            shift = (
                c.p_GO_held - c.p_GO_open
                if c.p_GO_held is not None and c.p_GO_open is not None
                else np.full(3, np.nan)
            )
            error = c.error_G if c.error_G is not None else np.full(3, np.nan)
            columns.append(
                (stage, c.seed, int(c.metrics.success), *shift[:2], *error[:2])
            )
    names = ("tip", "seed", "seated", *(f"shift {a} [m]" for a in "xy"))
    names = (*names, *(f"placement error {a} [m]" for a in "xy"))
    for i, axis in enumerate("xy"):
        rows.append(Row.info("tip frame", f"moved along {axis}", 1e3 * tip[i], "mm"))
    table = dict(zip(names, zip(*columns, strict=True), strict=True))
    text = _DIRECTIVE.format(x=tip[0] + 0.0, y=tip[1] + 0.0)
    return ExperimentResult(rows, {"cycles": table}, draw(cycles), {FILE: text})


def draw(cycles: dict[str, list[Cycle]]) -> Any:
    """Draw the placement errors in the palm's axes, before and after."""
    figure = make_figure(5, 4, "placed without a look, in the palm's axes")
    axes = figure.subplots()
    style_axes(axes, xlabel="x, out of the palm [mm]", ylabel="y [mm]")
    for color, (stage, runs) in zip(COLORS, cycles.items(), strict=False):
        errors = np.array([1e3 * c.error_G for c in runs if c.error_G is not None])
        if len(errors):
            axes.plot(*errors[:, :2].T, "o", ms=4, color=color, label=f"tip {stage}")
    axes.axhline(0, color=COLORS[-1], lw=0.5)
    axes.axvline(0, color=COLORS[-1], lw=0.5)
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(fontsize=8)
    return figure
