"""LeRobot's own commands on the suite; `make test-lerobot` runs this."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.lerobot
COPIES = 2


@pytest.fixture(scope="module")
def config():
    from lerobot.envs import make_env_config

    import drake_srg.suite.lerobot  # noqa: F401 (makes the tasks known)

    return make_env_config("drake_srg", task="pick_can,place_can")


def test_an_installed_plug_in_is_found_by_its_name():
    code = (
        "from lerobot.utils.import_utils import register_third_party_plugins as r;"
        "from lerobot.envs.configs import EnvConfig;"
        "r(); known = {*EnvConfig.get_known_choices()};"
        "assert 'drake_srg' in known"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd="/")


def test_policies_see_features_by_lerobots_names(config):
    from lerobot.envs.utils import env_to_policy_features

    features = env_to_policy_features(config)
    assert {name: ft.shape for name, ft in features.items()} == {
        "action": (8,),
        "observation.state": (11,),
        "observation.touch": (4,),
        "observation.images.ceiling": (3, 480, 640),
    }


def test_tasks_of_different_arms_take_different_commands():
    from lerobot.envs import make_env_config

    import drake_srg.suite.lerobot  # noqa: F401 (makes the tasks known)
    from drake_srg.common.exceptions import ScenarioError

    for task, size in (("stand_up", 6), ("handover", 16)):
        config = make_env_config("drake_srg", task=task)
        assert config.features["action"].shape == (size,)
    with pytest.raises(ScenarioError, match=r"stand_up has another arm .* than pick_c"):
        make_env_config("drake_srg", task="pick_can,stand_up")


@pytest.mark.parametrize("apart", [False, True])
def test_environments_come_by_suite_and_number(config, apart):
    from lerobot.envs import close_envs, make_env, preprocess_observation

    envs = make_env(config, n_envs=COPIES, use_async_envs=apart)
    assert {name: [*group] for name, group in envs.items()} == {"drake_srg": [0, 1]}
    vector = envs["drake_srg"][1]
    options = {"lerobot_new_rollout": True}
    observation, info = vector.reset(seed=[7, 8], options=options)
    assert info["is_success"].tolist() == [False, False]
    assert vector.call("task") == ("place_can",) * COPIES
    assert len(set(vector.call("task_description"))) == COPIES
    assert vector.call("_max_episode_steps")[0] == 320
    assert vector.unwrapped.metadata["render_fps"] == 16
    assert np.array(vector.call("render")).shape == (COPIES, 270, 480, 3)
    names = {*preprocess_observation(observation)}
    assert names == {
        "observation.state",
        "observation.touch",
        "observation.images.ceiling",
    }
    action = np.zeros((COPIES, 8), np.float32)
    action[1, 0] = np.nan  # ends this copy's episode
    *_, truncated, info = vector.step(action)
    assert truncated.tolist() == [False, True]
    # It waits for the other one: no new episode begins.
    *_, info = vector.step(action)
    assert info["is_success"].tolist() == [False, False]
    assert info["failure"][1].startswith("the action is not finite")
    close_envs(envs)


def test_a_policy_of_lerobots_is_evaluated_by_its_command(tmp_path):
    command = [
        str(Path(sys.executable).with_name("lerobot-eval")),
        "--policy.type=act",
        "--policy.pretrained_backbone_weights=null",
        "--policy.device=cpu",
        "--policy.push_to_hub=false",
        "--env.discover_packages_path=drake_srg.suite.lerobot",
        "--env.type=drake_srg",
        "--env.task=pick_can",
        "--env.episode_length=8",
        "--eval.n_episodes=2",
        "--eval.batch_size=2",
        f"--output_dir={tmp_path}",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    info = json.loads((tmp_path / "eval_info.json").read_text())
    assert info["overall"]["n_episodes"] == 2
    videos = [Path(path) for path in info["overall"]["video_paths"]]
    assert len(videos) == 2
    assert all(video.stat().st_size > 1000 for video in videos)
