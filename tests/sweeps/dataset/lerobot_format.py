"""Checks a folder against the published description of LeRobotDataset v3.0.

https://huggingface.co/docs/lerobot/lerobot-dataset-v3 describes the files. Types and
columns are those that LeRobot 0.6.1 writes with `LeRobotDataset.create`, `add_frame`,
`save_episode` and `finalize`, with our `units` and `intrinsics` in features' `info`.
Nothing here uses our own writer.
"""

import json
from collections import defaultdict
from itertools import accumulate

import av
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
STATISTICS = {"min", "max", "mean", "std", "count", *QUANTILES}
DEFAULT_FEATURES = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}
INFO_TYPES = {
    "codebase_version": str,
    "robot_type": str,
    "total_episodes": int,
    "total_frames": int,
    "total_tasks": int,
    "chunks_size": int,
    "data_files_size_in_mb": int,
    "video_files_size_in_mb": int,
    "fps": int,
    "splits": dict,
    "data_path": str,
    "video_path": str,
    "features": dict,
}
VIDEO_INFO = {
    "video.height",
    "video.width",
    "video.codec",
    "video.pix_fmt",
    "is_depth_map",
    "video.fps",
    "video.channels",
    "has_audio",
}
DEPTH_INFO = {
    "depth_unit",
    *(f"video.{name}" for name in ("depth_min", "depth_max", "shift", "use_log")),
}
LANGUAGE = {
    "role": pa.string(),
    "content": pa.string(),
    "style": pa.string(),
    "timestamp": pa.float32(),
    "camera": pa.string(),
    "tool_calls": pa.list_(pa.string()),
}


def read_info(root):
    return json.loads((root / "meta/info.json").read_text())


def read_episodes(root):
    """Return the rows of all episodes, as dicts."""
    paths = sorted((root / "meta/episodes").glob("*/*.parquet"))
    return [row for path in paths for row in pq.read_table(path).to_pylist()]


def read_frames(root):
    """Return all frames as one table."""
    paths = sorted((root / "data").glob("*/*.parquet"))
    return pa.concat_tables([pq.read_table(path) for path in paths])


def read_video_frames(root, episode, key):
    """Find an episode's frames in a video by time: frame k at from_timestamp + k / fps.

    Yields:
        The deviation of the frame's time [s], and the frame, RGB or depth [m].
    """
    info = read_info(root)
    about = info["features"][key]["info"]
    pixels = "gray12le" if about["is_depth_map"] else "rgb24"
    path = root / info["video_path"].format(
        video_key=key,
        chunk_index=episode[f"videos/{key}/chunk_index"],
        file_index=episode[f"videos/{key}/file_index"],
    )
    start = episode[f"videos/{key}/from_timestamp"]
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        for k in range(episode["length"]):
            time = start + k / info["fps"]
            container.seek(round(time / stream.time_base), stream=stream)
            frames = container.decode(stream)
            frame = min(
                (next(frames), next(frames, None)),
                key=lambda f: abs(f.time - time) if f else np.inf,
            )
            image = frame.to_ndarray(format=pixels)
            if about["is_depth_map"]:
                assert not about["video.use_log"]
                low, high = about["video.depth_min"], about["video.depth_max"]
                image = low + image * ((high - low) / 4095)
            yield frame.time - time, image


def check(root):
    """Assert that the folder is a valid data set."""
    info = read_info(root)
    _check_info(info)
    frames, episodes = read_frames(root), read_episodes(root)
    tasks = _check_tasks(root, info)
    _check_frames(root, info, frames)
    _check_episodes(root, info, frames, episodes, tasks)
    for key, feature in info["features"].items():
        if feature["dtype"] == "video":
            _check_videos(root, info, key, feature, episodes)
    _check_statistics(root, info, frames, episodes)
    listed = {"meta/info.json", "meta/stats.json", "meta/tasks.parquet"}
    for path in root.rglob("*"):
        if path.is_file():
            name = path.relative_to(root).as_posix()
            assert name in listed or name.split("/")[-2].startswith("chunk-"), name


