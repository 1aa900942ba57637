"""Rewards: what they look at, and that measures of grasps are bounded and ordered."""

import dataclasses as dc

import gymnasium
import numpy as np
import pytest

from drake_srg.learning.envs.rewards import REWARDS, measure_reward
from drake_srg.planning.grasps.grasp_measures import Body, Patch
from drake_srg.station.held_grasp import HeldGrasp
from learning.envs.playing import one_shot

MEASURED = [name for name in REWARDS if name not in ("shaped", "success", "lifted")]


@pytest.fixture(scope="module")
def held():
    """The environment after a grasp that held."""
    env = gymnasium.make("drake_srg/GraspOneShot-v0").unwrapped
    env.reset(seed=0)
    assert env.step(one_shot(env))[-1]["success"]
    return env


def test_a_grasp_is_read_before_the_shake(held):
    patches, body = held.truth().grasp
    thing = held.scene.object
    assert len(patches) >= 2
    assert all(patch.normal_force.sum() > 0.0 for patch in patches)
    assert body.mass == pytest.approx(thing.mass)
    # Drake's mean of two coefficients, of the object's and of the pads'.
    assert all(0.0 < patch.friction <= 2.0 * thing.friction for patch in patches)
    lifted = held.table + 0.1 + 0.5 * held.scene.shape.height
    assert body.p_WB[2] == pytest.approx(lifted, abs=0.05)


@pytest.mark.parametrize("name", MEASURED)
def test_a_measure_rewards_what_was_lifted_and_nothing_else(held, name):
    truth = held.truth()
    assert 0.0 < REWARDS[name](None, truth) <= 1.0
    assert REWARDS[name](None, dc.replace(truth, grasp=None)) == 0.0
    # The shake does not count.
    lost = dc.replace(truth, success=False, lost=True)
    assert REWARDS[name](None, lost) == REWARDS[name](None, truth)


def test_only_the_shake_tells_success_from_a_lift(held):
    lost = dc.replace(held.truth(), success=False)
    assert (REWARDS["lifted"](None, lost), REWARDS["success"](None, lost)) == (1.0, 0.0)


def pinch(force, truth):
    """A truth in which two pads of four points press."""
    corners = np.array([(x, 0.0, z) for x in (-0.01, 0.01) for z in (-0.01, 0.01)])
    patches = [
        Patch(
            corners + np.array([0.0, 0.03 * side, 0.0]),
            np.tile([0.0, -side, 0.0], (4, 1)),
            np.full(4, force / 4),
            0.5,
            np.array([0.0, -side * force, 1.0]),
        )
        for side in (-1.0, 1.0)
    ]
    return dc.replace(truth, grasp=HeldGrasp(patches, Body(0.3, np.zeros(3), 0.05)))


@pytest.mark.parametrize(
    "name", ["epsilon, forces", "resisted acceleration", "friction margin"]
)
def test_a_firmer_grasp_has_a_greater_reward(held, name):
    reward = measure_reward(name)
    values = [reward(None, pinch(force, held.truth())) for force in (8.0, 20.0, 200.0)]
    assert values == sorted(values)
    assert values[0] < values[2] < 1.0


def test_a_new_episode_has_no_grasp_yet(held):
    held.reset(seed=1)
    assert held.truth().grasp is None
