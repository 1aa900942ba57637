import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.envs.tasks import PickEnv
from drake_srg.learning.episodes import make_environment, run_episode, training_seed
from drake_srg.learning.rules import (
    RULES,
    TOUCH,
    grasp_height,
    grasp_one_shot,
    pick,
    pick_by_touch,
    rule_of,
)
from drake_srg.learning.train import MakeLearner
from drake_srg.planning.grasps.srg_hand import ends_gap


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


@given(st.floats(0.05, 1.0))
def test_a_gain_is_the_share_of_an_error_that_is_corrected(gain):
    x = np.zeros(len(PickEnv.observation_names), np.float32)
    x[[0, 3, 5, 6, 7, 8, 22]] = 0.08, 1.0, 0.85, 0.3, 0.3, 0.5, -1.0  # 16 mm away
    assert pick(x, gain=gain)[0] == pytest.approx(gain * 0.016 / 0.02)


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


@pytest.fixture(scope="module")
def env():
    return make_environment("Pick", {"noise": 0.02})


def scene_of(env, seed, error=None):
    scene = env.reset(seed=seed)[1]["scene"]
    if error is not None:
        scene["estimate_error"] = [float(x) for x in error]
    return scene


def seeds_of(env, round_, count):
    """The first seeds of cylinders, or of boxes."""

    def fits(seed):
        scene_of(env, seed)
        return env.unwrapped.scene.is_round == round_

    return list(itertools.islice(filter(fits, itertools.count()), count))


def holds(env, rule, scene):
    observation, _ = env.reset(options={"scene": scene})
    ended = False
    while not ended:
        observation, _, terminated, truncated, info = env.step(rule(observation))
        ended = terminated or truncated
    return bool(info["success"])


def pick_where_seen(observation):
    """Return the rule's actions in its first try."""
    return pick(observation, still=0.3, narrower=100.0 * np.pi)


def test_boxes_are_first_tried_where_they_were_seen(env):
    (seed,) = seeds_of(env, False, 1)
    scene = scene_of(env, seed, (0.0, 0.0))
    observations = []

    def act(observation):
        observations.append(observation)
        return pick_where_seen(observation)

    assert holds(env, act, scene)
    for observation in observations:
        expected = pick_where_seen(observation)
        np.testing.assert_array_equal(pick_by_touch(observation), expected)


@pytest.mark.parametrize("round_", [True, False])
def test_an_uneven_closure_does_not_keep_it_from_lifting(env, round_):
    """As networks command it: tips that rest bend at each change."""
    rng = np.random.default_rng(1)

    def act(observation):
        action = pick_by_touch(observation)
        action[4] = np.clip(action[4] + 0.02 * rng.normal(), -1.0, 1.0)
        return action

    seeds = seeds_of(env, round_, 4)
    scenes = [scene_of(env, seed, (0.0, 0.0)) for seed in seeds]
    assert sum(holds(env, act, scene) for scene in scenes) >= 3


def test_the_hand_comes_down_beside_a_cylinder():
    """Also where it starts on the other side: its way leads over the object."""
    env = make_environment("KitchenPick", {"noise": 0.0})
    scene = scene_of(env, *seeds_of(env, True, 1))
    start = env.unwrapped.workspace.start
    scene["object"] |= {
        "position": [float(start[0] - 0.09), float(start[1] - 0.15)],
        "shape": {"_tag": "!Cylinder", "radius": 0.034, "length": 0.1},
    }
    observation, _ = env.reset(options={"scene": scene})
    began = env.unwrapped.station.X_WO().translation()
    while observation[5] > 0.3:  # 6 cm above the table
        observation, *_ = env.step(pick_by_touch(observation))
    moved = env.unwrapped.station.X_WO().translation() - began
    assert np.abs(moved[:2]).max() < 1e-3


@pytest.mark.parametrize("radius", [0.016, 0.025, 0.034])
def test_a_cylinder_is_pushed_between_the_ends_of_the_pads(env, radius):
    """They are closer together than it is wide, and keep it in their middle."""
    scene = scene_of(env, *seeds_of(env, True, 1), (0.0, 0.2))
    scene["object"]["shape"] |= {"radius": radius, "length": 0.1}
    observation, _ = env.reset(options={"scene": scene})
    for _ in range(21):
        observation, *_ = env.step(pick_by_touch(observation))
    gap = ends_gap(2.0 * observation[10:14].astype(float))
    assert gap == pytest.approx(0.8 * radius, abs=0.002)


def test_fingers_that_have_closed_on_nothing_open_again(env):
    (seed,) = seeds_of(env, False, 1)
    scene_of(env, seed)
    inwards = np.sign(
        env.unwrapped.workspace.start[0] - env.unwrapped.scene.position[0]
    )
    scene = scene_of(env, seed, (0.1 * inwards, 0.0))
    opened = []

    def act(observation):
        action = pick_by_touch(observation)
        if observation[22] > 0.0 and action[4] < 0.0:
            opened.append(observation)
            assert action[2] > 0.0
        return action

    assert not holds(env, act, scene)
    assert len(opened) >= 2


@pytest.mark.slow
@pytest.mark.parametrize("round_", [True, False])
def test_it_holds_what_is_far_from_where_it_was_seen(env, round_):
    """Seen to one side, across the closing direction."""
    held = dict.fromkeys((pick, pick_by_touch), 0)
    for seed in seeds_of(env, round_, 6):
        scene_of(env, seed)
        size_x, size_y, _ = env.unwrapped.scene.shape.bounding_size
        yaw = env.unwrapped.scene.object.yaw
        turn = (yaw + 0.25 * np.pi) % (0.5 * np.pi) - 0.25 * np.pi  # of the hand
        if round_:
            away, turn = 0.025, 0.0
        else:  # pads of 31 mm pass 5 mm beside it
            along = size_x if abs(np.cos(yaw - turn)) > 0.5 else size_y
            away = 0.5 * along + 0.0205
        error = away * np.array([np.cos(turn), np.sin(turn)])
        for rule in held:
            held[rule] += holds(env, rule, scene_of(env, seed, error))
    assert held[pick] <= 2
    assert held[pick_by_touch] >= 4


def test_it_has_a_name(env):
    assert rule_of(env, TOUCH) is pick_by_touch
    other = make_environment("GraspOneShot", {})
    with pytest.raises(ScenarioError, match="has no hand-written rule `touch`"):
        rule_of(other, TOUCH)


@pytest.mark.parametrize(
    ("algorithm", "data", "message"),
    [
        ("q", "", "needs --algo bc or dagger, got q"),
        ("bc", "here", "cannot be combined with --data"),
    ],
)
def test_only_clones_have_a_choice_of_rule(env, algorithm, data, message):
    with pytest.raises(ScenarioError, match=f"--rule touch: {message}"):
        MakeLearner(algorithm, env, 0, data, TOUCH)