def _check_info(info):
    assert info.keys() == INFO_TYPES.keys()
    for key, kind in INFO_TYPES.items():
        assert type(info[key]) is kind, key
    assert info["codebase_version"] == "v3.0"
    assert info["fps"] > 0
    assert info["chunks_size"] == 1000
    assert info["data_files_size_in_mb"] == 100
    assert info["video_files_size_in_mb"] == 200
    assert info["splits"] == {"train": f"0:{info['total_episodes']}"}
    place = "chunk-{chunk_index:03d}/file-{file_index:03d}"
    assert info["data_path"] == f"data/{place}.parquet"
    assert info["video_path"] == f"videos/{{video_key}}/{place}.mp4"
    for key, feature in info["features"].items():
        assert "/" not in key
        assert {"dtype", "shape", "names"} <= feature.keys()
        if feature["dtype"] == "video":
            own = feature["info"].keys() - {"intrinsics"}
            depth = feature["info"]["is_depth_map"]
            assert own == VIDEO_INFO | (DEPTH_INFO if depth else set())
            assert feature["names"] == ["height", "width", "channels"]
            continue
        if feature["dtype"] == "language":
            assert key == "language_persistent"
            assert feature == {"dtype": "language", "shape": [1], "names": None}
            continue
        assert feature["dtype"] in ("float32", "int64", "bool")
        units = feature.get("info", {}).get("units", feature["names"])
        assert feature["names"] is None or len(units) == len(feature["names"])
        assert len(feature["shape"]) == 1
        assert feature["names"] is None or len(feature["names"]) == feature["shape"][0]
    for key, dtype in DEFAULT_FEATURES.items():
        expected = {"dtype": dtype, "shape": [1], "names": None}
        assert info["features"][key] == expected


def _arrow(feature):
    if feature["dtype"] == "language":
        required = ("role", "timestamp")
        fields = [
            pa.field(n, t, nullable=n not in required) for n, t in LANGUAGE.items()
        ]
        return pa.list_(pa.struct(fields))
    kind = {"float32": pa.float32(), "int64": pa.int64(), "bool": pa.bool_()}
    one = kind[feature["dtype"]]
    return one if feature["shape"] == [1] else pa.list_(one, feature["shape"][0])


def _check_tasks(root, info):
    table = pq.read_table(root / "meta/tasks.parquet")
    (index,) = json.loads(table.schema.metadata[b"pandas"])["index_columns"]
    assert table["task_index"].type == pa.int64()
    assert table["task_index"].to_pylist() == list(range(info["total_tasks"]))
    return table[index].to_pylist()


def _check_frames(root, info, frames):
    columns = {k: f for k, f in info["features"].items() if f["dtype"] != "video"}
    assert frames.schema.names == list(columns)
    for key, feature in columns.items():
        assert frames.schema.field(key).type == _arrow(feature), key
        assert frames[key].null_count == 0
    assert frames.num_rows == info["total_frames"]
    assert frames["index"].to_pylist() == list(range(frames.num_rows))
    for path in (root / "data").glob("*/*.parquet"):
        assert path.stat().st_size <= info["data_files_size_in_mb"] * 2**20


def _check_episodes(root, info, frames, episodes, tasks):
    assert [e["episode_index"] for e in episodes] == list(range(len(episodes)))
    assert len(episodes) == info["total_episodes"]
    ends = list(accumulate(e["length"] for e in episodes))
    assert [e["dataset_to_index"] for e in episodes] == ends
    assert [e["dataset_from_index"] for e in episodes] == [0, *ends[:-1]]
    for episode in episodes:
        start, end = episode["dataset_from_index"], episode["dataset_to_index"]
        own = frames.slice(start, end - start)
        number = np.arange(episode["length"])
        assert own["frame_index"].to_pylist() == number.tolist()
        assert set(own["episode_index"].to_pylist()) == {episode["episode_index"]}
        times = (number / info["fps"]).astype(np.float32)
        np.testing.assert_array_equal(own["timestamp"].to_numpy(), times)
        words = {tasks[i] for i in own["task_index"].to_pylist()}
        assert set(episode["tasks"]) == words
        path = root / info["data_path"].format(
            chunk_index=episode["data/chunk_index"],
            file_index=episode["data/file_index"],
        )
        indices = pq.read_table(path, columns=["index"])["index"].to_pylist()
        assert set(range(start, end)) <= set(indices)
        meta = "chunk-{:03d}/file-{:03d}.parquet".format(
            episode["meta/episodes/chunk_index"], episode["meta/episodes/file_index"]
        )
        table = pq.read_table(root / "meta/episodes" / meta)
        assert episode["episode_index"] in table["episode_index"].to_pylist()


