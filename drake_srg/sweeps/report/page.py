"""Sections of a report and their texts; report.html has the layout."""

from __future__ import annotations

import collections
import dataclasses as dc
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drake_srg.sweeps.report import plots
from drake_srg.sweeps.report.plots import number, percent, quantile
from drake_srg.sweeps.report.trials import (
    FALSE_DISCOVERIES,
    FEW,
    Bin,
    Effect,
    Relation,
    Trials,
    median_bins,
    rank_effects,
    success_bins,
)
from drake_srg.sweeps.statistics import wilson_interval
from drake_srg.types import Vector


@dc.dataclass(frozen=True)
class Figure:
    """A plot with its name and a description."""

    name: str
    words: str
    plot: str  # SVG
    class_: str = "words"


def effects(trials: Trials) -> dict[str, Any]:
    """Return the effects of quantities on failures, placement error and cycle time.

    Returns:
        `verdict` in words, and the `ranked` effects. If there are any, also: `found`,
        names and descriptions of the significant ones; the plots `rates` and `medians`;
        `told`, whether failures could be compared; and `causes`, the number of
        quantities on which failures depend.
    """
    ranked = rank_effects(
        trials.quantities(),
        trials.success,
        trials.placement_error,
        trials.cycle_time,
    )
    if not ranked:
        few = "Too few trials have finished to tell."
        none = "Nothing was varied between the trials."
        return {"verdict": few if len(trials) < FEW else none, "ranked": []}
    failures = [effect.failure for effect in ranked if effect.failure is not None]
    causes = sum(relation.significant for relation in failures)
    return {
        "verdict": _verdict(len(ranked), causes, trials),
        "ranked": ranked,
        "found": [(e.name, _found(e, trials)) for e in ranked if e.significant],
        "rates": _rates(ranked, trials),
        "medians": _medians(ranked, trials),
        "told": bool(failures),
        "causes": causes,
    }


def _rates(ranked: Sequence[Effect], trials: Trials) -> list[Figure]:
    """Return plots of the success rate against every quantity."""
    binned = [success_bins(effect.values, trials.success) for effect in ranked]
    # All plots have one axis: from the lowest interval, rounded down to 5 %, to 100 %.
    lowest = min(b.bounds[0] for row in binned for b in row)
    axis = math.floor(20.0 * lowest) / 20.0, 1.0
    figures = []
    for effect, row in zip(ranked, binned, strict=True):
        relation, words, kind = effect.failure, "no comparison", "words"
        if relation is not None and relation.significant:
            words = f"more failures {_where(relation, 0.5)}, p {p_value(relation.p)}"
            kind = "words found"
        elif relation is not None:
            words = f"no effect seen, p {p_value(relation.p)}"
        plot = plots.against(
            row,
            axis=axis,
            text=lambda share: f"{100.0 * share:.3g} %",
            label=f"Success rate against {effect.name}: {words}",
            strokes=effect.values[~trials.success & np.isfinite(effect.values)],
        )
        figures.append(Figure(effect.name, words, plot, kind))
    return figures


def _medians(ranked: Sequence[Effect], trials: Trials) -> list[Figure]:
    """Return plots of placement error and cycle time against significant quantities."""
    placement, cycle = 1e3 * trials.placement_error, trials.cycle_time
    figures = []
    for name, outcome, relations in (
        ("Placement error [mm]", placement, [e.placement for e in ranked]),
        ("Cycle time [s]", cycle, [e.cycle for e in ranked]),
    ):
        known = np.where(trials.success, outcome, np.nan)
        for effect, relation in zip(ranked, relations, strict=True):
            if relation is None or not relation.significant:
                continue
            rows = median_bins(effect.values, known)
            words = f"{name} is larger {_where(relation, 0.0)}"
            plot = plots.against(
                rows,
                axis=(min(b.bounds[0] for b in rows), max(b.bounds[1] for b in rows)),
                text=number,
                label=f"{words} of {effect.name}",
            )
            figures.append(Figure(effect.name, words, plot))
    return figures


