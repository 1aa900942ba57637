"""LeRobot's contract: https://huggingface.co/docs/lerobot/envhub and its `rollout`.

LeRobot is gigabytes, so requirements.lock leaves it out. The tests do with our
environments what its `lerobot-eval` does; `make test-lerobot` runs the last ones.
"""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, VectorEnv

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.envs import ENVIRONMENTS
from drake_srg.learning.envs.lerobot_env import LeRobotEnv, make_env

EXAMPLES = Path(__file__).parents[3] / "examples" / "lerobot"


def loaded_from_a_repository():
    """The module env.py of a repository, as EnvHub imports it."""
    spec = importlib.util.spec_from_file_location("hub_env", EXAMPLES / "env.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def rolled_out(vector, act, seeds):
    """Success of each copy's episode, read as LeRobot's `rollout` reads it."""
    observation, _ = vector.reset(seed=list(seeds))
    done = np.zeros(vector.num_envs, bool)
    success = done.copy()
    for _ in range(vector.call("_max_episode_steps")[0]):
        action = act(observation)
        observation, _, terminated, truncated, info = vector.step(action)
        if "final_info" in info:
            assert isinstance(info["final_info"], dict)
            success |= np.array(info["final_info"]["is_success"].tolist(), bool) & ~done
        done |= terminated | truncated
        if done.all():
            break
    assert done.all()
    return success


def test_a_repository_with_env_py_has_what_envhub_calls():
    envs = loaded_from_a_repository().make_env(n_envs=2, use_async_envs=False)
    ((suite, tasks),) = envs.items()
    assert (suite, [*tasks]) == ("drake_srg", [0])
    vector = tasks[0]
    assert isinstance(vector, VectorEnv)
    assert vector.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert vector.call("task") == ("Pick-v0",) * 2
    assert vector.call("task_description") == ("Pick up the object.",) * 2
    assert vector.unwrapped.metadata["render_fps"] == 21
    vector.close()


def test_success_is_where_lerobot_looks_for_it():
    vector = make_env(n_envs=3, name="GraspOneShot-v0")["drake_srg"][0]

    def grasp(observation):
        size = observation["environment_state"][:, :3]
        turn = np.where(size[:, 1] <= size[:, 0], 0.0, 1.0)
        zeros, ones = np.zeros(3), np.ones(3)
        return np.stack([zeros, zeros, -0.4 * ones, turn, -ones, 0.8 * ones], axis=1)

    # A hand that goes straight to the object takes most, but not every one.
    assert rolled_out(vector, grasp, range(3)).any()
    # Hands that stay open hold nothing.
    assert not rolled_out(vector, lambda _: -np.ones((3, 6)), range(3)).any()
    vector.close()


@pytest.mark.parametrize("name", sorted(ENVIRONMENTS))
def test_every_entry_is_in_one_part_of_the_observation(name):
    env = LeRobotEnv(name)
    observation, info = env.reset(seed=1, options={"lerobot_new_rollout": True})
    assert env.observation_space.contains(observation)
    assert info == {"is_success": False}
    state = env.unwrapped.state()
    parts = np.concatenate([observation[key] for key in env.observation_space])
    np.testing.assert_array_equal(np.sort(parts), np.sort(state))
    env.close()


def test_the_robots_own_yaw_is_no_part_of_the_environment():
    env = LeRobotEnv("Pick-v0")
    observation, _ = env.reset(seed=1)
    about_it = ("object_", "cos_", "sin_", "size_", "round")
    names = [n for n in env.unwrapped.observation_names if n.startswith(about_it)]
    assert observation["environment_state"].size == len(names)
    env.close()


@pytest.mark.slow
def test_images_are_pixels():
    env = LeRobotEnv("KitchenPick-v0", observation="images")
    observation, _ = env.reset(seed=0)
    assert observation["pixels"].dtype == np.uint8
    assert observation["pixels"].shape[2] == 3
    env.close()


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"n_envs": 0}, ValueError, "n_envs: must be at least 1"),
        ({"name": "Pik-v0"}, ScenarioError, "environment: unknown 'Pik-v0'"),
        ({"drive": "x"}, ScenarioError, "unknown keyword 'drive'"),
    ],
)
def test_wrong_arguments_are_one_line(arguments, error, message):
    with pytest.raises(error, match=message) as raised:
        make_env(**arguments)
    assert "\n" not in str(raised.value)


@pytest.mark.lerobot
def test_lerobots_own_loader_takes_them():
    from lerobot.envs import close_envs, preprocess_observation, utils

    module = loaded_from_a_repository()
    made = utils._call_make_env(module, n_envs=1, use_async_envs=False, cfg=None)
    envs = utils._normalize_hub_result(made)
    observation, _ = envs["drake_srg"][0].reset(seed=[0])
    names = set(preprocess_observation(observation))
    assert names == {"observation.state", "observation.environment_state"}
    close_envs(envs)


@pytest.mark.lerobot
def test_lerobots_commands_know_them():
    from lerobot.envs import close_envs, make_env, make_env_config

    import drake_srg.suite.lerobot  # noqa: F401 (imported for its effect)

    config = make_env_config("drake_srg_hand", task="GraspOneShot-v0")
    assert set(config.features) == {"action", "environment_state"}
    envs = make_env(config, n_envs=1)
    assert envs["drake_srg"][0].call("task") == ("GraspOneShot-v0",)
    close_envs(envs)
