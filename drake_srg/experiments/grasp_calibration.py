"""Where closing fingers move a cylinder, and the frames that correct for it.

The thesis of the five-axis arm measured by hand how far the object shifts while its
fingers close, one after the other, and moved the arm's tip by that distance. Here, a
first round of cycles measures where in the palm the closed fingers hold the object. The
tip frame belongs there, because the planner assumes a held object to be at the tip. A
second round, with that tip, measures how far from its goal the object ends: the
distance that it moves while it is set down and released. A last round applies both
corrections.

`SCENARIO_tip.dmd.yaml` contains the two frames. `--out models/calibration` overwrites
the file that the scenario and those based on it use.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments.cycles import Cycle, run_cycle
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.types import Vector

EXPERIMENTS = {
    "grasp_calibration": (
        "Where closing fingers move a cylinder, and the frames that correct for it.",
        {"scenario": "assistive_arm"},
    ),
    "grasp_calibration_fast": (
        "The same frames for the fast scenario of the five-axis arm.",
        {"scenario": "assistive_arm_fast"},
    ),
}
# The frames are measured at some positions and judged at others: first seed of each.
FIRST_SEED, FIRST_JUDGED_SEED = 100, 200
# Systematic error allowed after correction: a tenth of the recess's clearance [mm].
_BIAS = 0.1
P_GRASP_CENTER = np.array([0.095, 0.0, 0.0])  # as drawn, in the palm frame [m]
_FIGURES = (
    "shift while closing",
    "offset from the tip when held",
    "offset from the goal when placed",
)
STAGES = ("as drawn", "tip corrected", "both corrected")
_DIRECTIVES = """directives:
- add_frame:
    # Where a held object is.
    name: gripper::tip
    X_PF:
      base_frame: gripper::grasp_center
      translation: [{tip[0]:.6f}, {tip[1]:.6f}, 0.0]
- add_frame:
    # Where it ends in the palm's axes after it is set down and released.
    name: gripper::released
    X_PF:
      base_frame: gripper::tip
      translation: [{shift[0]:.6f}, {shift[1]:.6f}, 0.0]
"""


def run(
    track: Track, *, scenario: str = "assistive_arm", seeds: int = 12
) -> ExperimentResult:
    """Measure as drawn, correct the tip, measure, correct the release, measure.

    Args:
        track: Shows progress.
        scenario: `assistive_arm` or a scenario based on it.
        seeds: Number of cycles in each of the three rounds.
    """
    firsts = (FIRST_SEED, FIRST_SEED, FIRST_JUDGED_SEED)
    cases = [
        (stage, first + i)
        for stage, first in zip(STAGES, firsts, strict=True)
        for i in range(seeds)
    ]
    cycles: dict[str, list[Cycle]] = {stage: [] for stage in STAGES}
    tip = shift = np.zeros(3)
    with tempfile.TemporaryDirectory() as folder:
        for stage, seed in track(cases, lambda case: f"{case[0]}, seed {case[1]}"):
            if not cycles[stage]:  # a new stage begins
                if stage == STAGES[1]:
                    tip = mean("held", (c.p_GO_held for c in cycles[STAGES[0]]))
                    tip = tip - P_GRASP_CENTER
                elif stage == STAGES[2]:
                    shift = mean("placed", (c.error_G for c in cycles[STAGES[1]]))
            cycle = calibration_cycle(scenario, seed, tip, shift, Path(folder))
            cycles[stage].append(cycle)
    return make_result(cycles, tip, shift, file_name(scenario))


def file_name(scenario: str) -> str:
    """Return the name of the file that contains a scenario's frames."""
    return f"{Path(scenario).stem}_tip.dmd.yaml"


def calibration_cycle(
    scenario: str, seed: int, tip: Vector, shift: Vector, folder: Path
) -> Cycle:
    """Run a cycle with corrected frames.

    Args:
        scenario: Name of the scenario.
        seed: Of the scenario.
        tip: Correction of the tip in the palm frame, shape (3,) [m].
        shift: Correction of the release in the palm frame, shape (3,) [m].
        folder: For the file that contains the frames.
    """
    path = folder / file_name(scenario)
    path.write_text(_DIRECTIVES.format(tip=tip, shift=shift), encoding="utf-8")
    directive = f"{{add_directives: {{file: {path.as_uri()}}}}}"
    return run_cycle(
        scenario, seed, [f"directives.{path.name.partition('.')[0]}={directive}"]
    )


