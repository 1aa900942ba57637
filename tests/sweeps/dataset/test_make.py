import functools
import json
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from drake_srg.scenario import draw_scenario, load_tree
from drake_srg.sweeps.dataset import make
from drake_srg.sweeps.dataset.format import (
    QUANTILES,
    FilePlace,
    ImageStatistics,
    ParquetFiles,
    VideoFiles,
    encode_episode,
    next_place,
)
from drake_srg.sweeps.dataset.make import Dataset, DatasetWriter, make_dataset
from drake_srg.sweeps.dataset.recording import ACTION, STATE, read_images, read_signals
from drake_srg.sweeps.info import dump_tree
from drake_srg.types import Cylinder
from sweeps.dataset import lerobot_format as lerobot
from sweeps.dataset.recorded_sweep import (
    ARM,
    CAMERAS,
    GRIPPER,
    SEEN,
    closure,
    joint_positions,
    picture,
    seen_pose,
    write_sweep,
    write_trial,
)

FPS = 8


@pytest.fixture(scope="module")
def root(sweep, tmp_path_factory):
    out = tmp_path_factory.mktemp("made") / "deep" / "dataset"
    made = make_dataset(sweep, out)
    assert made == Dataset(
        out,
        episodes=3,
        successes=2,
        frames=23,
        fps=FPS,
        left_out="2 that ended in an error, 1 unfinished",
    )
    assert list(out.parent.iterdir()) == [out]
    return out


@pytest.fixture(scope="module")
def frames(root):
    return lerobot.read_frames(root)


def vectors(frames, key):
    return np.array(frames[key].to_pylist())


def psnr(image, other):
    """Peak signal-to-noise ratio [dB]."""
    return 10 * np.log10(255**2 / np.mean((image.astype(float) - other) ** 2))


def test_the_data_set_follows_the_published_format(root):
    lerobot.check(root)


def test_the_info_names_robot_cameras_and_dimensions(root):
    info = lerobot.read_info(root)
    assert (info["robot_type"], info["fps"]) == ("kitchen_varied", FPS)
    features = info["features"]
    assert features["observation.state"]["names"] == ARM + GRIPPER
    assert features["action"]["names"] == [*ARM, "gripper_closure"]
    images = {k: f["shape"] for k, f in features.items() if f["dtype"] == "video"}
    assert images == {
        "observation.images.ceiling": [128, 160, 3],
        "observation.images.side": [128, 130, 3],
    }


def test_episodes_identify_their_trials(root):
    episodes = lerobot.read_episodes(root)
    keys = ("trial", "seed", "success", "failure", "length", "tasks")
    task = ["Pick up the soup can and place it on its goal."]
    assert [tuple(e[key] for key in keys) for e in episodes] == [
        (3, 103, True, None, 8, task),
        (4, 104, False, "dropped", 5, task),
        (7, 107, True, None, 10, task),
    ]


def test_a_scenario_with_a_script_instead_of_a_picked_object_has_a_task(tmp_path):
    folder = write_sweep(tmp_path)
    path = folder / "sweep.json"
    path.write_text(path.read_text().replace("task:\\n  pick: soup_can\\n", "{}"))
    write_trial(folder, 0, 0.2)
    made = make_dataset(folder)
    (episode,) = lerobot.read_episodes(made.path)
    assert episode["tasks"] == ["Follow the script of kitchen_varied."]


def test_only_the_last_frame_of_an_episode_is_done(frames):
    last = {7, 12, 22}
    assert frames["next.done"].to_pylist() == [i in last for i in range(23)]
    success = {7, 22}
    assert frames["next.success"].to_pylist() == [i in success for i in range(23)]


def test_states_and_actions_match_the_recording(sweep, root, frames):
    store = get_typestore(Stores.ROS2_HUMBLE)
    for episode in lerobot.read_episodes(root):
        said = {}
        path = sweep / f"recordings/{episode['trial']:06d}/recording.mcap"
        with Reader(path) as reader:
            for connection, time, raw in reader.messages():
                message = store.deserialize_cdr(raw, connection.msgtype)
                said.setdefault(connection.topic, {})[time] = message
        times = sorted(said["/camera_side/color/image_raw"])
        own = frames.slice(episode["dataset_from_index"], episode["length"])
        state = [said["/joint_states"][t].position for t in times]
        arm = [said["/arm/position_commanded"][t].data for t in times]
        gripper = [[said["/gripper/closure_commanded"][t].data] for t in times]
        np.testing.assert_array_equal(
            vectors(own, "observation.state"), np.float32(state)
        )
        np.testing.assert_array_equal(
            vectors(own, "action"), np.float32(np.hstack([arm, gripper]))
        )


