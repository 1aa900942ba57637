"""The statistics of many trials, with nothing but NumPy."""

from __future__ import annotations

import functools
import math
from statistics import NormalDist

import numpy as np

from drake_srg.types import Vector

# The exact distribution of a rank sum takes (chosen * number)² steps: 0.1 s here.
_EXACT = 10_000


def wilson_interval(
    successes: int, trials: int, confidence: float = 0.95
) -> tuple[float, float]:
    """Return the bounds of a success probability, from how often it was seen.

    E. B. Wilson, J. Am. Stat. Assoc. 22:209, 1927: the probabilities p from which the
    observed share lies no more than z standard deviations √(p (1 - p) / n) away.

    Args:
        successes: 0 .. `trials`.
        trials: With none nothing is known: (0, 1).
        confidence: That the bounds hold the probability, within 0 and 1.

    Raises:
        ValueError: If an argument is out of its range.
    """
    if not (0 <= successes <= trials and 0.0 < confidence < 1.0):
        raise ValueError(
            f"wilson_interval of {successes} successes in {trials} trials at "
            f"confidence {confidence}; allowed are 0 <= successes <= trials and a "
            "confidence within 0 and 1"
        )
    if trials == 0:
        return 0.0, 1.0
    z = NormalDist().inv_cdf(0.5 + confidence / 2.0)
    share, weight = successes / trials, z * z / trials
    centre = (share + weight / 2.0) / (1.0 + weight)
    half = (
        z
        / (1.0 + weight)
        * math.sqrt(share * (1.0 - share) / trials + weight / trials / 4.0)
    )
    # Rounding may leave what was observed just outside.
    return min(max(0.0, centre - half), share), max(min(1.0, centre + half), share)


def midranks(values: Vector) -> Vector:
    """Return the ranks 1 .. n of values, equal ones sharing their mean; shape (n,)."""
    _, inverse, counts = np.unique(values, return_inverse=True, return_counts=True)
    ends = np.cumsum(counts)
    return (ends - (counts - 1) / 2.0)[inverse]


def rank_auc(first: Vector, second: Vector) -> tuple[float, float]:
    """Compare two samples by the test of Mann and Whitney.

    H. B. Mann, D. R. Whitney, Ann. Math. Stat. 18:50, 1947. For few values in one of
    the samples the p-value is exact, with ties, too; otherwise it is that of the
    normal distribution, with the variance that the ties leave and a correction for
    continuity.

    Args:
        first: Shape (m,), m > 0.
        second: Shape (n,), n > 0.

    Returns:
        The probability that a value of `first` is larger than one of `second`, ties
        counting half (the area under the ROC curve; 0.5: neither is larger); and the
        two-sided p-value, how likely it would be as far from 0.5 by chance.

    Raises:
        ValueError: If a sample is empty.
    """
    m, n = len(first), len(second)
    if m == 0 or n == 0:
        raise ValueError(f"rank_auc of samples of {m} and {n} values; both need some")
    ranks = midranks(np.concatenate([first, second]))
    doubled = np.rint(2.0 * ranks).astype(int)
    above = float(ranks[:m].sum()) - m * (m + 1) / 2.0
    few = doubled[:m] if m <= n else doubled[m:]
    if len(few) * (m + n) <= _EXACT:
        chances = _rank_sum_distribution(tuple(sorted(doubled.tolist())), len(few))
        at = int(few.sum())
        tail = min(chances[: at + 1].sum(), chances[at:].sum())
        return above / (m * n), float(min(1.0, 2.0 * tail))
    _, ties = np.unique(doubled, return_counts=True)
    total = m + n
    variance = m * n / 12.0 * (total + 1 - (ties**3 - ties).sum() / total / (total - 1))
    distance = max(0.0, abs(above - m * n / 2.0) - 0.5)
    p = _two_sided(distance / math.sqrt(variance)) if variance > 0.0 else 1.0
    return above / (m * n), p


@functools.lru_cache(maxsize=64)  # quantities without ties share theirs
def _rank_sum_distribution(doubled: tuple[int, ...], chosen: int) -> Vector:
    """P(sum = s) for s = 0, 1, ... of `chosen` of the doubled ranks, drawn at random.

    After each rank, `ways[k, s]` is the number of ways to choose k of those seen so
    far with the sum s; as all are added, no digits cancel.
    """
    ways = np.zeros((chosen + 1, sum(doubled[-chosen:]) + 1))
    ways[0, 0] = 1.0
    for rank in doubled:
        ways[1:, rank:] += ways[:-1, :-rank].copy()
    return ways[-1] / ways[-1].sum()


def spearman(first: Vector, second: Vector) -> tuple[float, float]:
    """Return the rank correlation of two quantities, and its two-sided p-value.

    C. Spearman, Am. J. Psychol. 15:72, 1904. Without a relation its variance is
    1 / (n - 1); the p-value is that of the normal distribution. (nan, 1) where one of
    the quantities does not vary.

    Args:
        first: Shape (n,).
        second: Shape (n,).
    """
    a, b = midranks(first), midranks(second)
    a, b = a - a.mean(), b - b.mean()
    norm = math.sqrt(float(a @ a) * float(b @ b)) if len(a) else 0.0
    if norm == 0.0:
        return math.nan, 1.0
    rho = float(a @ b) / norm
    return rho, _two_sided(abs(rho) * math.sqrt(len(a) - 1.0))


def benjamini_hochberg(p_values: Vector) -> Vector:
    """Adjust p-values for how many there are; shape (n,) to shape (n,).

    Calling those at most q significant keeps the expected share of false ones among
    them at most q (Y. Benjamini, Y. Hochberg, J. R. Stat. Soc. B 57:289, 1995).
    """
    p = np.asarray(p_values, dtype=float)
    order = np.argsort(p)[::-1]
    factors = len(p) / np.arange(len(p), 0, -1)
    adjusted = np.empty_like(p)
    adjusted[order] = np.minimum.accumulate(np.minimum(1.0, p[order] * factors))
    return adjusted


def _two_sided(z: float) -> float:
    return math.erfc(z / math.sqrt(2.0))
