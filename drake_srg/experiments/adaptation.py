"""Adaptive or preprogrammed: what looking is worth to the five-axis arm.

The arm takes the cylinder from a pose that it was taught, or from where it has seen it
at the beginning, or looks again before the grasp and before placing. The cylinder
stands where it was taught, anywhere in the pick region, or is pushed away during the
approach. Every method has one attempt. This is the third research question of the arm's
thesis.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drake_srg.experiments.cycles import Cycle, run_cycle
from drake_srg.experiments.localization import ACTUAL
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.experiments.trials import (
    PLACED,
    bounds,
    line,
    outcomes,
    quantile_rows,
    share_rows,
)
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.types import Vector

SCENARIO = "assistive_arm_fast"
# P0 is that of `assistive_arm_thesis`: beside the recess, where a hand that goes there
# on a straight line does not touch the cylinder.
_HOME = "arm.home=[-1.391, -0.17, 0.29, 0.0, -0.1162]"
_ONCE = "planner.max_attempts=1"
FIXED, ONE_LOOK, LOOKS = "fixed pose", "one look", "looks before grasp and placing"
# P2 is the taught cylinder's middle. P4 sets it into the recess, P3 is 30 mm above.
_TAUGHT = (
    f"planner=!Taught {{grasp: {ACTUAL.tolist()}, "
    "lift: [-1.567, 0.3551, -0.1627, 0.0003, -0.1926], "
    "place: [-1.567, 0.3933, -0.0757, 0.0004, -0.3138], "
    # The rest is as in `assistive_arm_fast`.
    "time_budget: 60, period: 0.01171875, clearance: 0.005, hand_clearance: 0.0025, "
    "payload: 0.03}"
)
# Nothing tells this method when the object is safe: it waits as long as ours verifies a
# grasp, and as the thesis waits for the open hand.
_WAITS = ("planner.grip_wait=0.1", "planner.release_wait=0.5")
METHODS: Mapping[str, tuple[str, ...]] = {
    FIXED: (_HOME, _TAUGHT, *_WAITS),
    ONE_LOOK: (
        *(_HOME, _ONCE),
        "planner.look_before_grasp=false",
        "planner.look_before_place=false",
    ),
    LOOKS: (_HOME, _ONCE),
}
AS_TAUGHT, ANYWHERE, PUSHED = "where it was taught", "anywhere", "pushed"
SITUATIONS = (AS_TAUGHT, ANYWHERE, PUSHED)
# How far the cylinder is pushed [m]: the open fingers leave 17 mm on each side.
_PUSH = (0.01, 0.04)
# Trials of a quick run: enough for intervals that tell 9 of 10 from none.
_QUICK = 10

_Runs = Mapping[tuple[str, str], Sequence[Cycle]]


def run(track: Track, *, trials: int = 100, quick: bool = False) -> ExperimentResult:
    """Run every method in every situation.

    Args:
        track: Shows progress.
        trials: Number of trials of each method in each situation, a seed each.
        quick: Whether to run 10 trials only.
    """
    seeds = range(_QUICK if quick else trials)
    cases = list(itertools.product(METHODS, SITUATIONS, seeds))
    runs: dict[tuple[str, str], list[Cycle]] = {
        pair: [] for pair in itertools.product(METHODS, SITUATIONS)
    }
    for method, situation, seed in track(cases, lambda case: ", ".join(map(str, case))):
        overrides = (*METHODS[method], *situation_overrides(situation, seed))
        runs[method, situation].append(run_cycle(SCENARIO, seed, overrides))
    lines = [
        {"method": method, "situation": situation, **line(cycle)}
        for (method, situation), cycles in runs.items()
        for cycle in cycles
    ]
    table = {name: [line[name] for line in lines] for name in lines[0]}
    return ExperimentResult(judge(runs), {"trials": table}, draw(runs))


def situation_overrides(situation: str, seed: int) -> tuple[str, ...]:
    """Return where the cylinder stands, and what happens to it, as overrides."""
    if situation == ANYWHERE:
        return ()
    place = f"object.position={ACTUAL[:2].tolist()}"
    if situation == AS_TAUGHT:
        return (place,)
    rng = np.random.default_rng(seed)
    azimuth, distance = rng.uniform(-np.pi, np.pi), rng.uniform(*_PUSH)
    moved = [float(distance * np.cos(azimuth)), float(distance * np.sin(azimuth)), 0.0]
    push = f"!Push {{at: pre_grasp, after: 0.1, displacement: {moved}, duration: 0.3}}"
    return (place, f"disturbances=[{push}]")


def judge(runs: _Runs) -> list[Row]:
    """State shares with intervals and medians; expect looking to pay where it must.

    Where the cylinder is not where it was taught, a method that sees it must be better
    than the fixed pose beyond doubt: its interval lies above the other's. The same
    holds for a second look after a push.
    """
    rows = []
    for (method, situation), cycles in runs.items():
        case = f"{situation}: {method}"
        rows += share_rows(case, cycles)
        for what, (values, unit) in medians(cycles).items():
            rows += quantile_rows(case, what, values, unit)
    better = (
        (ANYWHERE, ONE_LOOK, FIXED),
        (ANYWHERE, LOOKS, FIXED),
        (PUSHED, LOOKS, FIXED),
        (PUSHED, LOOKS, ONE_LOOK),
    )
    for situation, method, other in better:
        (low, _), (_, high) = (
            bounds(runs[name, situation]) for name in (method, other)
        )
        quantity = f"placed: least share with {method}; expected: most with {other}"
        rows.append(Row.at_least(situation, quantity, high, low, "", spread=0.05))
    return rows


def medians(cycles: Sequence[Cycle]) -> dict[str, tuple[Vector, str]]:
    """Return figures of the trials that placed the cylinder, and their units."""
    placed = [c.metrics for c in cycles if c.metrics.success]

    def known(values: Sequence[float | None]) -> Vector:
        return np.array([value for value in values if value is not None], dtype=float)

    errors = [
        1e3 * float(np.linalg.norm(m.placement_error_m[:2]))
        for m in placed
        if m.placement_error_m is not None
    ]
    return {
        "placement error": (known(errors), "mm"),
        "time to placement": (known([m.time_to_placement_s for m in placed]), "s"),
        "cycle": (known([m.cycle_time_s for m in placed]), "s"),
        "smoothness": (known([m.smoothness for m in placed]), ""),
    }


def draw(runs: _Runs) -> Any:
    """Draw shares with their intervals, errors and times, by situation and method."""
    count = len(next(iter(runs.values())))
    title = f"Adaptive or preprogrammed: {count} trials of each"
    figure = make_figure(11.0, 4.6, title)
    shares, errors, times = figure.subplots(1, 3)
    style_axes(shares, ylabel="placed, share with 95 % interval")
    style_axes(errors, ylabel="placement error [mm]")
    style_axes(times, ylabel="time to placement [s]")
    at = np.arange(len(SITUATIONS))
    for k, (method, color) in enumerate(zip(METHODS, COLORS, strict=False)):
        for i, situation in enumerate(SITUATIONS):
            cycles, x = runs[method, situation], i + 0.25 * (k - 1)
            placed = float(np.mean(outcomes(cycles)[PLACED]))
            low, high = bounds(cycles)
            label = method if i == 0 else None
            shares.bar(x, placed, 0.22, color=color, label=label)
            shares.plot([x, x], [low, high], color=COLORS[-1], lw=1.2)
            figures = medians(cycles)
            for axes, what in (
                (errors, "placement error"),
                (times, "time to placement"),
            ):
                values, _ = figures[what]
                if len(values):
                    low, middle, high = np.quantile(values, (0.05, 0.5, 0.95))
                    axes.plot([x, x], [low, high], color=color, lw=2.0)
                    axes.plot(x, middle, "o", color=color, ms=5)
    shares.set_ylim(0.0, 1.05)
    errors.set_title("median, 5 to 95 %, of those placed", fontsize=9, loc="left")
    for axes in (shares, errors, times):
        axes.set_xticks(at, SITUATIONS, fontsize=8)
    figure.legend(loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return figure