def test_frames_tell_where_the_planner_last_saw_the_object(root, frames):
    feature = lerobot.read_info(root)["features"]["observation.environment_state"]
    assert feature["names"] == ["x", "y", "z", "qx", "qy", "qz", "qw", "seen"]
    found = vectors(frames, "observation.environment_state")
    times = vectors(frames, "timestamp") + 1 / FPS  # of the images
    for (*pose, seen), time in zip(found, times, strict=True):
        assert seen == (time >= SEEN)
        X_WO = seen_pose(time)
        x, y, z, w = (getattr(X_WO.rotation().ToQuaternion(), n)() for n in "xyzw")
        expected = [*X_WO.translation(), x, y, z, w] if seen else [0.0] * 7
        np.testing.assert_allclose(pose, expected, atol=1e-6)


def test_frames_have_no_object_pose_where_no_object_is_located(tmp_path):
    folder = write_sweep(tmp_path)
    write_trial(folder, 0, 0.3, located=False, cameras={"ceiling": (16, 12)})
    made = make_dataset(folder)
    lerobot.check(made.path)
    assert (
        "observation.environment_state" not in lerobot.read_info(made.path)["features"]
    )


def test_images_can_be_found_by_time(root):
    for episode in lerobot.read_episodes(root):
        for camera, (width, height) in CAMERAS.items():
            key = f"observation.images.{camera}"
            decoded = list(lerobot.read_video_frames(root, episode, key))
            assert len(decoded) == episode["length"]
            for k, (late, image) in enumerate(decoded):
                assert abs(late) < 0.5 / FPS
                shown = picture((k + 1) / FPS, width, height, 9 * episode["trial"])
                even = shown[: height // 2 * 2, : width // 2 * 2]
                # The subsampled colors at the disc's edge cost most. Other frames have
                # 22 dB.
                assert psnr(image, even) > 28


def test_image_statistics_of_a_data_set_cover_all_pixels(root):
    stats = json.loads((root / "meta/stats.json").read_text())
    for camera, (width, height) in CAMERAS.items():
        shown = [
            picture(k / FPS, width, height, 9 * trial)
            for trial, length in ((3, 8), (4, 5), (7, 10))
            for k in range(1, length + 1)
        ]
        pixels = np.stack(shown)[:, : height // 2 * 2, : width // 2 * 2] / 255.0
        said = stats[f"observation.images.{camera}"]
        for name in ("min", "max", "mean", "std"):
            expected = getattr(np, name)(pixels, axis=(0, 1, 2))
            np.testing.assert_allclose(np.ravel(said[name]), expected, atol=1e-9)


@given(arrays(np.uint8, st.tuples(st.integers(1, 5), st.integers(1, 4), st.just(3))))
def test_image_statistics_are_exact(image):
    statistics = ImageStatistics()
    statistics.add(image)
    said = statistics.statistics()
    pixels = image.reshape(-1, 3) / 255.0
    for name in ("min", "max", "mean", "std"):
        expected = getattr(np, name)(pixels, axis=0)
        np.testing.assert_allclose(np.ravel(said[name]), expected, atol=1e-9)
    for name, q in QUANTILES.items():
        expected = np.quantile(pixels, q, axis=0, method="inverted_cdf")
        np.testing.assert_allclose(np.ravel(said[name]), expected)


def test_equal_recordings_give_equal_bytes(sweep, root, tmp_path):
    make_dataset(sweep, tmp_path / "again")
    paths = [path for path in root.rglob("*") if path.is_file()]
    assert len(paths) == 7
    for path in paths:
        again = tmp_path / "again" / path.relative_to(root)
        assert again.read_bytes() == path.read_bytes(), path


def test_a_lower_frame_rate_takes_evenly_spaced_images(sweep, root, frames, tmp_path):
    made = make_dataset(sweep, tmp_path / "slow", fps=4)
    assert (made.frames, made.fps) == (4 + 3 + 5, 4)
    lerobot.check(made.path)
    slow = lerobot.read_frames(made.path)
    every_other = [0, 2, 4, 6, 8, 10, 12, 13, 15, 17, 19, 21]
    for key in ("observation.state", "action"):
        assert slow[key].to_pylist() == frames[key].take(every_other).to_pylist()
    (episode, *_) = lerobot.read_episodes(made.path)
    images = lerobot.read_video_frames(made.path, episode, "observation.images.ceiling")
    for k, (_, image) in enumerate(images):
        assert psnr(image, picture((2 * k + 1) / FPS, 160, 128, 27)) > 28


def test_failed_trials_can_be_left_out(sweep, tmp_path):
    made = make_dataset(sweep, tmp_path / "good", only_success=True)
    assert (made.episodes, made.successes) == (2, 2)
    lerobot.check(made.path)
    assert [e["trial"] for e in lerobot.read_episodes(made.path)] == [3, 7]


def test_joints_are_interpolated_and_commands_are_held(tmp_path):
    folder = write_sweep(tmp_path)
    write_trial(folder, 0, 0.6, image_period=0.125, period=0.04)
    signals = read_signals(folder / "recordings/000000/recording.mcap")
    times = 0.125 * np.arange(1, 5)
    expected = joint_positions(times[:, None])
    np.testing.assert_allclose(signals.values[STATE], expected, atol=1e-7)
    before = 0.04 * np.floor(times / 0.04 + 1e-9)
    arm = joint_positions(before[:, None])[:, :2] + 0.01
    action = signals.values[ACTION]
    np.testing.assert_allclose(action[:, :2], arm, atol=1e-7)
    np.testing.assert_allclose(action[:, 2], closure(before), atol=1e-7)


def smaller(kind, limit, folder, content, _):
    """Return files of a kind with a lower limit [bytes] than a data set's own."""
    return kind(folder, content, limit)


def test_large_data_sets_have_several_files(sweep, tmp_path, monkeypatch):
    path = sweep / "recordings/000007/recording.mcap"
    signals = read_signals(path)
    about = {"trial": 7, "seed": 107, "success": True, "failure": None}
    about |= {"object_size": None, "object_round": None}
    episode, _ = encode_episode(read_images(path, "ceiling"), FPS)
    # An episode has 247 bytes per frame, and more metadata.
    for kind, limit in ((ParquetFiles, 6100), (VideoFiles, int(2.5 * len(episode)))):
        small = functools.partial(smaller, kind, limit)
        monkeypatch.setattr(make, kind.__name__, small)
    monkeypatch.setattr(make, "_EPISODES_AT_ONCE", 3)
    out = tmp_path / "made"
    with DatasetWriter(out, signals.layout, FPS, task="wait", robot="arm") as writer:
        for _ in range(7):
            images = {
                f"observation.images.{camera}": read_images(path, camera)
                for camera in CAMERAS
            }
            writer.add(signals, images, about)
        writer.finish()
    lerobot.check(tmp_path / "made")
    videos = tmp_path / "made/videos/observation.images.ceiling/chunk-000"
    assert len(list(videos.iterdir())) == 4  # with 2, 2, 2 and 1 episodes
    for video in videos.iterdir():
        assert video.stat().st_size <= 2.5 * len(episode)
    assert len(list((tmp_path / "made/data/chunk-000").iterdir())) == 4
    assert len(list((tmp_path / "made/meta/episodes/chunk-000").iterdir())) == 3


def test_folders_hold_a_thousand_files():
    assert next_place(None) == (0, 0)
    assert next_place(FilePlace(0, 998)) == (0, 999)
    assert next_place(FilePlace(0, 999)) == (1, 0)


@pytest.mark.slow
def test_torch_pandas_and_datasets_are_not_needed(sweep, tmp_path):
    code = """
import pathlib, sys

class Absent:
    def find_spec(name, path=None, target=None):
        if name.split(".")[0] in ("torch", "pandas", "datasets", "lerobot"):
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Absent)
from drake_srg.sweeps.dataset.make import make_dataset
make_dataset(*map(pathlib.Path, sys.argv[1:]))
"""
    out = tmp_path / "made"
    subprocess.run([sys.executable, "-c", code, str(sweep), str(out)], check=True)
    assert (out / "meta/info.json").exists()


def test_an_episode_tells_what_the_robot_knows_of_the_object(tmp_path):
    sweep = write_sweep(tmp_path / "sweep")
    tree = load_tree("learn_kitchen")
    info = json.loads((sweep / "sweep.json").read_text())
    (sweep / "sweep.json").write_text(json.dumps({**info, "tree": dump_tree(tree)}))
    for trial in (0, 1, 2):
        write_trial(sweep, trial, 0.2)
    made = make_dataset(sweep)
    for row in lerobot.read_episodes(made.path):
        thing = draw_scenario(tree, "learn_kitchen", row["seed"]).scenario
        shape = thing.objects["clutter_1"].shape
        assert row["object_size"] == pytest.approx(shape.bounding_size)
        assert row["object_round"] == isinstance(shape, Cylinder)
