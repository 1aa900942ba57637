"""The rows of a sweep as arrays, and the effect of each quantity on the outcome."""

from __future__ import annotations

import dataclasses as dc
import itertools
import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import scipy.stats

from drake_srg.sweeps.statistics import (
    rank_auc,
    spearman,
    wilson_interval,
)
from drake_srg.types import Vector

# The accepted share of false relations among those called significant.
FALSE_DISCOVERIES = 0.05
FEW = 10  # with fewer trials, the p-value of a rank correlation is unreliable
_BIN_TRIALS = 25  # least number in a bin; Wilson intervals are then at most 0.37 wide
_MAX_BINS = 8

Rows: TypeAlias = npt.NDArray[np.bool_]


@dc.dataclass(frozen=True)
class Relation:
    """Dependence of one outcome on one quantity.

    Attributes:
        strength: AUC of failed against successful trials (0.5: none), or Spearman's
            correlation (0: none).
        p: The p-value, adjusted for the number of quantities.
        ends: Whether the outcome depends on the distance from the quantity's median
            instead of on the quantity.
    """

    strength: float
    p: float
    ends: bool = False

    @property
    def significant(self) -> bool:
        """Whether the dependence is statistically significant."""
        return self.p <= FALSE_DISCOVERIES


@dc.dataclass(frozen=True)
class Effect:
    """Dependence of the outcomes on one quantity; None with too few trials."""

    name: str
    values: Vector  # one per trial, nan if it has none
    failure: Relation | None
    placement: Relation | None
    cycle: Relation | None

    @property
    def significant(self) -> bool:
        """Whether any outcome depends significantly on the quantity."""
        relations = (self.failure, self.placement, self.cycle)
        return any(r is not None and r.significant for r in relations)


@dc.dataclass(frozen=True)
class Bin:
    """The outcome of the trials within an interval of a quantity."""

    low: float  # of the quantity
    high: float
    middle: float  # median of the quantity
    trials: int
    outcome: float
    bounds: tuple[float, float]  # of the outcome


def rank_effects(
    quantities: Mapping[str, Vector],
    success: Rows,
    placement_error: Vector,
    cycle_time: Vector,
) -> list[Effect]:
    """Return the effects of all quantities, the strongest first.

    An outcome may depend on a quantity's value, or on its distance from the median, as
    with errors of either sign. Both are tested, and the smaller p-value is doubled. The
    p-values of each outcome are then adjusted for the number of quantities.

    Args:
        quantities: Values by name, shape (n,), nan where a trial has none.
        success: Shape (n,).
        placement_error: Shape (n,) [m]. Only successful trials count, because the
            place where a failed one leaves the object says little.
        cycle_time: Shape (n,) [s]. Only successful trials count.
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
    """Return the success rate in bins of a quantity, with Wilson's 95 % interval.

    Args:
        values: The quantity, shape (n,), nan where a trial has none.
        success: Shape (n,).
    """

    def rate(rows: Rows) -> tuple[float, tuple[float, float]]:
        k, n = int(np.sum(success & rows)), int(np.sum(rows))
        return k / n, wilson_interval(k, n)

    return _bins(values, rate)


def median_bins(values: Vector, outcome: Vector) -> list[Bin]:
    """Return the median of an outcome in bins of a quantity, with its quartiles.

    Args:
        values: The quantity, shape (n,), nan where a trial has none.
        outcome: Shape (n,), nan where a trial has none.
    """

    def median(rows: Rows) -> tuple[float, tuple[float, float]]:
        low, middle, high = np.quantile(outcome[rows], [0.25, 0.5, 0.75])
        return float(middle), (float(low), float(high))

    return _bins(np.where(np.isfinite(outcome), values, np.nan), median)


def _bins(
    values: Vector, calc: Callable[[Rows], tuple[float, tuple[float, float]]]
) -> list[Bin]:
    """Return bins with about equal numbers of trials, in order of the quantity.

    A quantity with few distinct values has one bin for each of them.
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


# Strength and p-value, or None with too few trials.
_Test = tuple[float, float] | None
_Measure = Callable[[Vector, Rows], _Test]


def _relations(
    quantities: Mapping[str, Vector], measure: _Measure
) -> dict[str, Relation | None]:
    """Return the relation of an outcome to every quantity, with adjusted p-values."""
    found: dict[str, Relation | None] = {}
    for name, values in quantities.items():
        rows = np.isfinite(values)
        # One of the values, because the mean of two would be equally far from both.
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
    # Of the results with an adjusted p-value of at most q, a share of at most q is
    # expected to be false (Y. Benjamini, Y. Hochberg, J. R. Stat. Soc. B 57:289, 1995).
    adjusted = scipy.stats.false_discovery_control([r.p for r in told.values()])
    return found | {
        name: dc.replace(relation, p=float(p))
        for (name, relation), p in zip(told.items(), adjusted, strict=True)
    }


