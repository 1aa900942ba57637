import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.learning.episodes import make_environment, run_episode, training_seed
from drake_srg.learning.rules import RULES, grasp_height, grasp_one_shot, pick


@pytest.mark.parametrize("name", RULES)
def test_a_rule_takes_observations_and_gives_actions(name):
    env = make_environment(name)
    low, high = env.observation_space.low, env.observation_space.high
    for seed in range(20):
        x = np.random.default_rng(seed).uniform(low, high).astype(np.float32)
        assert env.action_space.contains(RULES[name](x))


@given(st.floats(0.01, 0.14), st.floats(0.01, 0.14))
def test_the_narrower_side_is_grasped(size_x, size_y):
    x = np.array([size_x, size_y, 0.1, 0.0], np.float32) / 0.15
    turned = grasp_one_shot(x)[3] > 0.5
    assert turned == (x[1] > x[0])


@given(st.floats(0.0, 0.3))
def test_the_hand_stays_above_the_table(size_z):
    assert 0.025 <= grasp_height(size_z) <= 0.115


def test_a_hand_off_to_the_side_moves_before_it_comes_down():
    x = np.zeros(24, np.float32)
    x[[0, 3, 5, 6, 7, 8, 22]] = 0.5, 1.0, 0.85, 0.3, 0.3, 0.5, -1.0
    action = pick(x)
    assert action[0] > 0.9  # 10 cm
    assert action[2] == 0.0
    assert action[4] == -1.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["drake_srg/GraspOneShot-v0"])
def test_a_rule_grasps(name):
    env = make_environment(name)
    done = [run_episode(env, RULES[name], training_seed(999, k)) for k in range(4)]
    assert sum(episode.success for episode in done) >= 3
