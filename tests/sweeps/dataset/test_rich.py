"""Data sets of recordings with depth, calibrations, forces, modes and two arms."""

import json

import numpy as np
import pytest

from drake_srg.scenario import load_tree
from drake_srg.sweeps.dataset.make import make_dataset
from drake_srg.sweeps.info import dump_tree
from sweeps.dataset import lerobot_format as lerobot
from sweeps.dataset.recorded_sweep import (
    ARM,
    CAMERAS,
    GRIPPER,
    MODES,
    camera_pose,
    closure,
    contact_wrench,
    depth_picture,
    effort,
    grasped,
    joint_positions,
    mode,
    touch,
    write_sweep,
    write_trial,
)

FPS = 8
DEPTH = "observation.images.ceiling_depth"
COUNTS = (8, 4)
ACTION = [*ARM, "gripper_closure"]


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    sweep = write_sweep(tmp_path_factory.mktemp("sweep"))
    for trial, count in enumerate(COUNTS):
        write_trial(sweep, trial, count / FPS, rich=("ceiling",))
    return make_dataset(sweep).path


@pytest.fixture(scope="module")
def features(root):
    return lerobot.read_info(root)["features"]


@pytest.fixture(scope="module")
def frames(root):
    return lerobot.read_frames(root)


def times():
    """Return the times of all images [s]."""
    return np.concatenate([np.arange(1, n + 1) / FPS for n in COUNTS])


def expected_depth(time):
    """Return what 12 bits hold of a depth image [m]: at most 4095 whole millimetres."""
    depth = depth_picture(time, *CAMERAS["ceiling"]).astype(float)
    depth[~np.isfinite(depth)] = 0.0
    return np.minimum(np.rint(depth * 1000.0), 4095.0) / 1000.0


def test_depth_comes_back_to_the_millimetre(root):
    shown = 0
    for episode in lerobot.read_episodes(root):
        decoded = list(lerobot.read_video_frames(root, episode, DEPTH))
        assert len(decoded) == episode["length"]
        for k, (late, depth) in enumerate(decoded):
            assert abs(late) < 0.5 / FPS
            np.testing.assert_allclose(depth, expected_depth((k + 1) / FPS), atol=1e-9)
            shown += np.max(depth) == pytest.approx(4.095)
    assert shown, "no depth was out of range"


def test_statistics_of_depth_are_in_millimetres(root):
    stats = json.loads((root / "meta/stats.json").read_text())[DEPTH]
    depths = 1000.0 * np.stack([expected_depth(time) for time in times()])
    for name in ("min", "max", "mean", "std"):
        found = getattr(np, name)(depths)
        np.testing.assert_allclose(np.ravel(stats[name]), [found], rtol=1e-9)


def test_cameras_have_intrinsics_and_a_pose_per_frame(features, frames):
    for key in ("observation.images.ceiling", DEPTH):
        intrinsics = features[key]["info"]["intrinsics"]
        assert intrinsics == {"fx": 100.0, "fy": 101.0, "cx": 80.0, "cy": 64.0}
    assert "intrinsics" not in features["observation.images.side"]["info"]
    feature = features["camera_pose.ceiling"]
    assert feature["names"] == ["x", "y", "z", "qx", "qy", "qz", "qw"]
    assert feature["info"]["units"] == ["m"] * 3 + ["1"] * 4
    for row, time in zip(
        frames["camera_pose.ceiling"].to_pylist(), times(), strict=True
    ):
        X_WC = camera_pose(time)
        turn = X_WC.rotation().ToQuaternion()
        xyzw = [getattr(turn, name)() for name in "xyzw"]
        np.testing.assert_allclose(row, [*X_WC.translation(), *xyzw], atol=1e-6)


WRENCHES = [f"observation.contact_wrench.{link}" for link in GRIPPER]


@pytest.fixture(scope="module")
def two_arms(tmp_path_factory):
    sweep = write_sweep(tmp_path_factory.mktemp("sweep"))
    for trial, count in enumerate(COUNTS):
        write_trial(sweep, trial, count / FPS, rich=("ceiling",), arms=ARMS)
    return make_dataset(sweep).path


# Not in the order of the alphabet. The second one's signals are twice the first's.
ARMS = ("right", "left")


@pytest.fixture(
    scope="module", params=[("root", [""]), ("two_arms", ["right_", "left_"])]
)
def robots(request):
    """Return features, frames, and the prefixes of the arms' names."""
    name, prefixes = request.param
    path = request.getfixturevalue(name)
    lerobot.check(path)
    return lerobot.read_info(path)["features"], lerobot.read_frames(path), prefixes


