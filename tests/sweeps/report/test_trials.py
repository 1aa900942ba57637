import itertools

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.sweeps.report.trials import (
    FALSE_DISCOVERIES,
    Trials,
    median_bins,
    rank_effects,
    success_bins,
)
from drake_srg.sweeps.statistics import wilson_interval
from sweeps.report.made_sweep import CAMERA, FRICTION, MASS, MODEL, made_rows


def trials_of(rows):
    return Trials(pa.table(rows), [name for name in rows if "." in name])


def ranked(rows):
    trials = trials_of(rows)
    return rank_effects(
        trials.quantities(), trials.success, trials.placement_error, trials.cycle_time
    )


def test_causes_are_ranked_first_and_distinguished():
    effects = ranked(made_rows(1000))
    first, second, third = effects[:3]
    assert {first.name, second.name} == {CAMERA, FRICTION}
    camera, friction = sorted((first, second), key=lambda effect: effect.name)
    # Yaw to either side is bad, and only low friction; yaw also shifts the hand.
    assert camera.failure.ends and camera.failure.strength > 0.5
    assert not friction.failure.ends and friction.failure.strength < 0.5
    assert camera.placement.ends and camera.placement.strength > 0.3
    assert third.name == MASS
    assert not third.failure.significant
    assert third.cycle.significant and third.cycle.strength > 0.3


def test_few_failures_reveal_a_strong_cause():
    effects = ranked(made_rows(1000, failure_rate=0.006))
    causes = {e.name for e in effects if e.failure.significant}
    assert causes and causes <= {CAMERA, FRICTION}


@pytest.mark.slow
def test_noise_is_rarely_taken_for_a_cause():
    # Without any effect, the adjustment bounds the share of sweeps with a finding.
    found = sum(
        any(effect.failure.significant for effect in ranked(rows))
        for rows in (
            made_rows(100, effects=False, seed=seed, failure_rate=0.1)
            for seed in range(20)
        )
    )
    expected = 20 * FALSE_DISCOVERIES
    assert found <= expected + 3.0 * np.sqrt(expected)


@pytest.mark.parametrize("rate", [0.0, 1.0])
def test_failures_are_not_compared_without_both_outcomes(rate):
    effects = ranked(made_rows(30, failure_rate=rate))
    assert all(effect.failure is None for effect in effects)
    assert all((effect.cycle is None) == (rate == 1.0) for effect in effects)


def test_every_word_is_a_quantity_and_a_constant_is_none():
    rows = made_rows(100) | {"objects.table.color": [1.0] * 100}
    names = trials_of(rows).quantities().keys()
    assert {f"{MODEL} = {word}" for word in ("mug", "cube", "banana")} <= names
    assert MODEL not in names
    assert "objects.table.color" not in names


def test_quantities_of_few_trials_are_left_out():
    rows = made_rows(100)
    rows |= {"objects.rare.mass": [float(t) if t < 9 else None for t in range(100)]}
    assert "objects.rare.mass" not in trials_of(rows).quantities()


def test_the_distance_of_clutter_covers_all_pieces():
    n = 20
    rows = made_rows(n) | {
        f"objects.{name}.position[{axis}]": values
        for name, xs, ys in (
            ("soup_can", [0.0] * n, [0.0] * n),
            ("clutter_1", [3.0] * n, [4.0] * n),
            ("clutter_2", [*range(19), None], [0.0] * 19 + [None]),
        )
        for axis, values in enumerate((xs, ys))
    }
    nearest = trials_of(rows).quantities()["clutter: nearest to another object"]
    assert nearest.tolist() == [min(5.0, x) for x in range(19)] + [5.0]
    assert not any("nearest" in n for n in trials_of(made_rows(n)).quantities())


def test_trials_without_a_value_are_in_no_bin():
    values = np.array([np.nan, 1.0, 2.0, 1.0, 2.0])
    rows = success_bins(values, np.array([False, True, False, True, True]))
    assert [(b.low, b.trials, b.outcome) for b in rows] == [
        (1.0, 2, 1.0),
        (2.0, 2, 0.5),
    ]


def test_few_distinct_values_are_binned_together():
    assert len(success_bins(np.array([0.1, 0.2, 0.3, 0.4]), np.ones(4, bool))) == 2


some_values = st.one_of(st.none(), st.integers(0, 30).map(float), st.floats(-1.0, 1.0))


@given(st.lists(st.tuples(some_values, st.booleans()), min_size=1, max_size=300))
def test_bins_hold_every_trial_once_in_order(pairs):
    values = np.array([np.nan if v is None else v for v, _ in pairs])
    success = np.array([s for _, s in pairs])
    rows = success_bins(values, success)
    finite = np.isfinite(values)
    assert sum(b.trials for b in rows) == np.count_nonzero(finite)
    assert len(rows) <= 8
    for b in rows:
        inside = finite & (b.low <= values) & (values <= b.high)
        assert np.count_nonzero(inside) == b.trials > 0
        assert b.low <= b.middle <= b.high
        k = np.count_nonzero(inside & success)
        assert b.outcome == k / b.trials
        assert b.bounds == wilson_interval(k, b.trials)
    assert all(a.high < b.low for a, b in itertools.pairwise(rows))


def test_medians_ignore_trials_without_an_outcome():
    values = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    outcome = np.array([5.0, 7.0, np.nan, 9.0, 9.0, np.nan])
    rows = median_bins(values, outcome)
    assert [(b.trials, b.outcome, b.bounds) for b in rows] == [
        (2, 6.0, (5.5, 6.5)),
        (2, 9.0, (9.0, 9.0)),
    ]


def test_trials_wrongly_reported_done_are_worst_then_other_failures():
    rows = {
        "trial": [0, 1, 2, 3, 4],
        "seed": [5, 6, 7, 8, 9],
        "success": [True, False, False, True, False],
        "failure": [None, "dropped", "misplaced", None, "error"],
        "message": [None, "lost it", None, None, "ValueError"],
        "claimed": [True, False, True, True, None],
        "placement_error_m": [[0.0, 0.0], [0.3, 0.4], [0.1, 0.0], [0.02, 0.0], None],
    }
    trials = trials_of(rows)
    # An unknown error counts as the largest.
    assert trials.worst() == [2, 4, 1, 3, 0]
    assert trials.placement_error[1] == pytest.approx(0.5)
    assert trials.claimed.tolist() == [False, False, True, False, False]
