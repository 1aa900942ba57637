import numpy as np
import pytest
from gymnasium.spaces import Discrete

from drake_srg.experiments import learning_benchmark
from drake_srg.experiments.learning_benchmark import (
    CASES,
    Speed,
    judge,
    measure,
    memory_growth,
    scaling,
)


def test_an_environment_is_measured():
    speed = measure(CASES[0], 2, 5)
    assert speed.held == 1.0
    assert min(*speed.ticks, *speed.free, *speed.resets) > 0.0


class Growing:
    """An environment that keeps a megabyte per episode, after a warm-up."""

    action_space = Discrete(2)

    def __init__(self):
        self.memory = 300.0

    def reset(self, seed):
        self.memory += 50.0 if seed < 5 else 1.0

    def step(self, action):
        assert action in self.action_space


def test_memory_that_is_kept_is_noticed(monkeypatch):
    env = Growing()
    monkeypatch.setattr(learning_benchmark, "resident_memory", lambda: env.memory)
    assert memory_growth(env, 40) == pytest.approx(1000.0)


def test_workers_are_compared():
    assert scaling(CASES[0], 1) > 0.0


@pytest.mark.parametrize(
    ("change", "fails"),
    [
        ({}, 0),
        ({"ticks": np.array([10.0])}, 1),
        ({"resets": np.array([9.0])}, 1),
        ({"held": 0.5}, 1),
        ({"growth": 2.0}, 1),
    ],
)
def test_what_is_slow_or_grows_fails(change, fails):
    good = {"ticks": np.array([2e3]), "free": np.array([3e3]), "held": 1.0}
    speed = Speed(**{**good, "resets": np.array([1.0]), "growth": 0.0, **change})
    assert sum(not row.passed for row in judge(CASES[0], speed)) == fails
