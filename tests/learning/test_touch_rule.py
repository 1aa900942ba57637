import numpy as np
import pytest

from drake_srg.learning.episodes import make_environment, run_episode
from drake_srg.learning.rules import pick
from drake_srg.learning.sweep_rule import pick_by_sweep


@pytest.fixture(scope="module")
def env():
    return make_environment("Pick", {"noise": 0.02})


def scene_of(env, seed):
    return env.reset(seed=seed)[1]["scene"], env.unwrapped.scene.is_round


def test_boxes_are_picked_as_without_a_sweep(env):
    observations = []

    def act(observation):
        observations.append(observation)
        return pick(observation)

    seed = next(k for k in range(100) if not scene_of(env, k)[1])
    run_episode(env, act, seed)
    for observation in observations:
        np.testing.assert_array_equal(pick_by_sweep(observation), pick(observation))


@pytest.mark.slow
def test_it_holds_cylinders_that_are_far_from_where_they_were_seen(env):
    """Seen 25 mm to one side, across the closing direction."""
    held = {}
    seeds = [k for k in range(60) if scene_of(env, k)[1]][:10]
    for rule in (pick, pick_by_sweep):
        held[rule] = 0
        for seed in seeds:
            scene, _ = scene_of(env, seed)
            scene["estimate_error"] = [0.025, 0.0]
            observation, _ = env.reset(options={"scene": scene})
            ended = False
            while not ended:
                observation, _, terminated, truncated, info = env.step(
                    rule(observation)
                )
                ended = terminated or truncated
            held[rule] += info["success"]
    assert held[pick] <= 3
    assert held[pick_by_sweep] >= 7