def _check_videos(root, info, key, feature, episodes):
    ends = defaultdict(float)  # end of each file so far [s]
    for episode in episodes:
        place = (
            episode[f"videos/{key}/chunk_index"],
            episode[f"videos/{key}/file_index"],
        )
        assert episode[f"videos/{key}/from_timestamp"] == ends[place]
        ends[place] = episode[f"videos/{key}/to_timestamp"]
        duration = ends[place] - episode[f"videos/{key}/from_timestamp"]
        np.testing.assert_allclose(duration, episode["length"] / info["fps"])
    places = list(ends)
    assert places == [divmod(i, info["chunks_size"]) for i in range(len(places))]
    for (chunk, file), end in ends.items():
        path = root / info["video_path"].format(
            video_key=key, chunk_index=chunk, file_index=file
        )
        assert path.stat().st_size <= info["video_files_size_in_mb"] * 2**20
        with av.open(str(path)) as container:
            (stream,) = container.streams
            said = feature["info"]
            depth = said["is_depth_map"]
            channels = said["video.channels"]
            assert channels == (1 if depth else 3)
            assert feature["shape"] == [stream.height, stream.width, channels]
            assert [said["video.height"], said["video.width"]] == feature["shape"][:2]
            assert stream.codec_context.codec.canonical_name == said["video.codec"]
            pixels = "gray12le" if depth else "yuv420p"
            assert stream.codec_context.pix_fmt == said["video.pix_fmt"] == pixels
            assert stream.base_rate == said["video.fps"] == info["fps"]
            assert not said["has_audio"]
            times = [frame.time for frame in container.decode(stream)]
        assert len(times) == round(end * info["fps"])
        np.testing.assert_allclose(times, np.arange(len(times)) / info["fps"])


def _column(frames, key):
    column = frames[key].to_pylist()
    return np.array(column).reshape(len(column), -1)


def _check_statistics(root, info, frames, episodes):
    stats = json.loads((root / "meta/stats.json").read_text())
    features = dict(info["features"])
    features.pop("language_persistent", None)
    assert stats.keys() == features.keys()
    for key, feature in features.items():
        ours = [{s: e[f"stats/{key}/{s}"] for s in STATISTICS} for e in episodes]
        assert stats[key].keys() == STATISTICS
        if feature["dtype"] == "video":
            for one in (stats[key], *ours):
                _check_image_statistics(one, feature["info"]["is_depth_map"])
            counts = [episode["length"] for episode in episodes]
            assert [one["count"] for one in ours] == [[n] for n in counts]
            assert stats[key]["count"] == [frames.num_rows]
            continue
        _check_numbers(stats[key], _column(frames, key))
        for episode, one in zip(episodes, ours, strict=True):
            own = frames.slice(episode["dataset_from_index"], episode["length"])
            _check_numbers(one, _column(own, key))


def _check_numbers(statistics, values):
    numbers = values.astype(float)
    assert statistics["count"] == [len(values)]
    np.testing.assert_array_equal(statistics["min"], values.min(axis=0))
    np.testing.assert_array_equal(statistics["max"], values.max(axis=0))
    expected = {
        "mean": numbers.mean(axis=0),
        "std": numbers.std(axis=0),
        **{name: np.quantile(numbers, q, axis=0) for name, q in QUANTILES.items()},
    }
    for name, value in expected.items():
        np.testing.assert_allclose(statistics[name], value, atol=1e-12, err_msg=name)


def _check_image_statistics(statistics, depth):
    """Check ordered values per channel: from 0 to 1, or up to 4095 mm."""
    shape, most = ((1, 1, 1), 4095) if depth else ((3, 1, 1), 1)
    for name in STATISTICS - {"count"}:
        assert np.shape(statistics[name]) == shape
    ordered = [statistics[name] for name in ("min", *QUANTILES, "max")]
    assert np.all(np.diff(ordered, axis=0) >= 0)
    assert np.all(np.array(ordered) >= 0) and np.all(np.array(ordered) <= most)
