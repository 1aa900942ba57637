import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.demonstrations import grasp_in, read_demonstrations
from drake_srg.learning.envs.tasks import action_of, grasp_of, one_shot_state
from drake_srg.learning.episodes import make_environment
from drake_srg.learning.train import MakeLearner
from drake_srg.types import Box, Cylinder

from .hand_planners import Straight
from .toy import Toy

BOX = Box([0.04, 0.06, 0.1])
SEEN = [0.5, 0.02, 0.05, 0.0, 0.0, np.sin(0.15), np.cos(0.15), 1.0]  # yaw 0.3
ESTIMATE = np.array([0.5, 0.02, 0.05, 0.3])
SIGHTING = "observation.environment_state"


class Tilted(Straight):
    """An arm whose hand leans."""

    def follow(self, q, pose):
        return pose + 0.1


@given(arrays(float, 6, elements=st.floats(-0.85, 1.0)))
def test_a_grasp_stands_for_the_action_that_stands_for_it(action):
    grasp = grasp_of(action, ESTIMATE, 0.1)
    again = action_of(grasp.at, grasp.preshape, grasp.closure, ESTIMATE, 0.1)
    np.testing.assert_allclose(again, action, atol=1e-6)


@given(st.floats(-np.pi, np.pi))
def test_half_a_turn_is_the_same_grasp(yaw):
    at = np.array([0.5, 0.0, 0.05, yaw])
    turned = at + np.array([0.0, 0.0, 0.0, np.pi])
    first, second = (action_of(p, 0.2, 0.5, np.zeros(4), 0.0) for p in (at, turned))
    np.testing.assert_allclose(first, second, atol=1e-5)


def episode(action, closes=3):
    """Commanded joints and closure of a grasp, a lift and a release."""
    grasp = grasp_of(action, ESTIMATE, 0.0)
    frames = [[0.0, 0.0, 0.4, 0.0, 0.0], [*grasp.over, grasp.preshape]]
    frames += [[*grasp.at, grasp.preshape], *[[*grasp.at, grasp.closure]] * closes]
    frames += [[*grasp.up, grasp.closure], [*grasp.up, 0.0]]
    return np.array(frames), np.tile(SEEN, (len(frames), 1))


ACTION = np.array([0.1, -0.2, 0.3, 0.4, 0.5, 0.9])


def test_the_grasp_of_an_episode_is_found():
    observation, action = grasp_in(BOX, *episode(ACTION), Straight(), 0.0)
    np.testing.assert_allclose(action, ACTION, atol=1e-6)
    np.testing.assert_array_equal(observation, one_shot_state(BOX))


def test_a_round_object_has_no_yaw():
    shape = Cylinder(radius=0.02, length=0.1)
    _, action = grasp_in(shape, *episode(ACTION), Straight(), 0.0)
    assert action[3] == pytest.approx(ACTION[3] + 0.3 / (0.5 * np.pi), abs=1e-6)


def test_what_is_no_grasp_from_above_is_left_out():
    frames, seen = episode(ACTION)
    unseen = np.where(np.arange(8) < 7, seen, 0.0)
    opened = np.column_stack([frames[:, :-1], np.zeros(len(frames))])
    assert grasp_in(BOX, frames, seen, Tilted(), 0.0) is None
    assert grasp_in(BOX, frames, unseen, Straight(), 0.0) is None
    assert grasp_in(BOX, opened, seen, Straight(), 0.0) is None
    away = frames + np.array([0.2, 0.0, 0.0, 0.0, 0.0])
    assert grasp_in(BOX, away, seen, Straight(), 0.0) is None


def write_dataset(
    folder, *, joints=4, successes=(True, False, True), origin=0.0, **change
):
    """Write what is read of a data set of `drake-srg dataset`."""
    names = [f"joint_{i}" for i in range(joints)]
    features = {"action": {"names": [*names, "gripper_closure"]}, SIGHTING: {}}
    (folder / "meta" / "episodes" / "chunk-000").mkdir(parents=True)
    (folder / "data" / "chunk-000").mkdir(parents=True)
    (folder / "meta" / "info.json").write_text(json.dumps({"features": features}))
    actions, seen = episode(ACTION)
    actions[:, :-1] -= origin
    n = len(actions)
    count = len(successes)
    about = {
        "success": list(successes),
        "failure": [None if done else "dropped" for done in successes],
        "object_size": [[0.04, 0.06, 0.1]] * count,
        "object_round": [False] * count,
        "dataset_from_index": [n * k for k in range(count)],
        "dataset_to_index": [n * (k + 1) for k in range(count)],
        **change,
    }
    file = "chunk-000/file-000.parquet"
    pq.write_table(pa.table(about), folder / "meta" / "episodes" / file)
    frames = {
        "index": np.arange(n * count),
        "action": np.tile(actions, (count, 1)).tolist(),
        SIGHTING: np.tile(seen, (count, 1)).tolist(),
    }
    pq.write_table(pa.table(frames), folder / "data" / file)
    return folder


@pytest.fixture(scope="module")
def env():
    return make_environment("GraspOneShot")


@pytest.mark.learn
def test_successful_grasps_of_a_data_set_are_cloned(tmp_path, env):
    # The gantry's joints are the pose less that of its origin.
    origin = env.unwrapped.mover.pose(np.zeros(4))
    data = write_dataset(tmp_path / "dataset", origin=origin)
    learner = MakeLearner("bc", env, 0, str(data))
    assert learner.advance(1) == [True]
    assert learner.advance(10) == [True]
    assert (learner.steps, learner.episodes) == (11, 2)


def test_grasps_that_held_until_the_object_was_misplaced_are_taken(tmp_path, env):
    origin = env.unwrapped.mover.pose(np.zeros(4))
    failure = ["dropped", "misplaced", None]
    data = write_dataset(tmp_path / "dataset", origin=origin, failure=failure)
    assert len(read_demonstrations(data, env)) == 3  # the first and last succeed
    data = write_dataset(
        tmp_path / "failed", origin=origin, failure=failure, successes=[False] * 3
    )
    assert len(read_demonstrations(data, env)) == 1


def test_what_is_no_such_data_set_is_one_line(tmp_path, env):
    cases = {
        "No such file": (tmp_path / "none", env),
        "arm with 7 joints": (write_dataset(tmp_path / "seven", joints=7), env),
        "no episode has a grasp": (
            write_dataset(tmp_path / "failed", successes=[False]),
            env,
        ),
        "above that held": (
            write_dataset(tmp_path / "soft", object_size=[None] * 3),
            env,
        ),
        "is not a data set": (tmp_path / "broken", env),
        "got another environment": (tmp_path, Toy()),
    }
    (tmp_path / "broken" / "meta").mkdir(parents=True)
    (tmp_path / "broken" / "meta" / "info.json").write_text("{}")
    for message, (folder, environment) in cases.items():
        with pytest.raises(ScenarioError, match=message) as error:
            read_demonstrations(folder, environment)
        assert "\n" not in str(error.value)


def test_only_clones_take_data():
    with pytest.raises(ScenarioError, match="--data: needs --algo bc, got q"):
        MakeLearner("q", Toy(), 0, "data")
