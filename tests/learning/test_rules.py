import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.envs.pick import PickEnv
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
    x = np.zeros(len(PickEnv.observation_names), np.float32)
    x[[0, 3, 5, 6, 7, 8, 22]] = 0.5, 1.0, 0.85, 0.3, 0.3, 0.5, -1.0
    action = pick(x)
    assert action[0] > 0.9  # 10 cm
    assert action[2] == 0.0
    assert action[4] == -1.0


def turn_towards(yaw, size_x, size_y, **options):
    """The turn of a hand right over a box that is turned by `yaw`."""
    x = np.zeros(len(PickEnv.observation_names), np.float32)
    x[3:5] = np.cos(2.0 * yaw), np.sin(2.0 * yaw)
    x[[5, 6, 7, 8, 22]] = 0.85, size_x / 0.15, size_y / 0.15, 0.5, -1.0
    return pick(x, **options)[3]


@pytest.mark.parametrize("size", [0.04, 0.06, 0.08])
@pytest.mark.parametrize(
    ("yaw", "sign"), [(0.0, 0), (0.5, 1), (1.0, -1), (-0.5, -1), (-1.0, 1)]
)
def test_a_box_is_grasped_across_its_nearer_side(size, yaw, sign):
    assert np.sign(np.round(turn_towards(yaw, 0.06, size), 6)) == sign


@given(st.floats(-0.7, 0.7))
def test_a_narrower_side_is_worth_some_turning(yaw):
    farther = 0.5 * np.pi + 2.0 * yaw  # turning counterclockwise to the other side
    for width, decided in ((0.9, False), (1.1, True)):
        size = 0.04 + width * farther / 100.0
        turn = turn_towards(yaw, 0.04, size, narrower=100.0)
        assert turn == (1.0 if decided else turn_towards(yaw, 0.04, size))
        # Where it is narrower anyway, the nearer side stays the better one.
        nearer = turn_towards(yaw, size, 0.04, narrower=100.0)
        assert nearer == turn_towards(yaw, size, 0.04)


def test_a_wide_box_is_grasped_across_its_narrower_side():
    assert turn_towards(0.0, 0.12, 0.07) == pytest.approx(0.0, abs=1e-6)
    assert abs(turn_towards(0.0, 0.07, 0.12)) == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("name", RULES)
def test_a_rule_succeeds(name):
    env = make_environment(name)
    done = [run_episode(env, RULES[name], training_seed(999, k)) for k in range(4)]
    # Where between the pads it holds an object, it does not know.
    least = 1 if "Place" in name else 3
    assert sum(episode.success for episode in done) >= least
