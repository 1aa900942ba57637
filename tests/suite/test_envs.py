"""The requirements of gymnasium and learners on the suite's environments."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.episodes import EVALUATION, VALIDATION, make_environment
from drake_srg.learning.rules import rule_of
from drake_srg.scenario import robot_arms
from drake_srg.station.planners import final_pose
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.suite import SuiteEnv, load_tasks
from drake_srg.suite.envs import VECTOR_ENVS, ProprioceptionEnv, StateEnv

MODULE = "drake_srg.suite.envs"
IMAGES, STATES = "drake_srg/pick_can-v0", "drake_srg/pick_can_proprio-v0"


@pytest.fixture(scope="module")
def env():
    env = ProprioceptionEnv("pick_can", episode_length=4)
    env.reset(seed=1)
    return env


def test_every_task_has_its_names():
    for task, config in load_tasks().items():
        kinds = {task: "env:SuiteEnv", f"{task}_proprio": "envs:ProprioceptionEnv"}
        if config.goal != "clear":
            kinds[f"{task}_state"] = "envs:StateEnv"
        found = {
            name: gymnasium.spec(f"drake_srg/{name}-v0")
            for name in (task, f"{task}_proprio", f"{task}_state")
            if f"drake_srg/{name}-v0" in gymnasium.registry
        }
        entries = {name: spec.entry_point for name, spec in found.items()}
        assert entries == {n: f"drake_srg.suite.{kind}" for n, kind in kinds.items()}
        assert all(spec.kwargs == {"task": task} for spec in found.values())


@pytest.mark.slow
@pytest.mark.parametrize(("name", "mode"), [(IMAGES, "rgb_array"), (STATES, None)])
def test_gymnasiums_own_checks_pass(name, mode):
    env = gymnasium.make(name, episode_length=3, render_mode=mode)
    check_env(env.unwrapped, skip_render_check=mode is None)


def test_a_state_is_what_the_task_measures_between_its_limits(env):
    observation, info = env.reset(seed=1)
    suite = SuiteEnv("pick_can", split="training", cameras=(), render_mode=None)
    measured, _ = suite.reset(seed=1)
    low, high = suite.limits
    back = low + 0.5 * (observation[:11] + 1.0) * (high - low)
    np.testing.assert_allclose(back, measured["agent_pos"], atol=1e-5)
    np.testing.assert_allclose(20.0 * observation[11:], measured["touch"], atol=1e-5)
    assert info["success"] is info["is_success"] is False


@pytest.mark.parametrize("task", ["pick_can", "stand_up", "handover"])
def test_a_state_also_tells_where_the_object_is(task):
    env = StateEnv(task)
    env.reset(seed=1)
    rng = np.random.default_rng(0)
    for _ in range(3):
        action = rng.uniform(-1.0, 1.0, env.action_space.shape)
        observation, *_ = env.step(action)
    assert env.observation_space.contains(observation)
    episode, hands = env.suite.episode, env.suite.hands
    own = len(env.suite.limits[0]) + env.suite.observation_space["touch"].shape[0]
    seen = observation[own:]
    scenario = episode.scenario
    plant = MakeModelsPlant(scenario)
    context = plant.CreateDefaultContext()
    for robot in robot_arms(scenario):
        arm = plant.GetModelInstanceByName(robot.arm_model)
        q = episode.measured(f"{robot.arm_model}.state_cheat")
        plant.SetPositions(context, arm, q[: plant.num_positions(arm)])
    X_WO = episode.measured("object_poses_cheat")[scenario.task.pick]
    for hand, known in zip(hands, seen[:-3].reshape(-1, 9), strict=True):
        model = plant.GetModelInstanceByName(hand)
        X_WP = plant.GetFrameByName("palm", model).CalcPoseInWorld(context)
        X_PO = X_WP.inverse() @ X_WO
        near = np.clip(2.0 * X_PO.translation(), -1.0, 1.0)
        np.testing.assert_allclose(known[:3], near, atol=1e-5)
        for axis, i in ((known[3:6], 0), (known[6:], 2)):
            np.testing.assert_allclose(axis, X_PO.rotation().col(i), atol=1e-5)
    p_OG_W = final_pose(scenario, X_WO).translation() - X_WO.translation()
    np.testing.assert_allclose(seen[-3:], np.clip(2.0 * p_OG_W, -1, 1), atol=1e-5)


def test_a_task_without_an_object_to_pick_has_no_state():
    with pytest.raises(ScenarioError, match="task: into_bin has no object of its own"):
        StateEnv("into_bin")


@pytest.mark.usefixtures("no_start")
def test_noise_disturbs_a_fifth_of_the_steps_of_training():
    env = ProprioceptionEnv("pick_can", noise=0.1)
    for seed in (VALIDATION, EVALUATION):
        env.reset(seed=seed)
        assert [env._kick() for _ in range(100)] == [0.0] * 100
    env.reset(seed=1)
    kicks = np.array([env._kick() * np.ones(8) for _ in range(2000)])
    disturbed = kicks[np.any(kicks != 0.0, axis=1)]
    assert len(disturbed) / len(kicks) == pytest.approx(0.2, abs=0.04)
    assert np.std(disturbed) == pytest.approx(0.1, rel=0.1)


def test_noise_moves_the_joints_and_no_closure(env, monkeypatch):
    env.reset(seed=1)
    start = env.suite.episode.command
    monkeypatch.setattr(env, "_kick", lambda: np.full(8, 0.1))
    env.step(np.zeros(8, np.float32))
    expected = start + 0.1 * env.suite.motion
    expected[7] = 0.5
    np.testing.assert_allclose(env.suite.episode.command, expected, atol=1e-6)


@pytest.mark.parametrize("noise", [-0.1, np.nan, np.inf, "0.2"])
def test_noise_is_a_finite_share(noise):
    with pytest.raises(ScenarioError, match="noise: must be 0 or more, and finite"):
        ProprioceptionEnv("pick_can", noise=noise)


def test_actions_are_shares_of_the_fastest_motion(env):
    env.reset(seed=1)
    start = env.suite.episode.command[:-1]
    env.step(np.array([0.5, -1.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0], np.float32))
    moved = env.suite.episode.command[:-1] - start
    share = np.array([0.5, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    np.testing.assert_allclose(moved, share * env.suite.motion[:-1], atol=1e-6)
    with pytest.raises(ValueError, match=r"action: must have shape \(8,\)"):
        env.step(np.zeros(5))


@pytest.mark.parametrize("kind", VECTOR_ENVS.values())
def test_an_episode_that_cannot_go_on_is_truncated(kind):
    env = kind("pick_can")
    env.reset(seed=1)
    observation, _, _, truncated, info = env.step(np.full(8, np.nan))
    assert truncated
    assert "the action is not finite" in info["failure"]
    assert env.observation_space.contains(observation)


def test_of_two_arms_every_closure_is_no_share_of_a_motion():
    env = ProprioceptionEnv("handover")
    env.reset(seed=1)
    start = env.suite.episode.command
    action = np.full(16, 0.5, np.float32)
    env.step(action)
    expected = start + action * env.suite.motion
    expected[[7, 15]] = 0.75
    np.testing.assert_allclose(env.suite.episode.command, expected, atol=1e-6)


@pytest.fixture
def no_start(monkeypatch):
    """Let no episode begin: nothing is simulated."""
    from drake_srg.suite import env as module

    def fail(*_):
        raise module.EpisodeError("no start")

    monkeypatch.setattr(module, "Episode", fail)


@pytest.mark.usefixtures("no_start")
def test_the_seed_says_the_split():
    env = ProprioceptionEnv("pick_can")
    for seed, split, number in (
        (7, "training", 7),
        (VALIDATION + 1, "training", VALIDATION + 1),
        (EVALUATION + 3, "evaluation", 3),
        (EVALUATION + 203, "evaluation", 3),
        (None, "training", None),
    ):
        env.reset(seed=seed)
        assert env.suite.split == split
        assert number in (None, env.suite._number)


@pytest.mark.usefixtures("no_start")
@pytest.mark.parametrize("kind", VECTOR_ENVS.values())
def test_an_episode_that_cannot_begin_is_truncated_by_its_first_step(kind):
    env = kind("pick_can", expert=True)
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    *_, truncated, info = env.step(env.rule(observation))
    assert (truncated, info["failure"], info["success"]) == (True, "no start", False)


@pytest.mark.slow
def test_the_expert_is_the_rule_of_the_present_moment():
    name = f"{MODULE}:{STATES}"
    env = make_environment(name, {"expert": True, "episode_length": 12})
    rule = rule_of(env)
    first, _ = env.reset(seed=5)
    observation = first
    for _ in range(8):
        proposed = env.unwrapped.suite.expert_action()
        observation, *_ = env.step(rule(observation))
        done = env.unwrapped.suite.episode.command[:-1]
        np.testing.assert_allclose(done, proposed[:-1], atol=1e-5)
    assert np.abs(observation - first).max() > 0.01
    with pytest.raises(ScenarioError, match="answers only at the present moment"):
        rule(first)


def test_without_the_expert_there_is_no_rule(env):
    observation, _ = env.reset(seed=1)
    with pytest.raises(ScenarioError, match="expert: must be True"):
        env.rule(observation)


@pytest.mark.learn
@pytest.mark.parametrize(
    ("kind", "keywords"),
    [("MultiInputPolicy", {"task": "pick_can", "cameras": ()}), ("MlpPolicy", None)],
)
def test_stable_baselines3_learns_and_evaluates(kind, keywords):
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_checker import check_env as check
    from stable_baselines3.common.evaluation import evaluate_policy
    from stable_baselines3.common.monitor import Monitor

    name = STATES if keywords is None else IMAGES
    env = gymnasium.make(name, episode_length=3, **(keywords or {}))
    check(env)
    model = PPO(kind, env, n_steps=4, batch_size=4, n_epochs=1, seed=0, device="cpu")
    before = model.policy.state_dict()["action_net.weight"].clone()
    model.learn(8)
    assert model.num_timesteps == 8
    assert not before.equal(model.policy.state_dict()["action_net.weight"])
    rewards, lengths = evaluate_policy(
        model, Monitor(env), n_eval_episodes=2, return_episode_rewards=True
    )
    assert (rewards, lengths) == ([0.0, 0.0], [3, 3])


@pytest.mark.learn
def test_observations_become_tensors():
    import torch

    # Its wrapper of vectors converts no booleans of info, since DLPack knows none.
    env = gymnasium.wrappers.NumpyToTorch(
        gymnasium.make(IMAGES, episode_length=1, render_mode=None)
    )
    observation, info = env.reset(seed=0)
    assert (observation["agent_pos"].dtype, len(info)) == (torch.float32, 2)
    assert observation["pixels"]["ceiling"].dtype == torch.uint8
    _, reward, terminated, truncated, _ = env.step(torch.zeros(8))
    assert (reward, terminated, truncated) == (0.0, False, True)
    env.close()


@pytest.mark.learn
def test_gymnasium_records_a_video(tmp_path):
    import cv2

    env = gymnasium.wrappers.RecordVideo(
        gymnasium.make(STATES, episode_length=4, render_mode="rgb_array"),
        str(tmp_path / "videos"),
        disable_logger=True,
    )
    env.reset(seed=0)
    for _ in range(4):
        env.step(np.zeros(8, np.float32))
    env.close()
    (file,) = tmp_path.rglob("*.mp4")
    video = cv2.VideoCapture(str(file))
    assert video.get(cv2.CAP_PROP_FPS) == 16.0
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 5
    assert video.read()[1].shape == (270, 480, 3)
