import itertools
import math
from statistics import NormalDist

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.sweeps import statistics
from drake_srg.sweeps.rows import read_rows, row_path, write_row
from drake_srg.sweeps.statistics import (
    rank_auc,
    spearman,
    summary,
    wilson_interval,
)
from drake_srg.sweeps.trial import empty_row

from .test_rows import INFO


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [
        (10, 10, 0.7225, 1.0),
        (0, 10, 0.0, 0.2775),
        (0, 0, 0.0, 1.0),
        # R. G. Newcombe, Stat. Med. 17:857, 1998, table I, method 3.
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_wilson_intervals_match_published_ones(successes, trials, low, high):
    assert wilson_interval(successes, trials) == pytest.approx((low, high), abs=5e-5)


@given(st.integers(1, 2000), st.data())
def test_the_observed_share_is_z_deviations_from_wilson_bounds(n, data):
    k = data.draw(st.integers(0, n))
    low, high = wilson_interval(k, n)
    assert 0.0 <= low <= k / n <= high <= 1.0
    z = NormalDist().inv_cdf(0.975)
    for p in (low, high):
        if 1e-9 < p < 1.0 - 1e-9:
            deviations = abs(k / n - p) / math.sqrt(p * (1.0 - p) / n)
            assert deviations == pytest.approx(z, rel=1e-6)


@pytest.mark.parametrize("arguments", [(-1, 5), (6, 5)])
def test_wilson_rejects_impossible_arguments(arguments):
    with pytest.raises(ValueError, match="needs 0 <= successes"):
        wilson_interval(*arguments)


small = st.lists(st.integers(0, 6).map(float), min_size=1, max_size=5)


@given(small, small)
def test_small_samples_are_compared_exactly_even_with_ties(first, second):
    pooled = first + second
    ranks = scipy.stats.rankdata(pooled)
    auc, p = rank_auc(np.array(first), np.array(second))
    wins = sum((a > b) + 0.5 * (a == b) for a in first for b in second)
    assert auc == pytest.approx(wins / len(first) / len(second))
    # Every choice of the values that form the first sample is equally likely.
    seen = ranks[: len(first)].sum()
    sums = [sum(c) for c in itertools.combinations(ranks, len(first))]
    tails = sum(s <= seen for s in sums), sum(s >= seen for s in sums)
    assert p == pytest.approx(min(1.0, 2.0 * min(tails) / len(sums)))


@pytest.mark.parametrize("shift", [0.0, 0.3, 0.6])
@pytest.mark.parametrize("ties", [False, True])
def test_exact_and_normal_p_values_agree_for_large_samples(monkeypatch, shift, ties):
    random = np.random.default_rng(0)
    first, second = random.normal(shift, size=50), random.normal(size=150)
    if ties:
        first, second = np.round(2.0 * first), np.round(2.0 * second)
    exact = rank_auc(first, second)
    monkeypatch.setattr(statistics, "LARGEST_EXACT", 0)
    assert rank_auc(first, second) == pytest.approx(exact, abs=5e-3)


def test_a_comparison_needs_two_samples():
    with pytest.raises(ValueError, match="must not be empty, got 0 and 1"):
        rank_auc(np.array([]), np.array([1.0]))


def test_constant_quantities_show_no_relation():
    assert rank_auc(np.ones(300), np.ones(300)) == (0.5, 1.0)
    rho, p = spearman(np.ones(5), np.arange(5.0))
    assert (math.isnan(rho), p) == (True, 1.0)


@pytest.fixture
def summarize(tmp_path):
    """Return the lines of the summary of rows, given what they differ in."""
    INFO.write(tmp_path)

    def run(*rows):
        for trial, values in enumerate(rows):
            write_row(row_path(tmp_path, trial), empty_row(7, trial, "") | values)
        lines = summary(read_rows(tmp_path)).splitlines()
        return [" ".join(line.split()) for line in lines]

    return run


def success(cycle_time):
    return {"success": True, "failure": None, "claimed": True} | {
        "cycle_time_s": cycle_time,
        "time_to_placement_s": cycle_time - 2.0,
        "grasp_lifted": True,
    }


def test_the_summary_counts_outcomes_and_reasons(summarize):
    assert summarize(
        success(7.0),
        success(9.0),
        success(8.0),
        {"failure": "dropped", "grasp_lifted": False},
        {"failure": "dropped", "cycle_time_s": 30.0},
        {"failure": "misplaced", "claimed": True},
    ) == [
        "success 3 of 6, 50.00%",
        "95 % interval (Wilson) 18.76% to 81.24%",
        "grasped and lifted 3 of 4",
        "failure: dropped 2",
        "failure: misplaced 1",
        "wrongly reported done 1",
        "median to placement 6 s",
        "median cycle 8 s",
    ]


def test_the_median_cycle_is_one_that_occurred_as_in_the_report(summarize):
    assert summarize(success(7.0), success(8.0))[-1] == "median cycle 7 s"


@pytest.mark.parametrize("rows", [[], [{}]])
def test_a_sweep_without_successes_has_no_median_cycle(summarize, rows):
    lines = summarize(*rows)
    assert lines[0].startswith(f"success 0 of {len(rows)}")
    assert lines[-1] == "wrongly reported done 0"