def command(time):
    return np.append(joint_positions(time)[:2] + 0.01, closure(time))


@pytest.mark.parametrize(
    ("feature", "function", "names", "unit"),
    [
        ("observation.state", joint_positions, ARM + GRIPPER, ""),
        ("action", command, ACTION, ""),
        ("observation.effort", effort, ARM, "N m"),  # the fingers measure none
        ("observation.touch", touch, ["0", "1"], "N"),
        ("observation.grasped", grasped, ["0"], "1"),
    ],
)
def test_one_arm_follows_the_other(robots, feature, function, names, unit):
    features, frames, prefixes = robots
    expected_names = [prefix + name for prefix in prefixes for name in names]
    assert features[feature]["names"] == expected_names
    if unit:
        assert features[feature]["info"]["units"] == [unit] * len(expected_names)
    # A second hand has grasped, too, and not twice.
    scales = [1, 1] if function is grasped else [1, 2]
    expected = [
        np.ravel([k * np.asarray(function(time)) for k in scales[: len(prefixes)]])
        for time in times()
    ]
    rows = np.reshape(frames[feature].to_pylist(), (len(expected), -1))
    np.testing.assert_allclose(rows, expected, rtol=1e-6)


def test_frames_tell_the_wrench_on_each_link(robots):
    features, frames, prefixes = robots
    found = {name for name in features if name.startswith("observation.contact_wrench")}
    assert len(found) == len(GRIPPER) * len(prefixes)
    for scale, prefix in enumerate(prefixes, 1):
        for number, link in enumerate(GRIPPER):
            name = f"observation.contact_wrench.{prefix}{link}"
            assert features[name]["names"] == ["tx", "ty", "tz", "fx", "fy", "fz"]
            assert features[name]["info"]["units"] == ["N m"] * 3 + ["N"] * 3
            own = [contact_wrench(time).reshape(2, 6)[number] for time in times()]
            rows = frames[name].to_pylist()
            np.testing.assert_allclose(rows, scale * np.array(own), rtol=1e-6)


def test_the_name_of_an_arm_may_begin_with_that_of_another(tmp_path):
    sweep = write_sweep(tmp_path)
    arms = ("left_2", "left")
    write_trial(sweep, 0, 0.2, cameras={"ceiling": (16, 12)}, arms=arms)
    features = lerobot.read_info(make_dataset(sweep).path)["features"]
    names = [f"{arm}_{name}" for arm in arms for name in ACTION]
    assert features["action"]["names"] == names


@pytest.mark.parametrize(
    ("scenario", "arms"), [("learn_kitchen", ("",)), ("handover", ("left", "right"))]
)
def test_touch_has_the_names_of_the_links_with_sensors(tmp_path, scenario, arms):
    sweep = write_sweep(tmp_path)
    info = json.loads((sweep / "sweep.json").read_text())
    tree = dump_tree(load_tree(scenario))
    (sweep / "sweep.json").write_text(json.dumps({**info, "tree": tree}))
    write_trial(sweep, 0, 0.2, cameras={"ceiling": (16, 12)}, sensors=4, arms=arms)
    features = lerobot.read_info(make_dataset(sweep).path)["features"]
    links = ["left_base", "right_base", "left_tip", "right_tip"]
    assert features["observation.touch"]["names"] == [
        f"{arm}_{link}" if arm else link for arm in arms for link in links
    ]


def test_subtasks_are_the_modes_of_the_planner(root, frames):
    for episode in lerobot.read_episodes(root):
        own = frames.slice(episode["dataset_from_index"], episode["length"])
        columns = own["language_persistent"].to_pylist()
        rows = columns[0]
        assert columns == [rows] * episode["length"]
        assert {(row["role"], row["style"]) for row in rows} == {
            ("assistant", "subtask")
        }
        for time in own["timestamp"].to_pylist():
            active = [row["content"] for row in rows if row["timestamp"] <= time][-1]
            assert active == mode(time + 1 / FPS).value.replace("_", " ")
    assert len(rows) == len([start for start, _ in MODES if start < COUNTS[1] / FPS])


def test_equal_recordings_give_equal_depth(root, tmp_path):
    again = make_dataset(root.parent, tmp_path / "again").path
    video = f"videos/{DEPTH}/chunk-000/file-000.mp4"
    assert (again / video).read_bytes() == (root / video).read_bytes()


def test_a_lower_frame_rate_takes_the_values_of_its_images(root, frames, tmp_path):
    made = make_dataset(root.parent, tmp_path / "slow", fps=4)
    lerobot.check(made.path)
    slow = lerobot.read_frames(made.path)
    kept = [0, 2, 4, 6, 8, 10]
    for key in ("observation.touch", "observation.effort", "camera_pose.ceiling"):
        assert slow[key].to_pylist() == frames[key].take(kept).to_pylist()


