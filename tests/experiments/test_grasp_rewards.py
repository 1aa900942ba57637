"""Learning from a measure of the grasp."""

import numpy as np
import pytest

from drake_srg.experiments.grasp_rewards import (
    LIFT,
    PROGRESS,
    REWARDS,
    SHAKE,
    MeasuredGraspEnv,
    learn,
    usual,
)
from drake_srg.learning.rules import grasp_one_shot


@pytest.fixture(scope="module")
def env():
    return MeasuredGraspEnv(noise=0.0)


def test_a_good_grasp_earns_every_reward(env):
    observation, _ = env.reset(seed=0)
    grasp = env.play(grasp_one_shot(observation))
    assert grasp.survived
    assert set(grasp.values) == set(REWARDS)
    assert grasp.values[SHAKE] == grasp.values[LIFT] == 1.0
    assert grasp.values[PROGRESS] > 0.9
    assert grasp.values["resisted acceleration"] > 6.0  # the shake's along each axis


def test_a_grasp_of_air_earns_nothing_but_progress(env):
    env.reset(seed=0)
    grasp = env.play(np.array([1.0, 1.0, 1.0, 0.0, -1.0, 1.0], np.float32))
    assert not grasp.survived
    assert not any(v for name, v in grasp.values.items() if name != PROGRESS)


def test_learning_is_judged_by_shakes(env):
    learned = learn(env, "slip margin", 0, episodes=2, trials=1)
    assert learned["checks"] == [(2, float(learned["survived"]))]
    assert learned == learn(env, "slip margin", 0, episodes=2, trials=1)


@pytest.mark.parametrize(
    ("values", "scale"), [([], 1.0), ([0.0, 0.0], 1.0), ([0.0, 2.0, 4.0], 3.0)]
)
def test_what_a_measure_usually_is(values, scale):
    assert usual(values) == scale
