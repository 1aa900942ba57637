"""The sections of a report: summary, failures, distributions, time and memory."""

from __future__ import annotations

import collections
import math
from collections.abc import Callable, Sequence

import numpy as np

from drake_srg.sweeps.report import plots
from drake_srg.sweeps.report.elements import (
    Child,
    Element,
    code,
    definitions,
    element,
    figure,
    in_part,
    number,
    paragraph,
    percent,
    quantile,
    section,
    table,
)
from drake_srg.sweeps.report.trials import Trials
from drake_srg.sweeps.statistics import wilson_interval
from drake_srg.types import Vector

_OPEN_FAILURES = 12  # rows of failed trials that are open; the others are folded


def summary(trials: Trials) -> Element:
    """Return the summary: success and grasp rates, false reports, errors, times."""
    n, k = len(trials), int(np.count_nonzero(trials.success))
    low, high = wilson_interval(k, n)
    claimed = int(np.count_nonzero(trials.claimed))
    good = trials.success
    errors = 1e3 * trials.placement_error[good]
    times, placing = trials.cycle_time[good], trials.time_to_placement[good]
    known = np.isfinite(trials.grasp_lifted)
    lifted = int(np.sum(trials.grasp_lifted[known]))
    return element(
        "div",
        _tile(
            "Success",
            percent(k / n, n),
            f"{k:,} of {n:,} trials; 95 % interval {percent(low, n)} to "
            f"{percent(high, n)} (Wilson)",
            "tile lead",
        ),
        _tile(
            "Grasped and lifted",
            f"{lifted:,}",
            f"of {np.count_nonzero(known):,} trials, whatever came of it",
        ),
        _tile(
            "Wrongly reported done",
            f"{claimed:,}",
            "failed trials that the planner reported as done",
            "tile bad" if claimed else "tile",
        ),
        _tile(
            "Placement error",
            number(quantile(errors, 0.95), "mm"),
            f"95 % quantile; median {number(quantile(errors, 0.5), 'mm')}",
        ),
        _tile(
            "Cycle time",
            number(quantile(times, 0.5), "s"),
            f"median; 95 % quantile {number(quantile(times, 0.95), 's')}; "
            f"until the object is placed {number(quantile(placing, 0.5), 's')}",
        ),
        class_="tiles",
    )


def _tile(name: str, value: str, detail: str, class_: str = "tile") -> Element:
    return element(
        "div",
        element("div", name, class_="name"),
        element("div", value, class_="value"),
        element("div", detail, class_="detail"),
        class_=class_,
    )


def failures(trials: Trials, rerun: Callable[[int], str]) -> Element:
    """Return the section on failures: how often for which reason, and each trial.

    Args:
        trials: All trials.
        rerun: Returns the command that repeats the trial of a seed.
    """
    rows = [row for row in trials.worst() if not trials.success[row]]
    n = len(trials)
    if not rows:
        low, _ = wilson_interval(n, n)
        return section(
            "Failures",
            paragraph(
                f"None. With {n:,} trials, the failure rate may still be as high as "
                f"{percent(1.0 - low, n)} (95 % confidence)."
            ),
        )
    reasons = collections.Counter(trials.failure[row] for row in rows)

    def reason(word: str, count: int) -> list[Child]:
        low, high = wilson_interval(count, n)
        claimed = sum(
            bool(trials.claimed[row]) for row in rows if trials.failure[row] == word
        )
        return [
            code(word),
            element(
                "div",
                element("span", style=f"width:{100.0 * count / len(rows):.1f}%"),
                class_="share",
            ),
            f"{count:,}",
            f"{percent(count / n, n)} ({percent(low, n)} to {percent(high, n)})",
            f"{claimed:,}",
        ]

    return section(
        "Failures",
        table(
            ["Reason", "", "Trials", "Share of all (95 % interval)", "Reported done"],
            [reason(*item) for item in reasons.most_common()],
            "Failures by reason",
            "reasons",
        ),
        element("h3", "Failed trials, one by one"),
        *in_part(
            [_failed_trial(trials, row, rerun) for row in rows],
            _OPEN_FAILURES,
            lambda part: table(
                ["Trial", "Reason", "Planner's message", "Command to repeat it"],
                part,
                "Failed trials",
            ),
        ),
    )


def _failed_trial(
    trials: Trials, row: int, rerun: Callable[[int], str]
) -> Sequence[Child]:
    claim = ["; reported done"] if trials.claimed[row] else []
    return (
        f"{trials.trial[row]}",
        element("span", code(trials.failure[row]), *claim),
        trials.message[row] or "-",
        code(rerun(trials.seed[row])),
    )


def distributions(trials: Trials) -> Element:
    """Return histograms of the metrics that trials are judged by."""
    good = trials.success
    kinds: tuple[tuple[str, str, Vector, bool], ...] = (
        ("Cycle time", "s", trials.cycle_time, False),
        ("Placement error", "mm", 1e3 * trials.placement_error, False),
        ("Localisation error", "mm", 1e3 * trials.localization_error, False),
        ("Localisation turn", "deg", np.rad2deg(trials.localization_turn), False),
        ("Motion of other objects", "mm", 1e3 * trials.others_moved, False),
        ("Attempts", "", trials.attempts, True),
    )
    left = trials.numbers("objects_total") - trials.numbers("objects_cleared")
    missed = trials.numbers("picks") - trials.numbers("picks_held")
    of_several = (
        ("Objects left", "", left, True),
        ("Objects in a wrong bin", "", trials.numbers("objects_in_wrong_bin"), True),
        ("Picks not seen to hold", "", missed, True),
        ("Picks per hour", "", trials.numbers("picks_per_hour"), False),
    )
    kinds += tuple(kind for kind in of_several if np.any(np.isfinite(kind[2])))
    figures = []
    for name, unit, values, whole in kinds:
        if not np.any(np.isfinite(values)):
            figures.append(figure(name, "No trial has a value."))
            continue
        own = values[good] if np.any(np.isfinite(values[good])) else values
        words = (
            f"median {number(quantile(own, 0.5), unit)}, "
            f"95 % quantile {number(quantile(own, 0.95), unit)}"
        )
        label = f"Histogram of {name.lower()} {f'[{unit}]' if unit else ''}: {words}"
        plot = plots.histogram(values, good, label=label, whole=whole)
        figures.append(figure(f"{name} [{unit}]" if unit else name, words, plot))
    return section(
        "Distributions",
        paragraph(
            element("span", class_="key good"),
            " successful trials, which determine axes, medians and quantiles; ",
            element("span", class_="key bad"),
            " failed trials that have a value. Errors are distances.",
        ),
        element("div", *figures, class_="plots wide"),
    )


def totals(trials: Trials, jobs: int | None) -> Element:
    """Return the section on time, throughput and memory.

    Args:
        trials: All trials.
        jobs: How many ran at a time; None: one per worker.
    """
    own = trials.numbers("trial_time_s")
    # There are more names than workers if some were replaced.
    workers = len({w for w in trials.column("worker") if w is not None}) or 1
    workers = min(workers, jobs or workers)
    spent = float(np.nansum(own))
    rate = 3600.0 * workers * np.count_nonzero(np.isfinite(own)) / (spent or math.nan)
    memory = trials.numbers("memory_mb")
    rows: list[tuple[str, str]] = [
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
    return section("Time and memory", definitions(rows))


def _median_and_most(values: Vector, unit: str) -> str:
    most = number(quantile(values, 1.0), unit)
    return f"median {number(quantile(values, 0.5), unit)}, largest {most}"


def _duration(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 120 else f"{minutes / 60:.1f} h"
