"""The section of a report that shows what the outcome of trials depends on."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from drake_srg.sweeps.report import plots
from drake_srg.sweeps.report.effects import (
    FALSE_DISCOVERIES,
    FEW,
    Bin,
    Effect,
    Relation,
    median_bins,
    rank_effects,
    success_bins,
)
from drake_srg.sweeps.report.elements import (
    Child,
    Element,
    code,
    element,
    figure,
    folded,
    in_part,
    number,
    paragraph,
    percent,
    section,
    table,
)
from drake_srg.sweeps.report.trials import Trials

_OPEN_EFFECTS = 12  # plots that are open; the others are folded away


def effects(trials: Trials) -> Element:
    """Return the section: what failures, placement error and cycle time depend on."""
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
        plot = plots.against(
            row,
            axis=axis,
            text=lambda share: f"{100.0 * share:.3g} %",
            label=f"Success rate against {effect.name}: {words}",
            strokes=effect.values[~trials.success & np.isfinite(effect.values)],
        )
        figures.append(figure(effect.name, words, plot, kind))
    told = any(effect.failure is not None for effect in ranked)
    return [
        element("h3", "Success rate by quantity"),
        paragraph(
            "Every bin has about the same number of trials, and is drawn with its 95 % "
            "interval (Wilson). Each stroke at the bottom is a failed trial. The "
            "quantities that matter most come first."
        ),
        *in_part(figures, _OPEN_EFFECTS if told else 0, _grid),
    ]


def _medians(ranked: Sequence[Effect], trials: Trials) -> list[Element]:
    """Return plots of placement error and cycle time, where a quantity matters."""
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
            plot = plots.against(
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
    """Return in words what each quantity that matters does."""
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
    """Return in words which values of a quantity have more of an outcome."""
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
