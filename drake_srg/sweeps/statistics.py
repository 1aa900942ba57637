"""Statistics of many trials, in NumPy alone."""

from __future__ import annotations

import functools
import math
from statistics import NormalDist

import numpy as np

from drake_srg.types import Vector

# An exact rank-sum distribution takes (chosen * number)² steps; this is the largest
# product that is worth it.
LARGEST_EXACT = 10_000


def wilson_interval(
    successes: int, trials: int, confidence: float = 0.95
) -> tuple[float, float]:
    """Return the bounds of a success probability, given the observed successes.

    E. B. Wilson, J. Am. Stat. Assoc. 22:209, 1927: the probabilities p from which the
    observed share is at most z standard deviations √(p (1 - p) / n) away.

    Args:
        successes: 0 .. `trials`.
        trials: 0 gives (0, 1): nothing is known.
        confidence: Probability that the bounds contain the true value, between 0 and 1.

    Raises:
        ValueError: If an argument is out of range.
    """
    if not (0 <= successes <= trials and 0.0 < confidence < 1.0):
        raise ValueError(
            "wilson_interval: needs 0 <= successes <= trials and 0 < confidence < 1, "
            f"got successes={successes}, trials={trials}, confidence={confidence}"
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
    # Rounding may leave the observed share just outside.
    return min(max(0.0, centre - half), share), max(min(1.0, centre + half), share)


def midranks(values: Vector) -> Vector:
    """Return the ranks 1 .. n of values, shape (n,); equal values share their mean."""
    _, inverse, counts = np.unique(values, return_inverse=True, return_counts=True)
    ends = np.cumsum(counts)
    return (ends - (counts - 1) / 2.0)[inverse]


def rank_auc(first: Vector, second: Vector) -> tuple[float, float]:
    """Compare two samples with the Mann-Whitney test.

    H. B. Mann, D. R. Whitney, Ann. Math. Stat. 18:50, 1947. If one of the samples is
    small, the p-value is exact, even with ties. Otherwise it comes from the normal
    approximation, with a variance corrected for ties and a continuity correction.

    Args:
        first: Shape (m,), m > 0.
        second: Shape (n,), n > 0.

    Returns:
        The probability that a value of `first` is larger than one of `second`, where
        ties count half (the area under the ROC curve; 0.5: neither is larger); and the
        two-sided p-value: how likely chance alone puts it as far from 0.5.

    Raises:
        ValueError: If a sample is empty.
    """
    m, n = len(first), len(second)
    if m == 0 or n == 0:
        raise ValueError(f"rank_auc: samples must not be empty, got {m} and {n} values")
    ranks = midranks(np.concatenate([first, second]))
    doubled = np.rint(2.0 * ranks).astype(int)
    above = float(ranks[:m].sum()) - m * (m + 1) / 2.0
    few = doubled[:m] if m <= n else doubled[m:]
    if len(few) * (m + n) <= LARGEST_EXACT:
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


@functools.lru_cache(maxsize=64)  # quantities without ties share one
def _rank_sum_distribution(doubled: tuple[int, ...], chosen: int) -> Vector:
    """Return P(sum = s), s = 0, 1, ..., for `chosen` doubled ranks drawn at random.

    After each rank, `ways[k, s]` is the number of ways to choose k of the ranks so far
    with the sum s. All terms are positive, so no digits cancel.
    """
    ways = np.zeros((chosen + 1, sum(doubled[-chosen:]) + 1))
    ways[0, 0] = 1.0
    for rank in doubled:
        ways[1:, rank:] += ways[:-1, :-rank].copy()
    return ways[-1] / ways[-1].sum()


def spearman(first: Vector, second: Vector) -> tuple[float, float]:
    """Return the rank correlation of two quantities, and its two-sided p-value.

    C. Spearman, Am. J. Psychol. 15:72, 1904. Without a relation, the variance of the
    correlation is 1 / (n - 1); the p-value comes from the normal distribution. If one
    of the quantities does not vary, the result is (nan, 1).

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
    """Adjust p-values, shape (n,), for their number.

    If results with an adjusted value of at most q are called significant, the expected
    share of false ones among them is at most q (Y. Benjamini, Y. Hochberg, J. R. Stat.
    Soc. B 57:289, 1995).
    """
    p = np.asarray(p_values, dtype=float)
    order = np.argsort(p)[::-1]
    factors = len(p) / np.arange(len(p), 0, -1)
    adjusted = np.empty_like(p)
    adjusted[order] = np.minimum.accumulate(np.minimum(1.0, p[order] * factors))
    return adjusted


def _two_sided(z: float) -> float:
    return math.erfc(z / math.sqrt(2.0))
