"""Visual servoing through a served station's messages, with pictures that are late.

The can stands on a tray that moves. Arm, gripper and cameras are behind the messages of
`drake-srg serve`; control loop, safety monitor, servo and planner are those of
`drake-srg run --hardware`. Both sides advance in turn, so no result depends on the
machine's speed. Grasps and criteria are those of `visual_servoing`.
"""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drake_srg.experiments.grasp_rows import (
    MOST_OFF,
    error_rows,
    grasp_errors,
    held_rows,
)
from drake_srg.experiments.kept_trials import KeptTrials
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.experiments.served_trials import Served, grasp_served
from drake_srg.experiments.servo_trials import Case, trial_order
from drake_srg.recording.timeline import COLORS, make_figure, style_axes

CASES = (Case(0.0), Case(0.02), Case(0.05))
SERVOS = ("pbvs", "ibvs")

_Results = Mapping[tuple[Case, str], Sequence[Served]]


def run(
    track: Track,
    *,
    trials: int = 200,
    first_seed: int = 930_000,
    late: float = 0.1,
    keep: str = "",
) -> ExperimentResult:
    """Run the experiment.

    Args:
        track: Shows progress.
        trials: Grasps per case and servo.
        first_seed: Seed of the first trial; the others follow.
        late: How late pictures arrive [s].
        keep: File of finished trials, with which a run that was cut off goes on.
    """
    kept = KeptTrials(keep)
    order = trial_order(CASES, SERVOS, range(first_seed, first_seed + trials))
    results: dict[tuple[Case, str], list[Served]] = {}
    lines: list[dict[str, Any]] = []
    for case, method, seed in track(order, lambda t: f"{t[0]}, {t[1]}"):
        trial = functools.partial(_trial, case, method, seed, late)
        made = Served(**kept(f"{case}/{method}/{late}/{seed}", trial))
        results.setdefault((case, method), []).append(made)
        lines.append(
            {
                "case": str(case),
                "method": method,
                "seed": seed,
                "held": int(made.held),
                "error [m]": np.nan if made.error is None else made.error,
                "across [m]": np.nan if made.across is None else made.across,
                "reason": made.reason,
                "stopped": made.stopped,
            }
        )
    table: dict[str, Any] = {key: [line[key] for line in lines] for key in lines[0]}
    rows = [row for cell in results.items() for row in _rows(*cell)]
    return ExperimentResult(rows, {"trials": table}, _figure(results, late))


def _trial(case: Case, method: str, seed: int, late: float) -> dict[str, Any]:
    return dc.asdict(grasp_served(case, method, seed, late))


def _rows(cell: tuple[Case, str], made: Sequence[Served]) -> list[Row]:
    name = f"{cell[0]}, {cell[1]}"
    stopped, errors = sum(bool(s.stopped) for s in made), grasp_errors(made)
    rows = [
        *held_rows(name, made, judged=True),
        *error_rows(name, made, judged=True),
        Row.at_most(name, "stopped by the safety monitor", 0, stopped, ""),
    ]
    if len(errors):
        rows.append(Row.info(name, "grasp error, worst", float(np.max(errors)), "m"))
    return rows


def _figure(results: _Results, late: float) -> Any:
    title = f"Grasps through the wire, pictures {1e3 * late:g} ms late"
    figure = make_figure(7.0, 3.6, title)
    axes = figure.subplots()
    style_axes(axes, ylabel="grasp error [mm]")
    cases = list(dict.fromkeys(case for case, _ in results))
    for i, method in enumerate(SERVOS):
        for j, case in enumerate(cases):
            made = results[case, method]
            errors = 1e3 * grasp_errors(made)
            x = j + 0.36 * (i - 0.5) + np.linspace(-0.12, 0.12, len(errors))
            label = method if j == 0 else None
            axes.plot(x, errors, "o", ms=2, color=COLORS[i], label=label)
            held = f"{sum(s.held for s in made)} of {len(made)}\nheld"
            at = (j + 0.36 * (i - 0.5), 0.97)
            across = axes.get_xaxis_transform()
            axes.text(*at, held, transform=across, fontsize=7, ha="center", va="top")
    axes.axhline(1e3 * MOST_OFF, color="#333333", lw=0.8, ls="--")
    axes.set_xticks(range(len(cases)), [str(case) for case in cases])
    worst = max(1e3 * np.max(grasp_errors(m), initial=0.0) for m in results.values())
    axes.set_yscale("log")
    axes.set_ylim(0.1, 10.0 * max(1e3 * MOST_OFF, worst))
    axes.legend(fontsize=8, ncols=2, loc="lower right", bbox_to_anchor=(1.0, 1.0))
    return figure
