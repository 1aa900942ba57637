"""Measures of grasps against simulated shakes: which of them tell what will hold.

Each grasp closes and lifts. The contacts then give the measures, and a shake gives the
answer. AUC is the chance that a measure ranks a grasp that holds above one that does
not: 0.5 for a coin, 1 for an oracle. It is stated over all objects and, where there
are enough shakes, as the mean over objects, because a measure may only tell light
objects from heavy ones.
"""

from __future__ import annotations

import dataclasses as dc
import functools
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments.household import Case, household_cases
from drake_srg.experiments.kept_trials import KeptTrials
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.experiments.shaken_grasp import (
    ShakenGrasp,
    from_json,
    shaken_grasp,
    to_json,
)
from drake_srg.planning.grasps.grasp_measures import MEASURES
from drake_srg.recording.timeline import COLORS, make_figure, style_axes
from drake_srg.sweeps.statistics import rank_auc
from drake_srg.types import Vector

Flags = npt.NDArray[np.bool_]

_FEW = 5  # grasps that held, or that did not, below which an object's AUC says nothing


@dc.dataclass(frozen=True)
class Trial:
    """An object, its proper grasp and the seed of a shift."""

    case: Case
    seed: int

    def __str__(self) -> str:
        return f"{self.case}, seed {self.seed}"


def run(
    track: Track,
    *,
    trials: int = 2000,
    seed: int = 0,
    scenario: str = "gripper_bench_fast",
    keep: str = "",
) -> ExperimentResult:
    """Shake grasps of every object.

    Args:
        track: Shows progress.
        trials: Number of shakes, of all objects together.
        seed: Of the first shift.
        scenario: The bench.
        keep: File of finished trials, with which a run that was cut off goes on.
    """
    cases = [case for case in household_cases() if case.possible]
    planned = [
        Trial(cases[i % len(cases)], seed + i // len(cases)) for i in range(trials)
    ]
    kept = KeptTrials(keep)
    made: list[tuple[Trial, ShakenGrasp]] = []
    for trial in track(planned):
        plain = kept(f"{scenario}, {trial}", functools.partial(_shake, trial, scenario))
        if plain:
            made.append((trial, from_json(plain)))
    return judged(made, failed=len(planned) - len(made))


def _shake(trial: Trial, scenario: str) -> Mapping[str, Any]:
    """Return a shaken grasp as plain values; nothing if Drake aborts it."""
    try:
        return to_json(shaken_grasp(trial.case, trial.seed, scenario))
    except ScenarioError:
        return {}


def judged(
    made: Sequence[tuple[Trial, ShakenGrasp]], failed: int = 0
) -> ExperimentResult:
    """Compute all measures of lifted grasps, and compare them with the shakes.

    Args:
        made: Trials and what became of them.
        failed: Number of trials that Drake aborted.
    """
    lifted = [(t, g) for t, g in made if g.lifted and g.patches]
    names = np.array([trial.case.name for trial, _ in lifted])
    held = np.array([grasp.survived for _, grasp in lifted], bool)
    values: dict[str, Vector] = {}
    costs: dict[str, float] = {}
    for name, measure in MEASURES.items():
        start = time.process_time()
        values[name] = np.array([measure(g.patches, g.body) for _, g in lifted])
        costs[name] = 1e3 * (time.process_time() - start) / max(len(lifted), 1)
    rows = [
        Row.info("all", "shakes", len(made) + failed, "", spread=1.0),
        Row.info("all", "objects", len({t.case.name for t, _ in made}), "", spread=0.5),
        Row.info("all", "aborted by Drake", failed, "", spread=3.0),
        Row.info("all", "lifted", len(lifted), "", spread=0.05 * len(made)),
        Row.info("all", "held of these", int(held.sum()), "", spread=0.05 * len(made)),
    ]
    ranked: dict[str, tuple[float, float]] = {}
    for name, value in values.items():
        ranked[name] = auc(value, held), auc_by_object(value, held, names)
        for what, score in zip(
            ("AUC", "AUC, mean of objects"), ranked[name], strict=True
        ):
            if np.isfinite(score):  # else there are too few shakes for it
                rows.append(Row.info(name, what, score, "", spread=0.1))
        error = auc_error(ranked[name][0], held)
        rows.append(Row.info(name, "AUC, standard error", error, "", spread=0.03))
        rows.append(Row.info(name, "cost", costs[name], "ms", clock="time"))
    table: dict[str, Any] = {
        "object": names,
        "approach": [trial.case.approach for trial, _ in lifted],
        "seed": [trial.seed for trial, _ in lifted],
        "strength [m/s²]": [grasp.strength for _, grasp in lifted],
        "moved [mm]": [1e3 * grasp.moved for _, grasp in lifted],
        "held": held.astype(int),
        **values,
    }
    return ExperimentResult(rows, {"shakes": table}, _draw(values, held, ranked))


def auc(value: Vector, held: Flags) -> float:
    """Return the AUC of a measure; NaN unless some grasps held and some did not."""
    if held.all() or not held.any():
        return np.nan
    return rank_auc(value[held], value[~held])[0]


def auc_error(area: float, held: Flags) -> float:
    """Return the standard error of an AUC (Hanley and McNeil, Radiology 143:29, 1982).

    Args:
        area: The AUC.
        held: Which grasps held.
    """
    m, n = int(held.sum()), int((~held).sum())
    if not (m and n):
        return np.nan
    both, same = area / (2.0 - area), 2.0 * area**2 / (1.0 + area)
    spread = area * (1.0 - area)
    spread += (m - 1) * (both - area**2) + (n - 1) * (same - area**2)
    return float(np.sqrt(max(spread, 0.0) / (m * n)))


def auc_by_object(value: Vector, held: Flags, names: Any) -> float:
    """Return the mean AUC of the objects of which enough grasps held and failed."""
    each = []
    for name in np.unique(names):
        own = names == name
        if min(held[own].sum(), (~held[own]).sum()) >= _FEW:
            each.append(auc(value[own], held[own]))
    return float(np.mean(each)) if each else np.nan


def _draw(
    values: Mapping[str, Vector],
    held: Flags,
    ranked: Mapping[str, tuple[float, float]],
) -> Any:
    figure = make_figure(9.0, 4.0, "Which measure tells what survives a shake?")
    bars, shares = figure.subplots(1, 2, width_ratios=(1.4, 1.0))
    style_axes(bars, xlabel="AUC (0.5: a coin)", ylabel="")
    order = sorted(ranked, key=lambda name: np.nan_to_num(ranked[name][0]))
    at = np.arange(len(order))
    for k, label in enumerate(("all objects", "mean of objects")):
        lengths = [ranked[name][k] for name in order]
        bars.barh(at + 0.2 - 0.4 * k, lengths, 0.38, color=COLORS[k], label=label)
    bars.set_yticks(at, order, fontsize=8)
    bars.set_xlim(0.4, 1.0)
    bars.axvline(0.5, color="black", lw=0.8)
    bars.legend(fontsize=8, frameon=False, loc="lower right")
    style_axes(
        shares, xlabel="grasps, from the lowest measure", ylabel="share that held"
    )
    for name, color in zip(reversed(order[-3:]), COLORS, strict=False):
        groups = np.array_split(held[np.argsort(values[name], kind="stable")], 10)
        middles = (np.arange(10) + 0.5) / 10
        means = [group.mean() if len(group) else np.nan for group in groups]
        shares.plot(middles, means, marker="o", ms=3, color=color, label=name)
    shares.set_ylim(0.0, 1.02)
    shares.legend(fontsize=8, frameon=False)
    return figure
