import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.baselines import TOUCH, rule_of
from drake_srg.learning.episodes import make_environment
from drake_srg.learning.rules import pick
from drake_srg.learning.touch_rule import pick_by_touch
from drake_srg.learning.train import MakeLearner
from drake_srg.planning.grasps.srg_angles import ends_gap


@pytest.fixture(scope="module")
def env():
    return make_environment("Pick", {"noise": 0.02})


def scene_of(env, seed, error=None):
    scene = env.reset(seed=seed)[1]["scene"]
    if error is not None:
        scene["estimate_error"] = [float(x) for x in error]
    return scene


def is_round(env, seed):
    scene_of(env, seed)
    return env.unwrapped.scene.is_round


def holds(env, rule, scene):
    observation, _ = env.reset(options={"scene": scene})
    ended = False
    while not ended:
        observation, _, terminated, truncated, info = env.step(rule(observation))
        ended = terminated or truncated
    return bool(info["success"])


def pick_where_seen(observation):
    """What the rule does in its first try."""
    return pick(observation, still=0.3, narrower=100.0 * np.pi)


def test_boxes_are_first_tried_where_they_were_seen(env):
    seed = next(k for k in range(100) if not is_round(env, k))
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
    seeds = [k for k in range(80) if is_round(env, k) == round_][:6]

    def act(observation):
        action = pick_by_touch(observation)
        action[4] = np.clip(action[4] + 0.02 * rng.normal(), -1.0, 1.0)
        return action

    scenes = [scene_of(env, seed, (0.0, 0.0)) for seed in seeds]
    assert sum(holds(env, act, scene) for scene in scenes) >= 5


def test_the_hand_comes_down_beside_a_cylinder():
    """Also where it starts on the other side: its way leads over the object."""
    env = make_environment("KitchenPick", {"noise": 0.0})
    scene = scene_of(env, next(k for k in range(100) if is_round(env, k)))
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
    scene = scene_of(env, next(k for k in range(100) if is_round(env, k)), (0.0, 0.2))
    scene["object"]["shape"] |= {"radius": radius, "length": 0.1}
    observation, _ = env.reset(options={"scene": scene})
    for _ in range(21):
        observation, *_ = env.step(pick_by_touch(observation))
    gap = ends_gap(2.0 * observation[10:14].astype(float))
    assert gap == pytest.approx(0.8 * radius, abs=0.002)


def test_fingers_that_have_closed_on_nothing_open_again(env):
    seed = next(k for k in range(100) if not is_round(env, k))
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
    seeds = [k for k in range(80) if is_round(env, k) == round_][:10]
    held = dict.fromkeys((pick, pick_by_touch), 0)
    for seed in seeds:
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
    assert held[pick] <= 3
    assert held[pick_by_touch] >= 7


def test_it_has_a_name(env):
    assert rule_of(env, TOUCH) is pick_by_touch
    other = make_environment("GraspOneShot", {})
    with pytest.raises(ScenarioError, match="has no hand-written rule `touch`"):
        rule_of(other, TOUCH)


@pytest.mark.parametrize(
    ("algorithm", "data", "message"),
    [
        ("q", "", "needs --algo bc or dagger, got q"),
        ("bc", "here", "imitates no --data"),
    ],
)
def test_only_clones_have_a_choice_of_rule(env, algorithm, data, message):
    with pytest.raises(ScenarioError, match=f"--rule touch: {message}"):
        MakeLearner(algorithm, env, 0, data, TOUCH)
