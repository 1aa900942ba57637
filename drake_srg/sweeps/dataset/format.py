"""The LeRobotDataset format, version 3.0: its features, tables and info.json.

It is described in https://huggingface.co/docs/lerobot/lerobot-dataset-v3 and by
LeRobot's own reader and writer (https://github.com/huggingface/lerobot, 0.4 and
later). Its files, and what is in them::

    meta/info.json                            version, features, frame rate, paths
    meta/stats.json                           statistics over all frames
    meta/tasks.parquet                        the tasks in words, by number
    meta/episodes/chunk-000/file-000.parquet  one row per episode: its frames' place
    data/chunk-000/file-000.parquet           one row per frame, except images
    videos/CAMERA/chunk-000/file-000.mp4      images, many episodes per file
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import pyarrow as pa

from drake_srg.sweeps.dataset.files import CHUNK_SIZE
from drake_srg.sweeps.dataset.recording import SIGHTING, Layout
from drake_srg.sweeps.dataset.statistics import STATISTICS
from drake_srg.sweeps.dataset.video import CODEC, PIXEL_FORMAT

VERSION = "v3.0"
MEGABYTE = 1024**2  # LeRobot's
DATA_MB, VIDEO_MB = 100, 200  # largest files; LeRobot's defaults

Feature = dict[str, Any]

# Our own columns of an episode, beside LeRobot's, for filtering by trial.
TRIAL = {
    "trial": pa.int64(),
    "seed": pa.int64(),
    "success": pa.bool_(),
    "failure": pa.string(),  # the planner's reason; null for a success
    # What the robot knows of the object's shape; null if it is not a simple one.
    "object_size": pa.list_(pa.float64()),  # along its axes [m]
    "object_round": pa.bool_(),
}

# LeRobot's name for what policies may know of the scene besides the robot's state; its
# policies take it as a vector of its own kind (FeatureType.ENV).
SIGHTING_KEY = "observation.environment_state"

_SCALARS = {
    "next.done": "bool",
    "next.success": "bool",
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}
_ARROW = {"bool": pa.bool_(), "float32": pa.float32(), "int64": pa.int64()}


def video_key(camera: str) -> str:
    """Return the name of the feature with a camera's images."""
    return f"observation.images.{camera}"


def make_features(layout: Layout, fps: int) -> dict[str, Feature]:
    """Return the features of a data set, as in info.json."""
    features: dict[str, Feature] = {
        "observation.state": _vector(layout.joints),
        "action": _vector(layout.commands),
    }
    if layout.located:
        features[SIGHTING_KEY] = _vector(SIGHTING)
    for camera, (height, width) in layout.cameras.items():
        features[video_key(camera)] = {
            "dtype": "video",
            "shape": [height, width, 3],
            "names": ["height", "width", "channels"],
            "info": {
                "video.height": height,
                "video.width": width,
                "video.codec": CODEC,
                "video.pix_fmt": PIXEL_FORMAT,
                "video.is_depth_map": False,
                "video.fps": fps,
                "video.channels": 3,
                "has_audio": False,
            },
        }
    for name, dtype in _SCALARS.items():
        features[name] = {"dtype": dtype, "shape": [1], "names": None}
    return features


def _vector(names: Sequence[str]) -> Feature:
    return {"dtype": "float32", "shape": [len(names)], "names": list(names)}


def make_info(
    features: Mapping[str, Feature], fps: int, robot: str, episodes: int, frames: int
) -> dict[str, Any]:
    """Return the content of info.json for a data set with one task.

    Args:
        features: From `make_features`.
        fps: Frames per second.
        robot: The robot's type.
        episodes: Number of episodes.
        frames: Number of frames.
    """
    file = "chunk-{chunk_index:03d}/file-{file_index:03d}"
    return {
        "codebase_version": VERSION,
        "robot_type": robot,
        "total_episodes": episodes,
        "total_frames": frames,
        "total_tasks": 1,
        "chunks_size": CHUNK_SIZE,
        "data_files_size_in_mb": DATA_MB,
        "video_files_size_in_mb": VIDEO_MB,
        "fps": fps,
        "splits": {"train": f"0:{episodes}"},
        "data_path": f"data/{file}.parquet",
        "video_path": f"videos/{{video_key}}/{file}.mp4",
        "features": dict(features),
    }


def data_schema(features: Mapping[str, Feature]) -> pa.Schema:
    """Return the schema of frames."""
    return pa.schema(
        [(n, _column(f)) for n, f in features.items() if f["dtype"] != "video"]
    )


def _column(feature: Feature) -> pa.DataType:
    kind, (size,) = _ARROW[feature["dtype"]], feature["shape"]
    return kind if feature["names"] is None else pa.list_(kind, size)


def episode_schema(features: Mapping[str, Feature]) -> pa.Schema:
    """Return the schema of episodes."""
    integer, number = pa.int64(), pa.float64()
    columns = {
        "episode_index": integer,
        "tasks": pa.list_(pa.string()),
        "length": integer,
        "data/chunk_index": integer,
        "data/file_index": integer,
        "dataset_from_index": integer,
        "dataset_to_index": integer,
    }
    for name, feature in features.items():
        if feature["dtype"] == "video":
            columns[f"videos/{name}/chunk_index"] = integer
            columns[f"videos/{name}/file_index"] = integer
            columns[f"videos/{name}/from_timestamp"] = number
            columns[f"videos/{name}/to_timestamp"] = number
    for name, feature in features.items():
        for statistic in STATISTICS:
            kind = _statistic(feature, statistic)
            columns[f"stats/{name}/{statistic}"] = kind
    columns["meta/episodes/chunk_index"] = integer
    columns["meta/episodes/file_index"] = integer
    return pa.schema([*columns.items(), *TRIAL.items()])


def _statistic(feature: Feature, statistic: str) -> pa.DataType:
    """Return the type of a statistic of an episode."""
    if statistic == "count":
        return pa.list_(pa.int64())
    if feature["dtype"] == "video":
        return pa.list_(pa.list_(pa.list_(pa.float64())))  # (3, 1, 1)
    if statistic in ("min", "max") and feature["dtype"] != "float32":
        return pa.list_(_ARROW[feature["dtype"]])
    return pa.list_(pa.float64())


def tasks_table(tasks: Sequence[str]) -> pa.Table:
    """Return tasks.parquet: a pandas data frame whose index is the task in words.

    The schema's metadata name the column that is the index:
    https://pandas.pydata.org/docs/development/developer.html
    """
    table = pa.table(
        {"task_index": pa.array(range(len(tasks)), pa.int64()), "task": list(tasks)}
    )

    def column(name: str, kind: str, numpy: str) -> dict[str, Any]:
        return {
            "name": name,
            "field_name": name,
            "pandas_type": kind,
            "numpy_type": numpy,
            "metadata": None,
        }

    pandas = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [
            column("task_index", "int64", "int64"),
            column("task", "unicode", "object"),
        ],
        "creator": {"library": "pyarrow", "version": pa.__version__},
        "pandas_version": "2.0.0",  # version of this entry's form
    }
    return table.replace_schema_metadata({"pandas": json.dumps(pandas)})
