"""Where closing fingers bring a cylinder, and the frames that make up for it.

The thesis of the five-axis arm measured by hand how far the object shifts while its
fingers close, one after the other, and moved the tip of its arm by that. Here cycles
tell where in the palm the closed fingers hold the object: there the tip belongs, where
the planner takes a held object to be. More cycles, with that tip, tell where the object
ends beside its goal: so much it moves as it is set down and let go. A last round has
both corrections.

`SCENARIO_tip.dmd.yaml` has the two frames. With `--out models/calibration` it is the
one that the scenario uses, and those that are based on it.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drake_srg.common.errors import ScenarioError
from drake_srg.experiments.cycles import Cycle, run_cycle
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult, Row
from drake_srg.recording.figure import COLORS, make_figure, style_axes
from drake_srg.types import Vector

SCENARIO = "assistive_arm"
# The frames are measured with some positions, and judged with others.
SEEDS, JUDGED_SEEDS = range(100, 112), range(200, 212)
# What systematic error may be left in the hand, a tenth of the recess's clearance [mm].
_BIAS = 0.1
P_GRASP_CENTER = np.array([0.095, 0.0, 0.0])  # of the drawing, in the palm [m]
_FIGURES = ("shift while closing", "held beside the tip", "placed beside the goal")
STAGES = ("as drawn", "tip moved", "both")
_DIRECTIVES = """directives:
- add_frame:
    # Where a held object is.
    name: gripper::tip
    X_PF:
      base_frame: gripper::grasp_center
      translation: [{tip[0]:.6f}, {tip[1]:.6f}, 0.0]
- add_frame:
    # Where it ends in the palm's axes, set down and let go.
    name: gripper::released
    X_PF:
      base_frame: gripper::tip
      translation: [{shift[0]:.6f}, {shift[1]:.6f}, 0.0]
"""


def run(track: Track) -> ExperimentResult:
    """Measure as drawn, correct the tip, measure, correct the release, measure."""
    return calibrate(SCENARIO, track)


def calibrate(scenario: str, track: Track) -> ExperimentResult:
    """Calibrate the gripper of a scenario: `assistive_arm` or one based on it."""
    cases = [(stage, seed) for stage in STAGES[:-1] for seed in SEEDS]
    cases += [(STAGES[-1], seed) for seed in JUDGED_SEEDS]
    cycles: dict[str, list[Cycle]] = {stage: [] for stage in STAGES}
    tip = shift = np.zeros(3)
    with tempfile.TemporaryDirectory() as folder:
        for stage, seed in track(cases, lambda case: f"{case[0]}, seed {case[1]}"):
            if not cycles[stage]:  # a new stage begins
                if stage == "tip moved":
                    tip = mean("held", (c.p_GO_held for c in cycles["as drawn"]))
                    tip = tip - P_GRASP_CENTER
                elif stage == "both":
                    shift = mean("placed", (c.error_G for c in cycles["tip moved"]))
            cycle = calibration_cycle(scenario, seed, tip, shift, Path(folder))
            cycles[stage].append(cycle)
    return make_result(cycles, tip, shift, file_name(scenario))


def file_name(scenario: str) -> str:
    """Return the name of the file with a scenario's frames."""
    return f"{scenario}_tip.dmd.yaml"


def calibration_cycle(
    scenario: str, seed: int, tip: Vector, shift: Vector, folder: Path
) -> Cycle:
    """Run a cycle with the frames moved by `tip` and `shift` (3,) [m].

    They are written to a file in `folder`.
    """
    path = folder / file_name(scenario)
    path.write_text(_DIRECTIVES.format(tip=tip, shift=shift), encoding="utf-8")
    directive = f"{{add_directives: {{file: {path.as_uri()}}}}}"
    return run_cycle(scenario, seed, [f"directives.11={directive}"])


def mean(what: str, values: Iterable[Vector | None]) -> Vector:
    """Return the mean of those values (3,) that there are.

    Raises:
        ScenarioError: If half of them or more are missing.
    """
    every = list(values)
    there = [value for value in every if value is not None]
    if 2 * len(there) <= len(every):
        raise ScenarioError(
            f"grasp_calibration: only {len(there)} of {len(every)} cycles {what} the "
            "object; more than half are needed"
        )
    return np.asarray(np.mean(there, axis=0))


def make_result(
    cycles: Mapping[str, Sequence[Cycle]], tip: Vector, shift: Vector, file: str
) -> ExperimentResult:
    """Judge what the correction leaves; the frames go into `file`."""
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
            rows.append(Row.info(f"frame {name}", f"moved along {axis}", value, "mm"))
    names = ["stage", "seed", "seated"]
    names += [f"{what}, palm's {axis} [m]" for what in _FIGURES for axis in "xy"]
    columns = dict(zip(names, zip(*table, strict=True), strict=True))
    text = _DIRECTIVES.format(tip=tip, shift=shift)
    return ExperimentResult(rows, {"cycles": columns}, draw(cycles), {file: text})


def _figures(cycle: Cycle, p_GT: Vector) -> Vector:
    """The `_FIGURES` along the palm's x and y, (3, 2) [m]."""
    nothing = np.full(3, np.nan)
    opened, held, error = (
        nothing if value is None else value
        for value in (cycle.p_GO_open, cycle.p_GO_held, cycle.error_G)
    )
    return np.array([held - opened, held - p_GT, error])[:, :2]


def draw(cycles: Mapping[str, Sequence[Cycle]]) -> Any:
    """Draw the placement errors in the palm's axes, before and after."""
    figure = make_figure(5, 4, "beside the goal, in the palm's axes")
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