def _verdict(n: int, causes: int, trials: Trials) -> str:
    """Return a sentence about how many of n quantities are causes of failures."""
    failed = int(np.count_nonzero(~trials.success))
    words = f"{n} quantities were varied. " if n > 1 else "One quantity was varied. "
    if failed == 0:
        words += "No trial failed, so none of them can be a cause of failures."
    elif failed == len(trials):
        words += "All trials failed, so nothing shows which of them is a cause."
    elif causes:
        words += (
            f"Failures depend on {causes} of them (at most "
            f"{100 * FALSE_DISCOVERIES:g} % of such findings are expected to be false)."
        )
    else:
        words += (
            "Nothing stands out as a cause of failures: failed and successful trials "
            "differ in none of them by more than chance."
        )
        if failed < 10:
            words += f" With {failed} failed trials, only strong effects would show."
    return words


def _found(effect: Effect, trials: Trials) -> str:
    """Return the effects of a significant quantity in words."""
    words: list[str] = []
    if effect.failure is not None and effect.failure.significant:
        rates = _ends(success_bins(effect.values, trials.success))
        where = _where(effect.failure, 0.5)
        words.append(f"failures are more frequent {where} ({rates})")
    for name, relation in (
        ("the placement error is larger", effect.placement),
        ("the cycle is longer", effect.cycle),
    ):
        if relation is not None and relation.significant:
            rho = f"ρ {relation.strength:.2f}"
            words.append(f"{name} {_where(relation, 0.0)} ({rho})")
    return "; ".join(words)


def _ends(rows: Sequence[Bin]) -> str:
    """Return the worst and the best bin in words."""

    def words(b: Bin) -> str:
        rate = f"{percent(b.outcome, b.trials)} succeed"
        if b.low == b.high:
            return f"{rate} at {number(b.low)}"
        return f"{rate} between {number(b.low)} and {number(b.high)}"

    worst = min(rows, key=lambda b: b.outcome)
    best = max(rows, key=lambda b: b.outcome)
    return f"{words(worst)}, {words(best)}"


def _where(relation: Relation, neutral: float) -> str:
    """Return in words at which values of a quantity an outcome is larger."""
    more = relation.strength > neutral
    if relation.ends:
        return "at both ends" if more else "in the middle"
    return "at high values" if more else "at low values"


def p_value(p: float) -> str:
    """Return a p-value as text."""
    return "< 1e-6" if p < 1e-6 else f"{p:.2g}"


@dc.dataclass(frozen=True)
class Tile:
    """A number of the summary."""

    name: str
    value: str
    detail: str
    class_: str = "tile"


def summary(trials: Trials) -> list[Tile]:
    """Return the summary: success and grasp rates, false reports, errors, times."""
    n, k = len(trials), int(np.count_nonzero(trials.success))
    low, high = wilson_interval(k, n)
    claimed = int(np.count_nonzero(trials.claimed))
    good = trials.success
    errors = 1e3 * trials.placement_error[good]
    times, placing = trials.cycle_time[good], trials.time_to_placement[good]
    known = np.isfinite(trials.grasp_lifted)
    lifted = int(np.sum(trials.grasp_lifted[known]))
    words = (
        f"{k:,} of {n:,} trials; 95 % interval {percent(low, n)} to "
        f"{percent(high, n)} (Wilson)"
    )
    tiles = [Tile("Success", percent(k / n, n), words, "tile lead")]
    if np.any(known):
        lifts = f"of {np.count_nonzero(known):,} trials, including later failures"
        tiles.append(Tile("Grasped and lifted", f"{lifted:,}", lifts))
    words = "failed trials that the planner reported as done"
    kind = "tile bad" if claimed else "tile"
    tiles.append(Tile("Wrongly reported done", f"{claimed:,}", words, kind))
    if np.any(np.isfinite(errors)):
        words = f"95 % quantile; median {number(quantile(errors, 0.5), 'mm')}"
        most = number(quantile(errors, 0.95), "mm")
        tiles.append(Tile("Placement error", most, words))
    if np.any(np.isfinite(times)):
        words = f"median; 95 % quantile {number(quantile(times, 0.95), 's')}"
        if np.any(np.isfinite(placing)):
            words += f"; until it is placed {number(quantile(placing, 0.5), 's')}"
        tiles.append(Tile("Cycle time", number(quantile(times, 0.5), "s"), words))
    return tiles


