"""The sections of a report: summary, failures, causes, distributions, cost."""

from __future__ import annotations

import collections
import math
from collections.abc import Callable, Sequence

import numpy as np

from drake_srg.sweeps.report import elements
from drake_srg.sweeps.report.elements import (
    Child,
    Element,
    code,
    definitions,
    element,
    figure,
    folded,
    in_part,
    number,
    paragraph,
    percent,
    quantile,
    section,
    table,
)
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

_OPEN_EFFECTS = 12  # plots that are open; the others are folded away


def effects(trials: Trials) -> Element:
    """Return the section on the causes of failures, placement error and cycle time."""
    ranked = rank_effects(
        trials.quantities(),
        trials.success,
        trials.placement_error,
        trials.cycle_time,
    )
    title = "What matters"
    if not ranked:
        few = "Too few trials have finished to tell."
        none = "Nothing was varied between the trials."
        return section(title, paragraph(few if len(trials) < FEW else none))
    found = [effect for effect in ranked if effect.significant]
    return section(
        title,
        _verdict(ranked, trials),
        *([_found(found, trials)] if found else []),
        *_rates(ranked, trials),
        *_medians(ranked, trials),
        folded("All quantities in a table", _all_effects(ranked), _method()),
    )


def _rates(ranked: Sequence[Effect], trials: Trials) -> list[Element]:
    """Return plots of the success rate against every quantity."""
    binned = [success_bins(effect.values, trials.success) for effect in ranked]
    # A common axis, down to the lowest interval, in steps of 5 %.
    lowest = min(b.bounds[0] for row in binned for b in row)
    axis = math.floor(20.0 * lowest) / 20.0, 1.0
    figures = []
    for effect, row in zip(ranked, binned, strict=True):
        relation, words, kind = effect.failure, "no comparison", "words"
        if relation is not None and relation.significant:
            words = f"more failures {_where(relation, 0.5)}, p {_p(relation.p)}"
            kind = "words found"
        elif relation is not None:
            words = f"no effect seen, p {_p(relation.p)}"
        plot = elements.against(
            row,
            axis=axis,
            text=lambda share: f"{100.0 * share:.3g} %",
            label=f"Success rate against {effect.name}: {words}",
            strokes=effect.values[~trials.success & np.isfinite(effect.values)],
        )
        figures.append(figure(effect.name, words, plot, kind))
    told = any(effect.failure is not None for effect in ranked)
    words = (
        "Every bin has about the same number of trials, and is drawn with its 95 % "
        "interval (Wilson). Each stroke at the bottom is a failed trial."
    )
    if any(
        effect.failure is not None and effect.failure.significant for effect in ranked
    ):
        words += " The quantities that matter most come first."
    return [
        element("h3", "Success rate by quantity"),
        paragraph(words),
        *in_part(figures, _OPEN_EFFECTS if told else 0, _grid),
    ]


def _medians(ranked: Sequence[Effect], trials: Trials) -> list[Element]:
    """Return plots of placement error and cycle time against significant quantities."""
    figures = []
    for name, unit, outcome, relations in (
        (
            "Placement error",
            "mm",
            1e3 * trials.placement_error,
            [effect.placement for effect in ranked],
        ),
        ("Cycle time", "s", trials.cycle_time, [effect.cycle for effect in ranked]),
    ):
        known = np.where(trials.success, outcome, np.nan)
        for effect, relation in zip(ranked, relations, strict=True):
            if relation is None or not relation.significant:
                continue
            rows = median_bins(effect.values, known)
            words = f"{name} [{unit}] is larger {_where(relation, 0.0)}"
            plot = elements.against(
                rows,
                axis=(min(b.bounds[0] for b in rows), max(b.bounds[1] for b in rows)),
                text=number,
                label=f"{words} of {effect.name}",
            )
            figures.append(figure(effect.name, words, plot))
    if not figures:
        return []
    return [
        element("h3", "Placement error and cycle time"),
        paragraph(
            "Medians of successful trials in bins as above; each bar spans the middle "
            "half of its trials. Only quantities that matter are shown."
        ),
        *in_part(figures, _OPEN_EFFECTS, _grid),
    ]


