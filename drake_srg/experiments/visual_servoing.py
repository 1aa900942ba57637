"""Grasping by looking once, looking twice and visual servoing: motion, calibration.

The can stands on a tray that moves, or the camera is not where it is believed to be. A
trial ends once the can is lifted and held, or the first attempt has failed. See
`servo_trials` for what the four ways of looking are.
"""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drake_srg.experiments.grasp_rows import (
    LEAST_HELD,
    MOST_OFF,
    error_rows,
    grasp_errors,
    held_rows,
)
from drake_srg.experiments.kept_trials import KeptTrials
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.experiments.servo_trials import (
    METHODS,
    Case,
    Grasped,
    grasp_once,
    trial_order,
)
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.sweeps.statistics import wilson_interval

CASES = (
    Case(0.0),
    Case(0.02),
    Case(0.05),
    Case(distance=0.010, angle=np.deg2rad(2.5)),
    Case(distance=0.020, angle=np.deg2rad(5.0)),
)
SERVOS = ("pbvs", "ibvs")
# The criteria are those of `grasp_rows`. All methods must grasp an object at rest with
# a good calibration. With half the step, no more of a servo's trials may end otherwise
# than it may lose, and the grasp error may change by a sixth of its limit (median).
_MOST_OTHERWISE, _MOST_CHANGED = 1.0 - LEAST_HELD, 0.5e-3
_HALF = ("simulator_config.max_step_size=0.005859375", "simulator_config.accuracy=1e-4")

_Results = Mapping[tuple[Case, str], Sequence[Grasped]]


def run(
    track: Track,
    *,
    trials: int = 200,
    first_seed: int = 910_000,
    half: int = 20,
    keep: str = "",
) -> ExperimentResult:
    """Run the experiment.

    Args:
        track: Shows progress.
        trials: Grasps per case and method.
        first_seed: Seed of the first trial; the others follow.
        half: Trials of these per case and servo that run again with half the step.
        keep: File of finished trials, with which a run that was cut off goes on.
    """
    kept = KeptTrials(keep)
    order = trial_order(CASES, METHODS, range(first_seed, first_seed + trials))
    again = [
        (case, method, seed)
        for case, method, seed in order
        if method in SERVOS and seed < first_seed + half
    ]
    steps: list[tuple[tuple[Case, str, int], str, tuple[str, ...]]] = [
        *((trial, "", ()) for trial in order),
        *((trial, "/half", _HALF) for trial in again),
    ]
    results: dict[tuple[Case, str], list[Grasped]] = {}
    halved: dict[tuple[Case, str], list[Grasped]] = {}
    for (case, method, seed), name, settings in track(steps, lambda s: _name(s[0])):
        trial = functools.partial(_trial, case, method, seed, settings)
        result = kept(f"{case}/{method}/{seed}{name}", trial)
        made = halved if name else results
        made.setdefault((case, method), []).append(Grasped(**result))
    lines: list[dict[str, Any]] = [
        {
            "case": str(case),
            "method": method,
            "seed": first_seed + i,
            "held": int(grasped.held),
            "error [m]": np.nan if grasped.error is None else grasped.error,
            "across [m]": np.nan if grasped.across is None else grasped.across,
            "reason": grasped.reason,
        }
        for (case, method), made in results.items()
        for i, grasped in enumerate(made)
    ]
    table: dict[str, Any] = {key: [line[key] for line in lines] for key in lines[0]}
    rows = [*_rows(results), *_half_step_rows(results, halved)]
    return ExperimentResult(rows, {"trials": table}, _figure(results))


def _name(trial: tuple[Case, str, int]) -> str:
    return f"{trial[0]}, {trial[1]}"


def _trial(
    case: Case, method: str, seed: int, overrides: Sequence[str]
) -> dict[str, Any]:
    return dc.asdict(grasp_once(case, method, seed, overrides))


def _rows(results: _Results) -> list[Row]:
    rows = []
    for (case, method), made in results.items():
        name, servo = f"{case}, {method}", method in SERVOS
        rows += held_rows(name, made, judged=servo or case == CASES[0])
        rows += error_rows(name, made, judged=servo)
    return rows


def _half_step_rows(results: _Results, halved: _Results) -> list[Row]:
    """Compare the first trials of both servos with the same ones at half the step."""
    rows = []
    for method in SERVOS:
        pairs = [
            (trial, other)
            for (case, m), others in halved.items()
            if m == method
            for trial, other in zip(results[case, m], others, strict=False)
        ]
        if not pairs:
            continue
        name = f"{method}, half the step"
        otherwise = float(np.mean([a.held != b.held for a, b in pairs]))
        changes = [
            abs(a.error - b.error)
            for a, b in pairs
            if a.error is not None and b.error is not None
        ]
        rows += [
            Row.info(name, "trials", len(pairs), "", spread=0.5),
            Row.at_most(
                name,
                "end otherwise, share",
                _MOST_OTHERWISE,
                otherwise,
                "",
                spread=0.05,
            ),
            Row.at_most(
                name,
                "change of the grasp error, median",
                _MOST_CHANGED,
                float(np.median(changes)) if changes else np.inf,
                "m",
            ),
        ]
    return rows


def _figure(results: _Results) -> Any:
    figure = make_figure(8.0, 6.0)
    upper, lower = figure.subplots(2, 1, sharex=True)
    style_axes(upper, ylabel="lifted and held, 95 % interval")
    style_axes(lower, ylabel="grasp error [mm]")
    cases = list(dict.fromkeys(case for case, _ in results))
    at, width = np.arange(len(cases)), 0.8 / len(METHODS)
    for i, method in enumerate(METHODS):
        x = at + (i - 0.5 * (len(METHODS) - 1)) * width
        made = [results[case, method] for case in cases]
        share = np.array([np.mean([g.held for g in m]) for m in made])
        bounds = [wilson_interval(sum(g.held for g in m), len(m)) for m in made]
        low, high = np.array(bounds).T
        style = {"color": COLORS[i], "label": method}
        upper.bar(
            x, share, width=0.9 * width, yerr=[share - low, high - share], **style
        )
        for j, m in enumerate(made):
            errors = 1e3 * grasp_errors(m)
            if len(errors):
                box = lower.boxplot(
                    errors, positions=[x[j]], widths=0.8 * width, whis=(5, 95), sym=""
                )
                for part in (*box["boxes"], *box["medians"], *box["whiskers"]):
                    part.set_color(COLORS[i])
    lower.axhline(1e3 * MOST_OFF, color="#333333", lw=0.8, ls="--")
    lower.set_yscale("log")
    lower.set_xticks(at, [str(case) for case in cases], fontsize=8)
    upper.set_ylim(0.0, 1.05)
    upper.legend(fontsize=8, ncols=4, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    return figure
