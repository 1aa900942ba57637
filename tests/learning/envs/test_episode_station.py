"""The observation `blobs`: where cameras see the object."""

import gymnasium
import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from learning.envs.playing import one_shot

NAME = "drake_srg/GraspOneShot-v0"


@pytest.fixture(scope="module")
def env():
    return gymnasium.make(NAME, scenario="learn_kitchen", observation="blobs").unwrapped


def away(env):
    """How far the estimate is from the truth [m]."""
    return np.linalg.norm(env.estimate[:2] - env.scene.position)


def test_objects_of_any_size_are_seen_within_millimetres(env):
    for seed in range(12):  # the eighth is the first thin cylinder
        env.reset(seed=seed)
        assert away(env) < 3e-3, env.scene.tree
        yaw = env.estimate[3] - (0.0 if env.scene.is_round else env.scene.object.yaw)
        # A box looks the same after half a turn, some after a quarter.
        assert abs((yaw + np.pi / 4) % (np.pi / 2) - np.pi / 4) < 0.03


def test_the_same_seed_sees_the_same(env):
    env.reset(seed=5)
    first = env.estimate
    env.reset(seed=6)
    env.reset(seed=5)
    np.testing.assert_array_equal(env.estimate, first)


def test_what_is_not_seen_is_expected_in_the_middle(env, monkeypatch):
    monkeypatch.setattr(env._sight, "find", lambda *_: None)
    env.reset(seed=1)
    np.testing.assert_allclose(env.estimate[:2], [0.57, 0.0], atol=1e-12)


def test_what_is_seen_is_grasped(env):
    env.reset(seed=0)
    assert env.step(one_shot(env))[-1]["success"]


def test_without_a_localizer_there_are_no_blobs():
    with pytest.raises(ScenarioError, match=r"learn_bench: localizer\.cameras"):
        gymnasium.make(NAME, observation="blobs")