def mean(verb: str, values: Iterable[Vector | None]) -> Vector:
    """Return the mean of the values (3,) that are not None.

    Args:
        verb: What cycles with a value did to the object, for the error.
        values: One per cycle.

    Raises:
        ScenarioError: If half of the values or more are missing.
    """
    every = list(values)
    known = [value for value in every if value is not None]
    if 2 * len(known) <= len(every):
        raise ScenarioError(
            f"grasp_calibration: only {len(known)} of {len(every)} cycles {verb} the "
            "object; needs more than half"
        )
    return np.asarray(np.mean(known, axis=0))


def make_result(
    cycles: Mapping[str, Sequence[Cycle]], tip: Vector, shift: Vector, file: str
) -> ExperimentResult:
    """Judge the errors that remain after correction.

    Args:
        cycles: By stage.
        tip: Correction of the tip, shape (3,) [m].
        shift: Correction of the release, shape (3,) [m].
        file: Name of the file for the frames.
    """
    rows, table = [], []
    for stage, runs in cycles.items():
        at = P_GRASP_CENTER + (0.0 if stage == STAGES[0] else tip)
        data = np.array([_figures(cycle, at) for cycle in runs])  # (runs, 3, 2)
        seated = [int(c.metrics.success) for c in runs]
        rows.append(Row.info(stage, "seated", sum(seated), f"of {len(runs)}"))
        for i, what in enumerate(_FIGURES):
            for axis, mean in zip(
                "xy", 1e3 * np.nanmean(data[:, i], axis=0), strict=True
            ):
                quantity = f"mean {what}, palm's {axis}"
                if stage == STAGES[-1] and i > 0:
                    row = Row.within(stage, quantity, 0.0, mean, "mm", absolute=_BIAS)
                else:
                    row = Row.info(stage, quantity, mean, "mm")
                rows.append(row)
        for cycle, ok, figures in zip(runs, seated, data, strict=True):
            table.append((stage, cycle.seed, ok, *figures.flatten()))
    for name, moved in (("tip", tip), ("released", shift)):
        for axis, value in zip("xy", 1e3 * moved[:2], strict=True):
            quantity = f"correction along {axis}"
            rows.append(Row.info(f"frame {name}", quantity, value, "mm"))
    names = ["stage", "seed", "seated"]
    names += [f"{what}, palm's {axis} [m]" for what in _FIGURES for axis in "xy"]
    columns = dict(zip(names, zip(*table, strict=True), strict=True))
    text = _DIRECTIVES.format(tip=tip, shift=shift)
    return ExperimentResult(rows, {"cycles": columns}, draw(cycles), {file: text})


def _figures(cycle: Cycle, p_GT: Vector) -> Vector:
    """Return the `_FIGURES` along the palm's x and y, shape (3, 2) [m]."""
    unknown = np.full(3, np.nan)
    opened, held, error = (
        unknown if value is None else value
        for value in (cycle.p_GO_open, cycle.p_GO_held, cycle.error_G)
    )
    return np.array([held - opened, held - p_GT, error])[:, :2]


def draw(cycles: Mapping[str, Sequence[Cycle]]) -> Any:
    """Draw the placement errors in the palm's axes, before and after correction."""
    figure = make_figure(5, 4, "Placement error in the palm's axes")
    axes = figure.subplots()
    style_axes(axes, xlabel="x, out of the palm [mm]", ylabel="y [mm]")
    for color, (stage, runs) in zip(COLORS, cycles.items(), strict=False):
        errors = np.array([1e3 * c.error_G for c in runs if c.error_G is not None])
        if len(errors):
            axes.plot(*errors[:, :2].T, "o", ms=4, color=color, label=stage)
    axes.axhline(0, color=COLORS[-1], lw=0.5)
    axes.axvline(0, color=COLORS[-1], lw=0.5)
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(fontsize=8)
    return figure