def _rank(effect: Effect) -> list[float]:
    """Return a sort key: effects on failures first, then others, then none."""
    relations = (effect.failure, effect.placement, effect.cycle)
    found = [r.p if r is not None and r.significant else 1.0 for r in relations]
    # Strengths decide between equal p-values, which occur at 0 and 1.
    strengths = [
        0.0 if relation is None else -abs(relation.strength - neutral)
        for relation, neutral in zip(relations, (0.5, 0.0, 0.0), strict=True)
    ]
    rest = [1.0 if relation is None else relation.p for relation in relations]
    return found + rest + strengths


_NEAREST = "clutter: nearest to another object"


class Trials:
    """The columns of a sweep's rows.

    Args:
        table: A pyarrow.Table from `read_rows`.
        sampled: Names of its columns that contain drawn values.
    """

    def __init__(self, table: Any, sampled: list[str]):
        self._table = table
        self._sampled = sampled
        self.trial: list[int] = self.column("trial")
        self.seed: list[int] = self.column("seed")
        self.success: npt.NDArray[np.bool_] = np.array(
            self.column("success"), dtype=bool
        )
        # Failed trials that the planner reported as done.
        self.claimed: npt.NDArray[np.bool_] = ~self.success & np.array(
            [bool(claimed) for claimed in self.column("claimed")], dtype=bool
        )
        self.failure: list[str] = [f or "unknown" for f in self.column("failure")]
        self.message: list[str] = [m or "" for m in self.column("message")]
        self.cycle_time = self.numbers("cycle_time_s")
        self.time_to_placement = self.numbers("time_to_placement_s")
        self.grasp_lifted = self.numbers("grasp_lifted")
        self.placement_error = self.norms("placement_error_m")
        self.localization_error = self.norms("localization_error_m")
        self.localization_turn = self.numbers("localization_turn_rad")
        self.others_moved = self.numbers("others_moved_m")
        self.attempts = self.numbers("attempts")

    def __len__(self) -> int:
        return len(self.trial)

    def column(self, name: str) -> list[Any]:
        """Return the values of a column; None for every missing one."""
        if name not in self._table.column_names:
            return [None] * self._table.num_rows
        return list(self._table.column(name).to_pylist())

    def numbers(self, name: str) -> Vector:
        """Return a column of numbers, shape (len(self),)."""
        return _numbers(self.column(name))

    def norms(self, name: str) -> Vector:
        """Return the lengths of a column's vectors, shape (len(self),)."""
        return np.array(
            [
                np.nan if vector is None else np.linalg.norm(_numbers(vector))
                for vector in self.column(name)
            ]
        )

    def quantities(self) -> dict[str, Vector]:
        """Return the drawn quantities that vary, by name; shape (len(self),).

        A quantity whose values are words becomes one quantity per word: 1 where the
        word was drawn, else 0. With clutter, its smallest distance from another object
        is a quantity, too. Quantities of fewer than `FEW` trials are left out.
        """
        quantities: dict[str, Vector] = {_NEAREST: self._nearest_clutter()}
        for name in self._sampled:
            if name.startswith("episode."):  # an outcome, not a cause
                continue
            values = self.column(name)
            words = sorted({value for value in values if isinstance(value, str)})
            if words:
                quantities |= {
                    f"{name} = {word}": _numbers(
                        [None if value is None else value == word for value in values]
                    )
                    for word in words
                }
            else:
                quantities[name] = _numbers(values)
        return {
            name: values
            for name, values in quantities.items()
            if np.count_nonzero(np.isfinite(values)) >= FEW
            and len(np.unique(values[np.isfinite(values)])) > 1
        }

    def _nearest_clutter(self) -> Vector:
        """Return the smallest distance between clutter and any other object [m].

        Distances are between centres on the table. The pieces of clutter are
        interchangeable, so the place of a single one says little.

        Returns:
            Shape (len(self),), nan where a trial has no clutter.
        """
        places: dict[str, list[Vector]] = {}
        for name in self._sampled:
            match = re.fullmatch(r"objects\.(.+)\.position\[[01]\]", name)
            if match:
                places.setdefault(match[1], []).append(self.numbers(name))
        points = {name: np.array(p) for name, p in places.items() if len(p) == 2}
        clutter = [p for name, p in points.items() if name.startswith("clutter_")]
        others = [p for name, p in points.items() if not name.startswith("clutter_")]
        nearest = np.full(len(self), np.nan)
        for p, q in itertools.product(clutter, others):
            nearest = np.fmin(nearest, np.linalg.norm(p - q, axis=0))
        return nearest

    def worst(self) -> list[int]:
        """Return the indices of all rows, the worst first.

        First come failures wrongly reported as done, then other failures, then
        successes; within each group, the largest placement errors come first.
        """
        error = np.nan_to_num(self.placement_error, nan=np.inf)
        order = np.lexsort((np.arange(len(self)), -error, self.success, ~self.claimed))
        return [int(row) for row in order]


def command(*words: str, overrides: Sequence[str]) -> str:
    """Return a `drake-srg` command line."""
    sets = [word for override in overrides for word in ("--set", override)]
    return shlex.join(["drake-srg", *words, *sets])


def _numbers(values: list[Any]) -> Vector:
    return np.array([np.nan if v is None else float(v) for v in values], dtype=float)
