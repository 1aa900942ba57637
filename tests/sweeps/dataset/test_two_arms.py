"""Data sets of recordings with two arms: one follows the other in every vector."""

import json

import numpy as np
import pytest

from drake_srg.scenario import load_tree
from drake_srg.sweeps.dataset.make import make_dataset
from drake_srg.sweeps.info import dump_tree
from sweeps.dataset import lerobot_format as lerobot
from sweeps.dataset.recorded_sweep import (
    ARM,
    GRIPPER,
    closure,
    contact_wrench,
    effort,
    grasped,
    joint_positions,
    touch,
    write_sweep,
    write_trial,
)

FPS, COUNT = 8, 4
# Not in the order of the alphabet. The second one's signals are twice the first's.
ARMS = ("right", "left")
CAMERAS = {"ceiling": (160, 128)}
TIMES = np.arange(1, COUNT + 1) / FPS
ACTION = [*ARM, "gripper_closure"]


def command(time):
    return np.append(joint_positions(time)[:2] + 0.01, closure(time))


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    sweep = write_sweep(tmp_path_factory.mktemp("sweep"))
    write_trial(sweep, 0, COUNT / FPS, cameras=CAMERAS, rich=("ceiling",), arms=ARMS)
    return make_dataset(sweep).path


def test_the_data_set_follows_the_published_format(root):
    lerobot.check(root)


@pytest.mark.parametrize(
    ("feature", "function", "names"),
    [
        ("observation.state", joint_positions, ARM + GRIPPER),
        ("action", command, ACTION),
        ("observation.effort", effort, ARM),
        ("observation.touch", touch, ["0", "1"]),
    ],
)
def test_one_arm_follows_the_other(root, feature, function, names):
    expected_names = [f"{arm}_{name}" for arm in ARMS for name in names]
    assert lerobot.read_info(root)["features"][feature]["names"] == expected_names
    expected = [np.r_[function(time), 2 * np.asarray(function(time))] for time in TIMES]
    rows = lerobot.read_frames(root)[feature].to_pylist()
    np.testing.assert_allclose(rows, expected, rtol=1e-6)


def test_frames_tell_which_hand_has_grasped(root):
    feature = lerobot.read_info(root)["features"]["observation.grasped"]
    assert feature["names"] == [f"{arm}_0" for arm in ARMS]
    rows = lerobot.read_frames(root)["observation.grasped"].to_pylist()
    assert rows == [[grasped(time)] * 2 for time in TIMES]


def test_wrenches_have_the_names_of_arm_and_link(root):
    frames = lerobot.read_frames(root)
    for scale, arm in enumerate(ARMS, 1):
        for number, link in enumerate(GRIPPER):
            rows = frames[f"observation.contact_wrench.{arm}_{link}"].to_pylist()
            own = [contact_wrench(time).reshape(2, 6)[number] for time in TIMES]
            np.testing.assert_allclose(rows, scale * np.array(own), rtol=1e-6)
    assert "observation.contact_wrench.left_base" not in frames.column_names


def test_the_name_of_an_arm_may_begin_with_that_of_another(tmp_path):
    sweep = write_sweep(tmp_path)
    arms = ("left_2", "left")
    write_trial(sweep, 0, 0.2, cameras=CAMERAS, arms=arms)
    features = lerobot.read_info(make_dataset(sweep).path)["features"]
    names = [f"{arm}_{name}" for arm in arms for name in ACTION]
    assert features["action"]["names"] == names


def test_touch_has_the_names_of_the_links_with_sensors(tmp_path):
    sweep = write_sweep(tmp_path)
    info = json.loads((sweep / "sweep.json").read_text())
    tree = dump_tree(load_tree("handover"))
    (sweep / "sweep.json").write_text(json.dumps({**info, "tree": tree}))
    write_trial(sweep, 0, 0.2, cameras=CAMERAS, sensors=4, arms=("left", "right"))
    features = lerobot.read_info(make_dataset(sweep).path)["features"]
    links = ["left_base", "right_base", "left_tip", "right_tip"]
    assert features["observation.touch"]["names"] == [
        f"{arm}_{link}" for arm in ("left", "right") for link in links
    ]


@pytest.mark.lerobot
def test_lerobot_gives_both_arms_back(root):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    dataset = LeRobotDataset("us/two", root=root, video_backend="pyav")
    assert len(dataset) == COUNT
    for item, time in zip(dataset, TIMES, strict=True):
        q, own = joint_positions(time), command(time)
        np.testing.assert_allclose(item["observation.state"], np.r_[q, 2 * q], 1e-6)
        np.testing.assert_allclose(item["action"], np.r_[own, 2 * own], 1e-6)
