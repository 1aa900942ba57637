"""Known boxes, balls and lying cans, picked and placed by the planner of `kitchen`.

The thing lies anywhere in the pick region, turned at will. The planner knows its shape
and its colour, and sees it with the ceiling camera. What lies is to be set upright.
"""

from __future__ import annotations

import dataclasses as dc
import functools
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drake_srg.common.exceptions import ScenarioError, suggest
from drake_srg.experiments.kept_trials import KeptTrials
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.experiments.table_shares import Share
from drake_srg.experiments.table_trials import run_trial
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.simulation.metrics import Metrics
from drake_srg.types import Vector

SCENARIO = "kitchen"
YAW = "object.yaw=!Uniform {min: -3.1416, max: 3.1416}"


def _lying(shape: str, height: float) -> tuple[str, ...]:
    """Return the overrides of a shape that lies, its middle at a height [m]."""
    place = (
        f"!UniformVector {{min: [0.45, -0.2, {height}], max: [0.75, 0.2, {height}]}}"
    )
    turn = "!Rpy {deg: !UniformVector {min: [90, 0, -180], max: [90, 0, 180]}}"
    pose = f"{{base_frame: world, translation: {place}, rotation: {turn}}}"
    return f"object.shape={shape}", f"object.pose={pose}"


def _box(least: Sequence[float], most: Sequence[float]) -> tuple[str, ...]:
    """Return the overrides of a box that stands, of a size between two (3,) [m]."""
    size = f"!UniformVector {{min: {list(least)}, max: {list(most)}}}"
    return f"object.shape=!Box {{size: {size}}}", YAW


# Overrides of the scenario. A ball rolls off a rigid table: nothing there resists that.
# So it is on the mat, with the facets that docs/speed.md asks for.
CASES: Mapping[str, tuple[str, ...]] = {
    "box": _box([0.03, 0.03, 0.05], [0.1, 0.1, 0.15]),
    "flat box": _box([0.04, 0.04, 0.02], [0.1, 0.1, 0.03]),
    "cracker box": _box([0.158, 0.066, 0.207], [0.158, 0.066, 0.207]),
    "lying can": _lying("!Cylinder {radius: 0.034, length: 0.102}", 0.034),
    "lying box": _lying("!Box {size: [0.05, 0.06, 0.12]}", 0.03),
    "ball": (
        "object.shape=!Sphere {radius: 0.035}",
        "object.resolution=0.0035",
        "plant_config.time_step=0.005",
        "arm.period=0.005",
        "directives.table.add_model.file=package://drake_srg/sdf/table_mat.sdf",
    ),
}
# Whatever its shape, the thing weighs about as much as the can.
_THING = ("object.model=null", "object.mass=0.3")
# Share of each case that must be placed.
LEAST = 0.95


@dc.dataclass(frozen=True)
class Trial:
    """A case and the seed of the thing's size and pose."""

    case: str
    seed: int

    def __str__(self) -> str:
        return f"{self.case}, seed {self.seed}"


_Runs = Mapping[str, Mapping[int, Metrics]]  # by case and seed


def run(
    track: Track,
    *,
    trials: int = 40,
    seed: int = 940_000,
    cases: Sequence[str] = (),
    keep: str = "",
) -> ExperimentResult:
    """Pick and place things of every case.

    Args:
        track: Shows progress.
        trials: Of each case.
        seed: Of the first trial.
        cases: Their names; all by default.
        keep: File of finished trials, with which a run that was cut off goes on.

    Raises:
        ScenarioError: If a case is unknown.
    """
    for case in cases:
        if case not in CASES:
            raise ScenarioError(
                f"known_shapes: cases: unknown {case!r} {suggest(case, CASES)}"
            )
    kept = KeptTrials(keep)
    runs: dict[str, dict[int, Metrics]] = {case: {} for case in cases or CASES}
    for trial in track([Trial(c, seed + i) for i in range(trials) for c in runs]):
        overrides = (*_THING, *CASES[trial.case])
        made = functools.partial(run_trial, SCENARIO, overrides, trial.seed)
        runs[trial.case][trial.seed] = Metrics(**kept(str(trial), made))
    return ExperimentResult(judge(runs), {"trials": columns(runs)}, draw(runs))


