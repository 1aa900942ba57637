"""The shift of a cylinder by closing fingers, and the frames that correct for it.

The thesis of the five-axis arm measured by hand how far the object shifts while the
fingers close. It moved the arm's tip frame by that distance. Here, a first round of
cycles measures where in the palm the closed fingers hold the object. The tip frame
moves there.

A second round, with that tip, measures how far the object ends from its goal, because
it moves while it is set down and released. A last round, at other places, applies both
corrections.

`--out models/calibration` overwrites the frames, SCENARIO_tip.dmd.yaml, that the
scenario and those based on it use.
"""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import experiments.runner as ex
from drake_srg.common.exceptions import ScenarioError
from drake_srg.types import Vector
from experiments.stands.cycles import run_cycle

# The frames are measured at some positions and judged at others: first seed of each.
STAGES = {"as drawn": 100, "tip corrected": 100, "both corrected": 200}
_P_GRASP_CENTER = np.array([0.095, 0.0, 0.0])  # as drawn, in the palm frame [m]
FIGURES = (
    "shift while closing",
    "offset from the tip when held",
    "offset from the goal when placed",
)
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


def cases(scenario: str = "assistive_arm", seeds: int = 12) -> list[ex.Case]:
    """Measure as drawn, correct the tip, measure, correct the release, measure.

    Args:
        scenario: `assistive_arm` or a scenario based on it.
        seeds: Cycles in each of the three rounds.
    """
    return [{"scenario": scenario, "seeds": seeds}]


def file_name(scenario: str) -> str:
    return f"{Path(scenario).stem}_tip.dmd.yaml"


def trial(scenario: str, seeds: int) -> ex.Measures:
    """Run all rounds, each with the frames that the one before gives."""
    frames = {"tip": np.zeros(3), "shift": np.zeros(3)}
    found: ex.Measures = {"seated": {}, "means": {}}
    for stage, first in STAGES.items():
        cycles = [cycle_with(scenario, first + i, frames) for i in range(seeds)]
        moved, at, error = (
            np.array([np.full(3, np.nan) if c[key] is None else c[key] for c in cycles])
            for key in ("shift", "held_at", "error_G")
        )
        from_tip = at - _P_GRASP_CENTER - frames["tip"]
        found["seated"][stage] = sum(cycle["placed"] for cycle in cycles)
        found["means"][stage] = [
            np.nanmean(values[:, :2], axis=0) for values in (moved, from_tip, error)
        ]
        found |= {
            f"{stage}, {axis} [mm]": 1e3 * error[:, i] for i, axis in enumerate("xy")
        }
        if stage == "as drawn":
            frames["tip"] = mean("held", at) - _P_GRASP_CENTER
        elif stage == "tip corrected":
            frames["shift"] = mean("placed", error)
    return found | frames


def cycle_with(scenario: str, seed: int, frames: Mapping[str, Vector]) -> ex.Measures:
    """Run a cycle with corrected frames (3,) [m], in the palm frame."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / file_name(scenario)
        path.write_text(_DIRECTIVES.format_map(frames), encoding="utf-8")
        directive = f"{{add_directives: {{file: {path.as_uri()}}}}}"
        name = path.name.partition(".")[0]
        return run_cycle(scenario, seed, [f"directives.{name}={directive}"])


def mean(verb: str, values: Vector) -> Vector:
    """Return the mean of rows (n, 3), one a cycle, without those that are NaN.

    Raises:
        ScenarioError: If only half of the cycles or fewer did to the object what `verb`
            says.
    """
    known = values[~np.isnan(values[:, 0])]
    if 2 * len(known) <= len(values):
        raise ScenarioError(
            f"grasp_calibration: only {len(known)} of {len(values)} cycles {verb} the "
            "object; needs more than half"
        )
    return np.asarray(known.mean(axis=0))


def whole(trials: ex.Trials) -> dict[str, ex.Values]:
    (t,) = trials
    found: dict[str, ex.Values] = {}
    for stage, means in t["means"].items():
        found[stage] = {f"seated [of {t['seeds']}]": t["seated"][stage]}
        for what, values in zip(FIGURES, means, strict=True):
            # A systematic error of a tenth of the recess's clearance is allowed.
            judged = stage == "both corrected" and what != FIGURES[0]
            bound = ex.within(0.0, absolute=0.1) if judged else ex.number()
            for axis, value in zip("xy", 1e3 * values, strict=True):
                found[stage][f"mean {what}, palm's {axis} [mm]"] = (value, bound)
    for frame, moved in (("tip", t["tip"]), ("released", t["shift"])):
        found[f"frame {frame}"] = {
            f"correction along {axis} [mm]": value
            for axis, value in zip("xy", 1e3 * moved[:2], strict=True)
        }
    return found


COMMON: dict[str, Any] = {
    "cases": cases,
    "trial": trial,
    "whole": whole,
    "picture": [
        ex.Points(f"{stage}, x [mm]", f"{stage}, y [mm]", title=stage)
        for stage in STAGES
    ],
    "files": lambda trials: {
        file_name(trials[0]["scenario"]): _DIRECTIVES.format_map(trials[0])
    },
}
grasp_calibration = ex.Experiment(
    "The shift of a cylinder by closing fingers, and frames that correct for it.",
    preset={"scenario": "assistive_arm"},
    **COMMON,
)
grasp_calibration_fast = ex.Experiment(
    "The same frames for the fast scenario of the five-axis arm.",
    preset={"scenario": "assistive_arm_fast"},
    **COMMON,
)