def test_recordings_without_them_lack_the_features(tmp_path):
    sweep = write_sweep(tmp_path)
    write_trial(sweep, 0, 0.3, cameras={"ceiling": (16, 12)})
    features = lerobot.read_info(make_dataset(sweep).path)["features"]
    assert DEPTH not in features
    assert "intrinsics" not in features["observation.images.ceiling"]["info"]
    for name in ("observation.effort", "camera_pose.ceiling", "observation.motor_pwm"):
        assert name not in features
    assert not features.keys() & {"observation.grasped", *WRENCHES}


@pytest.mark.lerobot
def test_lerobot_gives_everything_back(root):
    import torch
    from lerobot.datasets.language_render import active_at
    from lerobot.datasets.lerobot_dataset import LeRobotDataset
    from lerobot.utils.collate import lerobot_collate_fn

    dataset = LeRobotDataset(
        "us/rich",
        root=root,
        delta_timestamps={"action": [0.0, 1 / FPS]},
        video_backend="pyav",
    )
    assert dataset.meta.depth_keys == [DEPTH]
    assert len(dataset) == sum(COUNTS)
    for i, time in enumerate(times()):
        item = dataset[i]
        depth = item[DEPTH][0].numpy()  # [mm]
        np.testing.assert_array_equal(depth, np.float32(1000 * expected_depth(time)))
        np.testing.assert_allclose(item["observation.touch"], touch(time), atol=1e-6)
        wrenches = np.concatenate([item[name] for name in WRENCHES])
        np.testing.assert_array_equal(wrenches, np.float32(contact_wrench(time)))
        assert item["observation.grasped"].item() == grasped(time)
        rows, now = item["language_persistent"], item["timestamp"].item()
        active = active_at(now, persistent=rows, style="subtask")
        assert active["content"] == mode(time).value.replace("_", " ")
    mean = dataset.meta.stats[DEPTH]["mean"].item()
    depths = [1000 * expected_depth(time) for time in times()]
    assert mean == pytest.approx(np.mean(depths))
    metres = LeRobotDataset(
        "us/rich", root=root, video_backend="pyav", depth_output_unit="m"
    )
    np.testing.assert_allclose(
        metres[0][DEPTH][0].numpy(), expected_depth(times()[0]), atol=1e-6
    )
    loader = torch.utils.data.DataLoader(
        dataset, batch_size=5, shuffle=True, collate_fn=lerobot_collate_fn
    )
    batches = list(loader)
    assert [len(batch["index"]) for batch in batches] == [5, 5, 2]
    width, height = CAMERAS["ceiling"]
    assert batches[0][DEPTH].shape == (5, 1, height, width)
    assert batches[0]["action"].shape == (5, 2, 3)


@pytest.mark.lerobot
def test_lerobot_joins_and_edits_data_sets(root, tmp_path):
    from lerobot.datasets.aggregate import aggregate_datasets
    from lerobot.datasets.dataset_tools import delete_episodes, remove_feature
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    aggregate_datasets(
        ["us/a", "us/b"], "us/both", roots=[root, root], aggr_root=tmp_path / "both"
    )
    both = LeRobotDataset("us/both", root=tmp_path / "both", video_backend="pyav")
    assert len(both) == 2 * sum(COUNTS)
    np.testing.assert_array_equal(both[0][DEPTH], both[sum(COUNTS)][DEPTH])

    one = LeRobotDataset("us/a", root=root, video_backend="pyav")
    left = delete_episodes(one, [0], output_dir=tmp_path / "left", repo_id="us/left")
    assert len(left) == COUNTS[1]
    np.testing.assert_array_equal(left[0][DEPTH], one[COUNTS[0]][DEPTH])

    names = ["language_persistent", DEPTH]
    less = remove_feature(one, names, output_dir=tmp_path / "less", repo_id="us/less")
    assert not {*names} & {*less[0]}


@pytest.mark.lerobot
def test_lerobot_gives_both_arms_back(two_arms):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    dataset = LeRobotDataset("us/two", root=two_arms, video_backend="pyav")
    assert len(dataset) == sum(COUNTS)
    for item, time in zip(dataset, times(), strict=True):
        q, own = joint_positions(time), command(time)
        np.testing.assert_allclose(item["observation.state"], np.r_[q, 2 * q], 1e-6)
        np.testing.assert_allclose(item["action"], np.r_[own, 2 * own], 1e-6)
