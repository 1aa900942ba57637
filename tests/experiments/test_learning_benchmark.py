import numpy as np
import pytest

from drake_srg.experiments.learning_benchmark import CASES, Speed, judge, measure


def test_an_environment_is_measured():
    speed = measure(CASES[0], 2)
    assert speed.held == 1.0
    assert min(*speed.ticks, *speed.free, *speed.resets) > 0.0


@pytest.mark.parametrize(
    ("change", "fails"),
    [
        ({}, 0),
        ({"ticks": np.array([10.0])}, 1),
        ({"resets": np.array([9.0])}, 1),
        ({"held": 0.5}, 1),
        ({"growth": 1.0}, 1),
    ],
)
def test_what_is_slow_or_grows_fails(change, fails):
    good = {"ticks": np.array([2e3]), "free": np.array([3e3]), "held": 1.0}
    speed = Speed(**{**good, "resets": np.array([1.0]), "growth": 0.0, **change})
    assert sum(not row.passed for row in judge(CASES[0], speed)) == fails
