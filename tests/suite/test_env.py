"""The suite's environment; what LeRobot asks of one is in drake_srg/suite/lerobot."""

import functools

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv

from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import load_scenario, robot_arms
from drake_srg.suite import SuiteEnv
from drake_srg.suite.episode import reading_times, with_cameras

SEEDS = [3, 4]
STEPS = 6


@pytest.fixture(scope="module")
def env():
    """A task without cameras, which an episode begins in."""
    env = SuiteEnv("pick_can", split="training", cameras=(), render_mode=None)
    env.reset(seed=1)
    return env


@functools.cache
def actions(copies):
    """Motions of all joints and of the hand, (steps, copies, 8)."""
    home = np.array([0.0, -0.3, 0.0, -1.9, 0.0, 1.5, 0.0, 0.0])
    share = np.linspace(0.0, 1.0, STEPS)[:, None, None]
    goals = np.random.default_rng(0).uniform(-0.2, 0.2, (copies, 8))
    return (home + share * goals).astype(np.float32)


def flat(observation, copy=None):
    """The bytes of an observation, or of a copy's part of a vector's."""
    parts = dict(observation)
    parts |= {f"pixels/{k}": v for k, v in parts.pop("pixels", {}).items()}
    return {
        key: np.ascontiguousarray(v if copy is None else v[copy]).tobytes()
        for key, v in parts.items()
    }


def played(vector):
    """All observations and rewards of a few steps of a vector environment."""
    seen = [vector.reset(seed=SEEDS)[0]]
    rewards = []
    for step in actions(len(SEEDS)):
        observation, reward, *_ = vector.step(step)
        seen.append(observation)
        rewards.append(reward.tolist())
    vector.close()
    frames = [[flat(o, copy) for o in seen] for copy in range(len(SEEDS))]
    return frames, rewards


@pytest.mark.slow
def test_single_sync_and_async_are_equal_byte_for_byte():
    # By name, as the workers of a vector environment make them. The episodes end one
    # step before the last, which begins others.
    name = "drake_srg.suite.envs:drake_srg/pick_can-v0"
    settings = {"render_mode": None, "episode_length": STEPS - 1}
    make = functools.partial(gymnasium.make, name, **settings)
    options = {"autoreset_mode": AutoresetMode.NEXT_STEP}
    sync = played(SyncVectorEnv([make] * 2, **options))
    apart = played(AsyncVectorEnv([make] * 2, context="forkserver", **options))
    assert sync == apart
    single, env = [], make()
    # The second copy's episode first: none depends on those before it.
    for copy in (1, 0):
        seen = [env.reset(seed=SEEDS[copy])[0]]
        seen += [env.step(step[copy])[0] for step in actions(2)[:-1]]
        seen.append(env.reset()[0])
        single.insert(0, [flat(observation) for observation in seen])
    env.close()
    assert single == sync[0]
    assert single[0] != single[1]
    # Equal bytes say nothing if nothing moves.
    for first, *_, last, _ in single:
        for part in ("agent_pos", "pixels/ceiling"):
            assert first[part] != last[part]


def test_reset_and_step_tell_the_success(env):
    observation, info = env.reset(seed=1, options={"lerobot_new_rollout": True})
    assert info == {"is_success": False, "failure": ""}
    assert env.observation_space.contains(observation)
    observation, reward, terminated, truncated, info = env.step(actions(1)[0][0])
    assert (reward, terminated, truncated) == (0.0, False, False)
    assert info == {"is_success": False, "failure": ""}
    assert env.observation_space.contains(observation)


def test_the_attributes_that_lerobot_asks_for(env, monkeypatch):
    assert env.task == "pick_can"
    assert env._max_episode_steps == 320
    assert env.metadata["render_fps"] == 16
    told = set()
    for number in range(3):
        monkeypatch.setattr(env, "_number", number)
        told.add(env.task_description)
    assert told == set(env.config.wordings)


def test_joints_follow_the_commands_no_faster_than_they_can(env):
    env.reset(seed=1)
    start = env.episode.command[:-1]
    far = np.append(env.action_space.high[:-1], 1.0)
    env.step(far)
    moved = env.episode.command[:-1] - start
    # KUKA's data sheet of the iiwa 14: 85, 85, 100, 75, 130, 135, 135 degrees/s.
    fastest = np.deg2rad([85, 85, 100, 75, 130, 135, 135]) / 16
    assert np.all(moved <= fastest + 1e-9)
    for _ in range(4):
        observation, *_ = env.step(actions(1)[0][0])
    np.testing.assert_allclose(
        observation["agent_pos"][:7], actions(1)[0][0][:7], atol=0.05
    )


def test_of_two_arms_each_follows_its_own_part_of_the_action():
    env = SuiteEnv("handover", split="training", cameras=(), render_mode=None)
    before, _ = env.reset(seed=1)
    assert env.observation_space.contains(before)
    assert env.action_space.shape == env.motion.shape == (16,)
    assert (before["agent_pos"].shape, before["touch"].shape) == ((22,), (8,))
    action = env.episode.command.copy()
    action[[1, 15]] += [0.1, 1.0]  # a joint of the left arm, and the right hand
    for _ in range(8):
        after, *_ = env.step(action)
    moved = after["agent_pos"] - before["agent_pos"]
    assert moved[1] == pytest.approx(0.1, abs=0.01)
    assert np.abs(moved[18:20]).min() > 0.2  # the base joints
    still = np.abs(np.delete(moved, [1, *range(18, 22)]))
    assert still.max() < 0.01