def failures(trials: Trials) -> dict[str, Any]:
    """Return the failed trials, and the reasons for the failures.

    Returns:
        `failed`: the rows of failed trials, the worst first; `reasons`: each with its
        `word`, `count`, `share` of all trials and how many were `claimed` as done;
        `highest`: upper bound of the failure rate if no trial failed.
    """
    failed = [row for row in trials.worst() if not trials.success[row]]
    n = len(trials)
    counts = collections.Counter(trials.failure[row] for row in failed)
    claimed = collections.Counter(
        trials.failure[row] for row in failed if trials.claimed[row]
    )
    reasons: list[Mapping[str, Any]] = []
    for word, count in counts.most_common():
        low, high = wilson_interval(count, n)
        share = f"{percent(count / n, n)} ({percent(low, n)} to {percent(high, n)})"
        reasons.append(
            {"word": word, "count": count, "share": share, "claimed": claimed[word]}
        )
    highest = percent(1.0 - wilson_interval(n, n)[0], n)
    return {"failed": failed, "reasons": reasons, "highest": highest}


def distributions(trials: Trials) -> list[Figure]:
    """Return histograms of the most important metrics."""
    left = trials.numbers("objects_total") - trials.numbers("objects_cleared")
    missed = trials.numbers("picks") - trials.numbers("picks_held")
    # Name, unit, values, and whether the values are whole numbers.
    kinds: tuple[tuple[str, str, Vector, bool], ...] = (
        ("Cycle time", "s", trials.cycle_time, False),
        ("Placement error", "mm", 1e3 * trials.placement_error, False),
        ("Localisation error", "mm", 1e3 * trials.localization_error, False),
        ("Localisation turn", "deg", np.rad2deg(trials.localization_turn), False),
        ("Motion of other objects", "mm", 1e3 * trials.others_moved, False),
        ("Attempts", "", trials.attempts, True),
        ("Objects left", "", left, True),
        ("Objects in a wrong bin", "", trials.numbers("objects_in_wrong_bin"), True),
        ("Picks not seen to hold", "", missed, True),
        ("Picks per hour", "", trials.numbers("picks_per_hour"), False),
    )
    figures = []
    for name, unit, values, whole in kinds:
        if not np.any(np.isfinite(values)):
            continue
        good = values[trials.success]
        own = good if np.any(np.isfinite(good)) else values
        words = (
            f"median {number(quantile(own, 0.5), unit)}, "
            f"95 % quantile {number(quantile(own, 0.95), unit)}"
        )
        label = f"Histogram of {name.lower()} {f'[{unit}]' if unit else ''}: {words}"
        plot = plots.histogram(values, trials.success, label=label, whole=whole)
        figures.append(Figure(f"{name} [{unit}]" if unit else name, words, plot))
    return figures


def totals(trials: Trials, jobs: int | None) -> list[tuple[str, str]]:
    """Return names and values of time, throughput and memory.

    Args:
        trials: All trials.
        jobs: Number of trials that ran at a time; None: one per worker.
    """
    own = trials.numbers("trial_time_s")
    # Replaced workers have names of their own, so names may outnumber jobs.
    workers = len({w for w in trials.column("worker") if w is not None}) or 1
    workers = min(workers, jobs or workers)
    spent = float(np.nansum(own))
    rate = 3600.0 * workers * np.count_nonzero(np.isfinite(own)) / (spent or math.nan)
    memory = trials.numbers("memory_mb")
    return [
        ("Simulated time", _duration(float(np.nansum(trials.numbers("sim_time_s"))))),
        ("Computing time of all workers", _duration(spent)),
        ("Time per trial, with build", _median_and_most(own, "s")),
        (
            "Throughput while running",
            f"{number(rate)} trials an hour, "
            + (f"{workers} workers" if workers > 1 else "one worker"),
        ),
        ("Real-time factor", _median_and_most(trials.numbers("real_time_factor"), "")),
        (
            "Planning time per trial",
            _median_and_most(trials.numbers("planning_wall_s"), "s"),
        ),
        ("Memory per worker", _median_and_most(memory, "MB")),
    ]


def _median_and_most(values: Vector, unit: str) -> str:
    most = number(quantile(values, 1.0), unit)
    return f"median {number(quantile(values, 0.5), unit)}, largest {most}"


def _duration(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 120 else f"{minutes / 60:.1f} h"
