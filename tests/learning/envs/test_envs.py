"""The requirements of gymnasium and its users on every environment."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RecordVideo

from drake_srg.learning.envs import ENVIRONMENTS
from drake_srg.learning.envs.episode_station import SimulationError
from drake_srg.learning.envs.scenes import SceneSource
from drake_srg.scenario.load import load_tree
from drake_srg.types import Box
from learning.envs.playing import Rule, one_shot, play

NAMES = sorted(ENVIRONMENTS)
CAN = "{model: package://drake_srg/sdf/005_tomato_soup_can.sdf}"


def same(first, second):
    """Whether two lists of arrays are equal bit for bit."""
    return len(first) == len(second) and all(
        np.array_equal(a, b) for a, b in zip(first, second, strict=True)
    )


@pytest.mark.parametrize("name", NAMES)
def test_gymnasiums_own_checks_pass(envs, name):
    check_env(envs(name), skip_render_check=True)


@pytest.mark.parametrize("name", NAMES)
def test_everything_has_a_name(envs, name):
    env = envs(name)
    assert env.observation_space.shape == (len(env.observation_names),)
    assert env.action_space.shape == (len(env.action_names),)
    assert env.observation_space.dtype == env.action_space.dtype == np.float32
    assert np.isfinite(env.observation_space.low).all()


@pytest.mark.parametrize("name", ["Pick-v0", "KitchenPickPlace-v0"])
def test_observations_stay_within_bounds_whatever_is_done(envs, name):
    env = envs(name)
    env.action_space.seed(1)
    env.reset(seed=1)
    for _ in range(25):
        observation, reward, terminated, truncated, _ = env.step(
            env.action_space.sample()
        )
        assert env.observation_space.contains(observation)
        assert np.isfinite(reward)
        if terminated or truncated:
            env.reset()


@pytest.mark.parametrize("name", ["Pick-v0", "KitchenPick-v0"])
def test_a_rule_picks_objects(envs, name):
    infos = [play(envs(name), seed=seed)[0] for seed in range(2)]
    assert [info["success"] for info in infos] == [True, True]


def test_a_rule_grasps_at_once(envs):
    env = envs("GraspOneShot-v0")
    env.reset(seed=0)
    _, reward, terminated, _, info = env.step(one_shot(env))
    assert info["success"]
    assert terminated
    assert reward > 1.0


def test_an_episode_does_not_depend_on_those_before_it(pick):
    fresh = gymnasium.make("drake_srg/Pick-v0").unwrapped
    _, first = play(fresh, seed=3)
    play(fresh, seed=4)
    _, again = play(fresh, seed=3)
    assert same(first, again)
    play(pick, seed=5)
    assert same(first, play(pick, seed=3)[1])


def test_nothing_is_felt_of_the_episode_before():
    """A discrete plant keeps the contacts of its last step."""
    env = gymnasium.make("drake_srg/Pick-v0", physics="fast").unwrapped
    first, _ = env.reset(seed=3)
    rule, felt = Rule(env), 0.0
    while felt == 0.0:  # until the fingers touch the object
        env.step(rule.action())
        felt = env.station.measured("gripper.contact_force").max()
    assert same([first], [env.reset(seed=3)[0]])


def test_a_scene_is_replayed(pick):
    info, first = play(pick, seed=6)
    assert same(first, play(pick, options={"scene": info["scene"]})[1])


def test_scenes_differ_from_seed_to_seed(pick):
    scenes = [pick.reset(seed=seed)[1]["scene"] for seed in range(4)]
    assert len({repr(scene) for scene in scenes}) == len(scenes)


def test_ground_truth_is_not_observed(pick):
    """The same estimate of another place: the first observation is the same."""
    _, info = pick.reset(seed=0)
    scene = info["scene"]
    first, _ = pick.reset(options={"scene": scene})
    (x, y), (dx, dy) = scene["object"]["position"], scene["estimate_error"]
    scene["object"] |= {"position": [x + 0.01, y], "mass": 0.3, "friction": 0.9}
    scene["estimate_error"] = [dx - 0.01, dy]
    second, _ = pick.reset(options={"scene": scene})
    assert np.allclose(first, second, atol=1e-6)


def test_a_step_that_fails_in_the_simulator_truncates(pick, monkeypatch):
    def fail(*_):
        raise SimulationError("no convergence")

    pick.reset(seed=0)
    monkeypatch.setattr(pick.station, "advance", fail)
    observation, reward, terminated, truncated, info = pick.step(np.zeros(5))
    assert pick.observation_space.contains(observation)
    assert (reward, terminated, truncated) == (0.0, False, True)
    assert info["failure"] == "no convergence"
    assert not info["success"]


@pytest.mark.parametrize("name", NAMES)
def test_an_action_that_is_not_finite_truncates(envs, name):
    env = envs(name)
    env.reset(seed=0)
    action = np.full(env.action_space.shape, np.nan)
    observation, _, terminated, truncated, info = env.step(action)
    assert env.observation_space.contains(observation)
    assert (terminated, truncated) == (False, True)
    assert info["failure"].startswith("the action is not finite: [nan")


def test_a_grasp_out_of_the_arms_reach_truncates(envs, monkeypatch):
    env = envs("GraspOneShot-v0")
    env.reset(seed=0)
    far = np.array([9.0, 0.0, 0.0, 0.0])
    monkeypatch.setattr(type(env), "estimate", far)
    monkeypatch.setattr(env.mover, "follow", lambda q, pose: q)
    *_, truncated, info = env.step(np.zeros(6))
    assert truncated
    assert "the hand does not reach [9.0, 0.0" in info["failure"]


def test_a_grasp_may_turn_past_half_a_turn():
    """The yaw of the hand and that of the grasp differed by a whole turn."""
    env = gymnasium.make(
        "drake_srg/GraspOneShot-v0",
        scenario="learn_kitchen",
        overrides=["clutter.kinds.box.yaw=2.9"],
    ).unwrapped
    turned = np.array([0.0, 0.0, 0.0, 2.0 * np.pi - 2.9])
    q = env.joints_at(env.workspace.start + turned)
    assert env.mover.pose(q)[3] == pytest.approx(-2.9, abs=1e-3)


def test_what_a_list_holds_is_drawn_anew():
    size = "[!Uniform {min: 0.03, max: 0.06}, 0.05, 0.08]"
    tree = load_tree("learn_bench", [f"clutter.kinds.box.shape={{size: {size}}}"])
    source = SceneSource(tree, "learn_bench", 0.0)
    drawn = [source.draw(np.random.default_rng(seed)).shape for seed in range(8)]
    sizes = [shape.size for shape in drawn if isinstance(shape, Box)]
    assert len({first for first, *_ in sizes}) == len(sizes) > 1
    assert {tuple(rest) for _, *rest in sizes} == {(0.05, 0.08)}


def test_a_model_has_its_own_friction_again():
    """Regression: the friction of the previous scene stayed."""
    env = gymnasium.make(
        "drake_srg/Pick-v0",
        overrides=["clutter=null", f"objects.can={CAN}", "task.pick=can"],
    ).unwrapped

    def friction(**changes):
        thing = {"model": model, "position": [0.5, 0.0], **changes}
        env.reset(options={"scene": {"object": thing}})
        graph = env.station.station.GetSubsystemByName("scene_graph")
        query = graph.get_query_output_port().Eval(
            graph.GetMyContextFromRoot(env.station.context)
        )
        geometry = env.station.plant.GetCollisionGeometriesForBody(env.station._object)
        properties = query.inspector().GetProximityProperties(geometry[0])
        return properties.GetProperty("material", "coulomb_friction").static_friction()

    model = env.reset(seed=0)[1]["scene"]["object"]["model"]
    own = friction()
    assert friction(friction=0.1) == 0.1
    assert friction() == own != 0.1


def test_a_lost_object_ends_the_episode(pick):
    pick.reset(seed=0)
    plant, context = pick.station.plant, pick.station.plant_context
    velocities = plant.GetVelocities(context).copy()
    velocities[-3:] = [0.0, 2.0, 2.0]
    plant.SetVelocities(context, velocities)
    *_, terminated, truncated, info = pick.step(np.zeros(5))
    assert (terminated, truncated, info["success"]) == (True, False, False)


def test_a_reward_of_your_own(pick):
    env = gymnasium.make(
        "drake_srg/GraspOneShot-v0", reward=lambda before, after: after.reach
    ).unwrapped
    env.reset(seed=0)
    _, reward, *_ = env.step(np.array([1.0, 0.0, 1.0, 0.0, -1.0, -1.0]))
    assert reward == env.truth().reach > 0.0


@pytest.mark.slow
def test_workers_of_a_vector_see_what_one_process_sees():
    seen = []
    for mode, options in (("sync", {}), ("async", {"context": "spawn"})):
        envs = gymnasium.make_vec(
            "drake_srg.learning.envs:drake_srg/Pick-v0",
            num_envs=2,
            vectorization_mode=mode,
            vector_kwargs=options,
        )
        envs.action_space.seed(0)
        rows = [envs.reset(seed=0)[0]]
        rows += [envs.step(envs.action_space.sample())[0] for _ in range(3)]
        envs.close()
        seen.append(rows)
    assert same(*seen)


@pytest.mark.learn
def test_stable_baselines3_learns_and_evaluates():
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_checker import check_env as check
    from stable_baselines3.common.evaluation import evaluate_policy
    from stable_baselines3.common.monitor import Monitor

    env = Monitor(gymnasium.make("drake_srg/Pick-v0"))
    check(env)
    model = PPO("MlpPolicy", env, n_steps=64, batch_size=32, seed=0, device="cpu")
    before = model.policy.state_dict()["action_net.weight"].clone()
    model.learn(128)
    assert not before.equal(model.policy.state_dict()["action_net.weight"])
    _, lengths = evaluate_policy(
        model, env, n_eval_episodes=2, return_episode_rewards=True
    )
    assert all(1 <= length <= 100 for length in lengths)


@pytest.mark.learn
def test_gymnasium_records_a_video(tmp_path):
    import cv2

    env = gymnasium.make("drake_srg/GraspOneShot-v0", render_mode="rgb_array")
    env = RecordVideo(env, str(tmp_path / "videos"), disable_logger=True)
    env.reset(seed=0)
    env.step(np.zeros(6, np.float32))
    env.close()
    (file,) = tmp_path.rglob("*.mp4")
    video = cv2.VideoCapture(str(file))
    assert video.get(cv2.CAP_PROP_FPS) == env.metadata["render_fps"]
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 2
