"""Which of the sampled quantities the outcome of trials depends on."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Mapping
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from drake_srg.sweeps.statistics import (
    benjamini_hochberg,
    rank_auc,
    spearman,
    wilson_interval,
)
from drake_srg.types import Vector

# The share of false ones that is accepted among the relations that are called so.
FALSE_DISCOVERIES = 0.05
FEW = 10  # trials, below which the p-value of a rank correlation is a guess
_BIN_TRIALS = 25  # at least; their Wilson interval is at most 0.37 wide
_MAX_BINS = 8

Rows: TypeAlias = npt.NDArray[np.bool_]


@dc.dataclass(frozen=True)
class Relation:
    """How one outcome goes with one quantity."""

    # AUC of failed against succeeded trials (0.5: none), or Spearman's correlation.
    strength: float
    p: float  # adjusted for the number of quantities
    # It is with the distance from the quantity's median, not with the quantity.
    ends: bool = False

    @property
    def significant(self) -> bool:
        """Whether more than chance shows."""
        return self.p <= FALSE_DISCOVERIES


@dc.dataclass(frozen=True)
class Effect:
    """What one quantity does to the outcomes; None where too few trials tell."""

    name: str
    values: Vector  # one a trial, nan where it has none
    failure: Relation | None
    placement: Relation | None
    cycle: Relation | None

    @property
    def significant(self) -> bool:
        """Whether it matters for any outcome."""
        relations = (self.failure, self.placement, self.cycle)
        return any(r is not None and r.significant for r in relations)


@dc.dataclass(frozen=True)
class Bin:
    """Trials with neighbouring values of a quantity, and an outcome of theirs."""

    low: float  # of the quantity
    high: float
    middle: float  # their median
    trials: int
    outcome: float
    bounds: tuple[float, float]  # of the outcome


def rank_effects(
    quantities: Mapping[str, Vector],
    success: Rows,
    placement_error: Vector,
    cycle_time: Vector,
) -> list[Effect]:
    """Return the effects of all quantities, those that matter most first.

    A quantity may matter by being large or small, or by being far from its usual
    value, as errors of either sign do. Both are tested, and the smaller p-value counts
    twice. Each outcome's p-values are then adjusted for the number of quantities.

    Args:
        quantities: By name; shape (n,), nan where a trial has none.
        success: Shape (n,).
        placement_error: [m], shape (n,). Of trials that succeeded it is set against
            the quantities: where failed ones leave the object says little.
        cycle_time: [s], shape (n,), likewise.
    """

    def failure(values: Vector, rows: Rows) -> _Test:
        failed, rest = values[rows & ~success], values[rows & success]
        return rank_auc(failed, rest) if len(failed) and len(rest) else None

    def correlation(outcome: Vector) -> _Measure:
        def measure(values: Vector, rows: Rows) -> _Test:
            rows = rows & success & np.isfinite(outcome)
            if np.count_nonzero(rows) < FEW:
                return None
            return spearman(values[rows], outcome[rows])

        return measure

    columns = [
        _relations(quantities, measure)
        for measure in (failure, correlation(placement_error), correlation(cycle_time))
    ]
    effects = [
        Effect(name, values, *(column[name] for column in columns))
        for name, values in quantities.items()
    ]
    return sorted(effects, key=_rank)


def success_bins(values: Vector, success: Rows) -> list[Bin]:
    """Return success rates of bins, with Wilson's 95 % intervals; see `_bins`.

    Args:
        values: Of a quantity, shape (n,), nan where a trial has none.
        success: Shape (n,).
    """

    def rate(rows: Rows) -> tuple[float, tuple[float, float]]:
        k, n = int(np.sum(success & rows)), int(np.sum(rows))
        return k / n, wilson_interval(k, n)

    return _bins(values, rate)


def median_bins(values: Vector, outcome: Vector) -> list[Bin]:
    """Return an outcome's medians in bins, with its quartiles; see `_bins`.

    Args:
        values: Of a quantity, shape (n,), nan where a trial has none.
        outcome: Shape (n,), likewise.
    """

    def median(rows: Rows) -> tuple[float, tuple[float, float]]:
        low, middle, high = np.quantile(outcome[rows], [0.25, 0.5, 0.75])
        return float(middle), (float(low), float(high))

    return _bins(np.where(np.isfinite(outcome), values, np.nan), median)


def _bins(
    values: Vector, calc: Callable[[Rows], tuple[float, tuple[float, float]]]
) -> list[Bin]:
    """Bins of about equal numbers of trials, from the smallest value on.

    A quantity of few values, each drawn again and again, has a bin for each of them.
    """
    finite = values[np.isfinite(values)]
    edges = np.unique(finite)
    if len(edges) > min(_MAX_BINS, len(finite) // 2):
        count = int(np.clip(len(finite) // _BIN_TRIALS, 2, _MAX_BINS))
        shares = np.arange(count) / count
        edges = np.unique(np.quantile(finite, shares, method="inverted_cdf"))
    index = np.searchsorted(edges, values, side="right") - 1
    found = []
    for i in range(len(edges)):
        rows = np.isfinite(values) & (index == i)
        own = values[rows]
        found.append(
            Bin(
                float(own.min()),
                float(own.max()),
                float(np.median(own)),
                len(own),
                *calc(rows),
            )
        )
    return found


# Strength and p-value, or None where too few trials tell.
_Test = tuple[float, float] | None
_Measure = Callable[[Vector, Rows], _Test]


def _relations(
    quantities: Mapping[str, Vector], measure: _Measure
) -> dict[str, Relation | None]:
    """Measure every quantity, and adjust the p-values."""
    found: dict[str, Relation | None] = {}
    for name, values in quantities.items():
        rows = np.isfinite(values)
        # One of the values, so that no two others become equally far from it.
        median = np.quantile(values[rows], 0.5, method="inverted_cdf")
        tests = [(measure(values, rows), False)]
        if len(np.unique(values[rows])) > 2:
            tests.append((measure(np.abs(values - median), rows), True))
        relations = [
            Relation(test[0], min(1.0, len(tests) * test[1]), ends)
            for test, ends in tests
            if test is not None and np.isfinite(test[0])
        ]
        found[name] = min(relations, key=lambda r: r.p, default=None)
    told = {name: relation for name, relation in found.items() if relation is not None}
    adjusted = benjamini_hochberg(np.array([r.p for r in told.values()]))
    return found | {
        name: dc.replace(relation, p=float(p))
        for (name, relation), p in zip(told.items(), adjusted, strict=True)
    }


def _rank(effect: Effect) -> list[float]:
    """What is significant first: for failures, then for the others; then the rest."""
    relations = (effect.failure, effect.placement, effect.cycle)
    found = [r.p if r is not None and r.significant else 1.0 for r in relations]
    # These decide where p-values are equal, as they are at 0 and 1.
    strengths = [
        0.0 if relation is None else -abs(relation.strength - neutral)
        for relation, neutral in zip(relations, (0.5, 0.0, 0.0), strict=True)
    ]
    rest = [1.0 if relation is None else relation.p for relation in relations]
    return found + rest + strengths