def _grid(figures: Sequence[Element]) -> Element:
    return element("div", *figures, class_="plots")


def _verdict(ranked: Sequence[Effect], trials: Trials) -> Element:
    n, failed = len(ranked), int(np.count_nonzero(~trials.success))
    causes = sum(e.failure is not None and e.failure.significant for e in ranked)
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
    return paragraph(words)


def _found(found: Sequence[Effect], trials: Trials) -> Element:
    """Return in words the effect of each significant quantity."""
    items = []
    for effect in found:
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
        items.append(element("li", code(effect.name), f": {'; '.join(words)}."))
    return element("ol", *items)


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
    """Return in words the values of a quantity with more of an outcome."""
    more = relation.strength > neutral
    if relation.ends:
        return "at both ends" if more else "in the middle"
    return "at high values" if more else "at low values"


def _all_effects(ranked: Sequence[Effect]) -> Element:
    def cell(relation: Relation | None, symbol: str) -> Child:
        if relation is None:
            return "-"
        ends = " of ends" if relation.ends else ""
        text = f"{symbol}{ends} {relation.strength:.2f}, p {_p(relation.p)}"
        return element("strong", text) if relation.significant else text

    return table(
        ["Quantity", "from", "to", "Failures", "Placement error", "Cycle time"],
        [
            (
                code(e.name),
                number(float(np.nanmin(e.values))),
                number(float(np.nanmax(e.values))),
                cell(e.failure, "AUC"),
                cell(e.placement, "ρ"),
                cell(e.cycle, "ρ"),
            )
            for e in ranked
        ],
        "All quantities",
    )


def _method() -> Element:
    return paragraph(
        "AUC: the probability that a failed trial has a larger value than a successful "
        "one; 0.5 means no difference (Mann-Whitney test, exact for few failures). "
        "ρ: Spearman's rank correlation among successful trials. Both are computed "
        "twice, with the value and with its distance from the median (“of ends”); the "
        "more significant result is shown, with its p-value doubled. p is adjusted for "
        "the number of quantities (Benjamini and Hochberg) and bold if it is at most "
        f"{FALSE_DISCOVERIES:g}. The combined effect of two quantities is not tested."
    )


def _p(p: float) -> str:
    return "< 1e-6" if p < 1e-6 else f"{p:.2g}"


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
    tiles = [
        _tile(
            "Success",
            percent(k / n, n),
            f"{k:,} of {n:,} trials; 95 % interval {percent(low, n)} to "
            f"{percent(high, n)} (Wilson)",
            "tile lead",
        )
    ]
    if np.any(known):
        lifts = f"of {np.count_nonzero(known):,} trials, whatever came of it"
        tiles.append(_tile("Grasped and lifted", f"{lifted:,}", lifts))
    tiles.append(
        _tile(
            "Wrongly reported done",
            f"{claimed:,}",
            "failed trials that the planner reported as done",
            "tile bad" if claimed else "tile",
        )
    )
    if np.any(np.isfinite(errors)):
        tiles.append(
            _tile(
                "Placement error",
                number(quantile(errors, 0.95), "mm"),
                f"95 % quantile; median {number(quantile(errors, 0.5), 'mm')}",
            )
        )
    if np.any(np.isfinite(times)):
        words = f"median; 95 % quantile {number(quantile(times, 0.95), 's')}"
        if np.any(np.isfinite(placing)):
            words += f"; until it is placed {number(quantile(placing, 0.5), 's')}"
        tiles.append(_tile("Cycle time", number(quantile(times, 0.5), "s"), words))
    return element("div", *tiles, class_="tiles")


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
            continue
        own = values[good] if np.any(np.isfinite(values[good])) else values
        words = (
            f"median {number(quantile(own, 0.5), unit)}, "
            f"95 % quantile {number(quantile(own, 0.95), unit)}"
        )
        label = f"Histogram of {name.lower()} {f'[{unit}]' if unit else ''}: {words}"
        plot = elements.histogram(values, good, label=label, whole=whole)
        figures.append(figure(f"{name} [{unit}]" if unit else name, words, plot))
    if not figures:
        return section("Distributions", paragraph("No trial has a value."))
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
        jobs: Number of trials that ran at a time; None: one per worker.
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
