"""Statistics of many trials, and the summary of a sweep."""

from __future__ import annotations

import collections
import functools
import math
import statistics
from statistics import NormalDist
from typing import Any

import numpy as np

from drake_srg.types import Vector

# An exact rank-sum distribution takes (chosen * number)² steps. Beyond this product, it
# would take too long.
LARGEST_EXACT = 10_000


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Return the 95 % bounds of a success probability, given observed successes.

    E. B. Wilson, J. Am. Stat. Assoc. 22:209, 1927: the interval of all p for which the
    observed share is within z standard deviations √(p (1 - p) / n) of p.

    Args:
        successes: 0 .. `trials`.
        trials: Number of trials; 0 gives (0, 1).

    Raises:
        ValueError: If an argument is out of range.
    """
    if not 0 <= successes <= trials:
        raise ValueError(
            "wilson_interval: needs 0 <= successes <= trials, "
            f"got successes={successes}, trials={trials}"
        )
    if trials == 0:
        return 0.0, 1.0
    z = NormalDist().inv_cdf(0.975)
    share, weight = successes / trials, z * z / trials
    centre = (share + weight / 2.0) / (1.0 + weight)
    half = (
        z
        / (1.0 + weight)
        * math.sqrt(share * (1.0 - share) / trials + weight / trials / 4.0)
    )
    # Rounding may leave the observed share just outside.
    return min(max(0.0, centre - half), share), max(min(1.0, centre + half), share)


def rank_auc(first: Vector, second: Vector) -> tuple[float, float]:
    """Compare two samples with the Mann-Whitney test.

    H. B. Mann, D. R. Whitney, Ann. Math. Stat. 18:50, 1947. If one of the samples is
    small, the p-value is exact, even with ties. Otherwise it comes from the normal
    approximation, with a variance corrected for ties and a continuity correction.

    Args:
        first: Shape (m,), m > 0.
        second: Shape (n,), n > 0.

    Returns:
        The probability that a value of `first` is larger than one of `second`, with
        ties counted half (the area under the ROC curve; 0.5 means no difference); and
        the two-sided p-value, the probability of such a difference by chance.

    Raises:
        ValueError: If a sample is empty.
    """
    m, n = len(first), len(second)
    if m == 0 or n == 0:
        raise ValueError(f"rank_auc: samples must not be empty, got {m} and {n} values")
    import scipy.stats

    above, p = scipy.stats.mannwhitneyu(first, second, method="asymptotic")
    if min(m, n) * (m + n) <= LARGEST_EXACT:
        # SciPy's exact p-values do not allow for ties. Its approximation gives
        # p = 1e-218 for a word drawn once in 1000 trials, in the only failed one.
        ranks = scipy.stats.rankdata(np.concatenate([first, second]))
        doubled = np.rint(2.0 * ranks).astype(int)
        few = doubled[:m] if m <= n else doubled[m:]
        chances = _rank_sum_distribution(tuple(sorted(doubled.tolist())), len(few))
        at = int(few.sum())
        p = min(1.0, 2.0 * min(chances[: at + 1].sum(), chances[at:].sum()))
    return float(above) / (m * n), float(p)


@functools.lru_cache(maxsize=64)  # all quantities without ties share a distribution
def _rank_sum_distribution(doubled: tuple[int, ...], chosen: int) -> Vector:
    """Return P(sum = s), s = 0, 1, ..., for `chosen` doubled ranks drawn at random.

    `ways[k, s]` is the number of ways to choose k of the ranks so far with the sum s.
    All terms are positive, so no digits cancel.
    """
    ways = np.zeros((chosen + 1, sum(doubled[-chosen:]) + 1))
    ways[0, 0] = 1.0
    for rank in doubled:
        ways[1:, rank:] += ways[:-1, :-rank].copy()
    return ways[-1] / ways[-1].sum()


def spearman(first: Vector, second: Vector) -> tuple[float, float]:
    """Return the rank correlation of two quantities, and its two-sided p-value.

    C. Spearman, Am. J. Psychol. 15:72, 1904. The p-value comes from Student's
    distribution with n - 2 degrees of freedom. If one of the quantities does not vary,
    the result is (nan, 1).

    Args:
        first: Shape (n,), n > 2.
        second: Shape (n,).
    """
    import scipy.stats

    if np.ptp(first) == 0.0 or np.ptp(second) == 0.0:
        return math.nan, 1.0
    rho, p = scipy.stats.spearmanr(first, second)
    return float(rho), float(p)


def summary(rows: Any) -> str:
    """Return a short table: success rate, grasps, failures by reason, median times.

    The rows are those of `rows.read_rows`.
    """
    trials = rows.num_rows
    succeeded = sum(rows["success"].to_pylist())
    low, high = wilson_interval(succeeded, trials)
    share = f", {succeeded / trials:.2%}" if trials else ""
    failures = collections.Counter(f for f in rows["failure"].to_pylist() if f)
    wrong = sum(
        claimed and not success
        for claimed, success in zip(
            rows["claimed"].to_pylist(), rows["success"].to_pylist(), strict=True
        )
    )
    lifted = [lift for lift in rows["grasp_lifted"].to_pylist() if lift is not None]

    def median(name: str) -> str:
        times = rows.filter(rows["success"])[name].drop_null().to_pylist()
        return f"{statistics.median_low(times):.3g} s" if times else ""

    lines = [
        ("success", f"{succeeded} of {trials}{share}"),
        ("95 % interval (Wilson)", f"{low:.2%} to {high:.2%}"),
        ("grasped and lifted", f"{sum(lifted)} of {len(lifted)}" if lifted else ""),
        *((f"failure: {name}", str(n)) for name, n in failures.most_common()),
        ("wrongly reported done", str(wrong)),
        ("median to placement", median("time_to_placement_s")),
        ("median cycle", median("cycle_time_s")),
    ]
    return "\n".join(f"{name:24} {value}" for name, value in lines if value)