@pytest.mark.parametrize("period", [0.005, 0.002, 1 / 64, 12 / 1024])
def test_the_command_moves_between_all_readings_of_the_driver(period):
    times = np.concatenate([reading_times(tick, [period]) for tick in range(320)])
    np.testing.assert_array_equal(times, period * np.arange(len(times)))
    assert times[-1] < 20.0 <= times[-1] + period
    for tick in range(320):
        own = reading_times(tick, [period])
        assert np.all((own > tick / 16 - 1e-9) & (own < (tick + 1) / 16 - 1e-9))


def test_the_command_moves_between_the_readings_of_all_drivers():
    both = reading_times(3, [0.005, 1 / 64])
    each = {*reading_times(3, [0.005]), *reading_times(3, [1 / 64])}
    assert both.tolist() == sorted(each)


def test_an_action_that_is_not_finite_truncates_with_the_reason(env):
    env.reset(seed=1)
    *_, reward, terminated, truncated, info = env.step(np.full(8, np.nan))
    assert (reward, terminated, truncated) == (0.0, False, True)
    assert info["is_success"] is False
    assert "the action is not finite" in info["failure"]
    _, info = env.reset(seed=1)
    assert info["failure"] == ""


def test_an_episode_that_drake_gives_up_truncates_with_the_reason(env, monkeypatch):
    env.reset(seed=1)

    def abort(_):
        raise RuntimeError("The discrete solver failed\nto converge")

    monkeypatch.setattr(env.episode, "_advance", abort)
    observation, _, terminated, truncated, info = env.step(actions(1)[0][0])
    assert (terminated, truncated) == (False, True)
    assert info["failure"].startswith("The discrete solver failed")
    assert "\n" not in info["failure"]
    assert env.observation_space.contains(observation)


def test_an_episode_that_cannot_begin_is_truncated_by_its_first_step(monkeypatch):
    from drake_srg.suite import env as module

    def fail(*_):
        raise module.EpisodeError("no start")

    env = SuiteEnv("pick_can", cameras=(), render_mode=None)
    monkeypatch.setattr(module, "Episode", fail)
    observation, info = env.reset(seed=0)
    assert info == {"is_success": False, "failure": "no start"}
    assert env.observation_space.contains(observation)
    *_, terminated, truncated, info = env.step(actions(1)[0][0])
    assert (terminated, truncated, info["failure"]) == (False, True, "no start")


def test_the_longest_episode_is_truncated_without_a_reason():
    env = SuiteEnv("pick_can", cameras=(), render_mode=None, episode_length=2)
    env.reset(seed=1)
    ends = [env.step(action[0])[2:4] for action in actions(1)[:2]]
    assert ends == [(False, False), (False, True)]


def test_an_object_off_the_table_ends_the_episode_without_success(env):
    env.reset(seed=1)
    poses = env.episode._poses[-1]
    assert not env.episode.lost()
    poses["soup_can"][2] = -0.5
    assert env.episode.lost()
    assert not env.episode.succeeds()


# In `pick_by_touch`, the object is far away. With the rule's default gain, the hand
# oscillated by 6 cm beside it until the time was up.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("task", "seed"),
    [("pick_can", 5), ("place_can", 5), ("pick_by_touch", 125), ("handover", 5)],
)
def test_the_expert_solves_a_task(task, seed):
    env = SuiteEnv(task, split="training", cameras=(), render_mode=None, expert=True)
    env.reset(seed=seed)
    ended, touching = False, set()
    while not ended:
        action = env.expert_action()
        assert env.action_space.contains(action)
        _, reward, terminated, truncated, info = env.step(action)
        touching |= env.episode._touching
        ended = terminated or truncated
    # All hands have held the object.
    assert touching >= {arm.gripper_model for arm in robot_arms(env.episode.scenario)}
    assert info == {"is_success": True, "failure": ""}
    assert (reward, terminated) == (1.0, True)


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"task": "pick_cn"}, "task: unknown 'pick_cn'"),
        ({"split": "test"}, "split: unknown 'test'"),
        ({"cameras": ["ceilin"]}, "cameras: unknown 'ceilin'"),
        ({"render_mode": "human"}, "render_mode: unknown 'human'"),
        ({"episode_length": 0}, "episode_length: must be at least 1, got 0"),
    ],
)
def test_wrong_keywords_are_one_line(keywords, message):
    with pytest.raises(ScenarioError, match=message) as raised:
        SuiteEnv(**({"task": "pick_can"} | keywords))
    assert "\n" not in str(raised.value)


def test_calls_out_of_order_are_named(env):
    with pytest.raises(ScenarioError, match="expert: must be True"):
        env.expert_action()
    new = SuiteEnv("pick_can", cameras=(), render_mode=None)
    with pytest.raises(gymnasium.error.ResetNeeded):
        new.step(actions(1)[0][0])
    assert new.render() is None
    with pytest.raises(ValueError, match=r"action: must have shape \(8,\)"):
        env.step(np.zeros(5))


@pytest.mark.slow
def test_an_episode_is_freed_when_another_begins_or_the_environment_closes(leaked):
    env = SuiteEnv("pick_can", cameras=(), render_mode=None, expert=True)
    env.reset(seed=0)
    env.step(env.expert_action())
    alive = leaked()
    assert "PickAndPlacePlanner" in alive
    env.reset(seed=0)
    assert leaked() == alive
    env.close()
    assert leaked() == []


@pytest.mark.parametrize(
    ("scenario", "kept"),
    [("kitchen_varied", {"ceiling"}), ("kitchen_servoing", {"ceiling", "hand"})],
)
def test_the_planner_keeps_the_cameras_by_which_it_sees(scenario, kept):
    assert with_cameras(load_scenario(scenario), ()).cameras.keys() == kept