def placed(runs: Mapping[int, Metrics]) -> Share:
    """Return the share of trials that end with the thing upright on its goal."""
    return Share(sum(m.success for m in runs.values()), len(runs))


def distances(runs: Mapping[int, Metrics]) -> Vector:
    """Return how far from the goal what was placed ends in the plane, (K,) [mm]."""
    errors = [m.placement_error_m for m in runs.values() if m.success]
    return np.array([1e3 * np.linalg.norm(e[:2]) for e in errors if e is not None])


def judge(runs: _Runs) -> list[Row]:
    """Expect that most of every case are placed; state how near, and what fails."""
    rows = []
    for case, own in runs.items():
        share = placed(own)
        low, high = share.bounds
        spread = 0.05
        rows += [
            Row.info(case, "trials", len(own), "", spread=1.0),
            Row.at_least(case, "placed", LEAST, share.value, "", spread=spread),
            Row.info(case, "placed, at least", low, "", spread=spread),
            Row.info(case, "placed, at most", high, "", spread=spread),
        ]
        first = sum(m.success and m.attempts == 1 for m in own.values())
        rows.append(Row.info(case, "at the first attempt", first / len(own), ""))
        if len(apart := distances(own)):
            for what, value in (
                ("median", float(np.median(apart))),
                ("largest", float(apart.max())),
            ):
                quantity = f"distance from the goal, {what}"
                rows.append(Row.info(case, quantity, value, "mm", spread=0.5))
        failed = Counter(m.failure for m in own.values() if not m.success)
        for reason, count in sorted(failed.items()):
            rows.append(Row.info(case, f"{reason}", count, "trials", spread=2.0))
    return rows


def columns(runs: _Runs) -> dict[str, list[Any]]:
    """Return a line of the table for each trial."""
    table: dict[str, list[Any]] = {}
    for case, own in runs.items():
        for seed, m in own.items():
            x, y, _ = m.placement_error_m or (np.nan,) * 3
            for column, value in (
                ("case", case),
                ("seed", seed),
                ("placed", int(m.success)),
                ("failure", m.failure or ""),
                ("attempts", m.attempts),
                ("placement error x [m]", x),
                ("placement error y [m]", y),
                ("cycle [s]", np.nan if m.cycle_time_s is None else m.cycle_time_s),
            ):
                table.setdefault(column, []).append(value)
    return table


def draw(runs: _Runs, title: str = "Known shapes, picked and placed") -> Any:
    """Draw the share that is placed, and how near to the goal, for each case."""
    figure = make_figure(9.0, 1.4 + 0.4 * len(runs), title)
    left, right = figure.subplots(1, 2, sharey=True)
    style_axes(left, xlabel="share placed, with its 95 % interval")
    style_axes(right, xlabel="distance from the goal [mm]")
    y = np.arange(len(runs))[::-1]
    shares = [placed(own) for own in runs.values()]
    values = np.array([share.value for share in shares])
    low, high = np.transpose([share.bounds for share in shares])
    errors = np.maximum([values - low, high - values], 0.0)
    left.errorbar(values, y, xerr=errors, fmt="o", color=COLORS[0])
    left.axvline(LEAST, color=COLORS[1], lw=1.0, ls="--")
    left.set_xlim(0.0, 1.02)
    left.set_yticks(y, runs)
    for at, own in zip(y, runs.values(), strict=True):
        apart = distances(own)
        right.plot(apart, np.full(len(apart), at), "|", ms=9, color=COLORS[0])
    right.set_xlim(left=0.0)
    return figure
