"""The LeRobotDataset format, version 3.0: features, tables, statistics, videos.

The format is described in https://huggingface.co/docs/lerobot/lerobot-dataset-v3 and by
LeRobot's own reader and writer (https://github.com/huggingface/lerobot). Depth and
language are as in LeRobot 0.6. A data set has these files::

    meta/info.json                            version, features, frame rate, paths
    meta/stats.json                           statistics over all frames
    meta/tasks.parquet                        the tasks in words, by number
    meta/episodes/chunk-000/file-000.parquet  one row per episode: place of its frames
    data/chunk-000/file-000.parquet           one row per frame, without images
    videos/CAMERA/chunk-000/file-000.mp4      images, many episodes per file

The statistics of each feature and dimension are min, max, mean, std, count and the
quantiles q01, q10, q50, q90 and q99. For images, they are per color channel, with
values from 0 to 1, shape (3, 1, 1); for depth, in millimetres, shape (1, 1, 1). LeRobot
estimates statistics from samples. Here, they cover all values.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from drake_srg.recording.output import require
from drake_srg.sweeps.dataset.recording import DepthImage, Image, Layout

CHUNK_SIZE = 1000  # files per folder, as in LeRobot


class FilePlace(NamedTuple):
    """The place of a numbered file: the number of its folder, and its own number."""

    chunk: int
    file: int

    def path(self, folder: Path, suffix: str) -> Path:
        """Return the file's path."""
        return folder / f"chunk-{self.chunk:03d}" / f"file-{self.file:03d}{suffix}"


def next_place(place: FilePlace | None) -> FilePlace:
    """Return the place after another one, or the first place after None."""
    if place is None:
        return FilePlace(0, 0)
    if place.file + 1 < CHUNK_SIZE:
        return FilePlace(place.chunk, place.file + 1)
    return FilePlace(place.chunk + 1, 0)


class _Files:
    """Writes numbered files of limited size; the last is complete after `close`.

    Args:
        folder: Folder for chunk-000/file-000 and so on.
        suffix: End of the files' names.
        limit: Largest size of a file [bytes]; a larger item gets a file of its own.

    Raises:
        OSError: If a file cannot be written.
    """

    def __init__(self, folder: Path, suffix: str, limit: int) -> None:
        self._folder, self._suffix, self._limit = folder, suffix, limit
        self._place: FilePlace | None = None
        self._size = 0
        self._writer: Any = None  # of the open file

    def place(self, size: int) -> FilePlace:
        """Return the place for the next item, given its size [bytes]."""
        if self._place is None or (self._size and self._size + size > self._limit):
            self.close()
            self._place = next_place(self._place)
            self._size = 0
        return self._place

    def _new_path(self) -> Path:
        assert self._place is not None
        path = self._place.path(self._folder, self._suffix)
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def close(self) -> None:
        """Complete the open file, if any."""
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.close()


class ParquetFiles(_Files):
    """Parquet files with one row group per table, limited by their size in memory."""

    def __init__(self, folder: Path, schema: pa.Schema, limit: int) -> None:
        super().__init__(folder, ".parquet", limit)
        self._schema = schema

    def append(self, table: pa.Table) -> FilePlace:
        """Append a table; returns its place."""
        place = self.place(table.nbytes)
        if self._writer is None:
            path = self._new_path()
            self._writer = pq.ParquetWriter(path, self._schema, compression="snappy")
        self._writer.write_table(table)
        self._size += table.nbytes
        return place


QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
STATISTICS = ("min", "max", "mean", "std", "count", *QUANTILES)

Statistics = dict[str, Any]  # name to nested lists of numbers, for JSON and Parquet


def column_statistics(column: pa.ChunkedArray | pa.Array) -> Statistics:
    """Return the statistics of a Parquet column of numbers or of vectors."""
    if pa.types.is_fixed_size_list(column.type):
        size = column.type.list_size
        values = column.combine_chunks().flatten().to_numpy().reshape(-1, size)
    else:
        values = column.to_numpy(zero_copy_only=False).reshape(-1, 1)
    numbers = values.astype(np.float64)
    statistics = {
        "min": values.min(axis=0),  # min and max keep the feature's type
        "max": values.max(axis=0),
        "mean": numbers.mean(axis=0),
        "std": numbers.std(axis=0),
        "count": np.array([len(values)]),
        **{name: np.quantile(numbers, q, axis=0) for name, q in QUANTILES.items()},
    }
    return {name: value.tolist() for name, value in statistics.items()}


class ImageStatistics:
    """Exact statistics of images in constant memory, from counts of values.

    Args:
        depth: Whether the images hold depths [mm], up to `DEPTH_MAX`.
    """

    def __init__(self, depth: bool = False) -> None:
        self._scale, size = (1.0, DEPTH_MAX + 1) if depth else (1.0 / 255.0, 256)
        self._histogram = np.zeros((1 if depth else 3, size), dtype=np.int64)
        self._images = 0

    def add(self, image: Image | DepthImage) -> None:
        """Count the values of an image, shape (height, width, 3 if it has colors)."""
        channels, size = self._histogram.shape
        for channel in range(channels):
            counts = cv2.calcHist([image], [channel], None, [size], [0, size])
            self._histogram[channel] += counts.ravel().astype(np.int64)
        self._images += 1

    def merge(self, other: ImageStatistics) -> None:
        """Add the counts of another instance."""
        self._histogram += other._histogram
        self._images += other._images

    def statistics(self) -> Statistics:
        """Return the statistics; needs at least one image."""
        value = self._scale * np.arange(self._histogram.shape[1], dtype=np.float64)
        channels = [_weighted(value, counts) for counts in self._histogram]
        shaped = {
            name: np.reshape(
                [channel[name] for channel in channels], (-1, 1, 1)
            ).tolist()
            for name in channels[0]
        }
        return {**shaped, "count": [self._images]}


def _weighted(
    value: npt.NDArray[np.float64], counts: npt.NDArray[np.int64]
) -> dict[str, float]:
    """Return the statistics of values, weighted by how often each occurs."""
    mean = np.average(value, weights=counts)
    seen = value[counts > 0]
    quantiles = np.quantile(
        value, [*QUANTILES.values()], weights=counts, method="inverted_cdf"
    )
    return {
        "min": seen[0],
        "max": seen[-1],
        "mean": mean,
        "std": np.sqrt(np.average((value - mean) ** 2, weights=counts)),
        **dict(zip(QUANTILES, quantiles, strict=True)),
    }


# Largest depth. As in LeRobot, depth is a video of 12 bits. LeRobot also has a
# logarithmic scale. Here, one count is a millimetre, so whole millimetres are exact.
DEPTH_MAX = 4095  # mm


class Encoding(NamedTuple):
    """An encoding of videos.

    Every second frame is a key frame, as in LeRobot's own videos, because learners read
    frames in random order. There are no B-frames, so packets are in order of time.

    Attributes:
        codec: Its name in info.json.
        pixels: Format of the video's pixels.
        encoder: Name of the encoder.
        options: Its options.
        source: Format of the images.
    """

    codec: str
    pixels: str
    encoder: str
    options: dict[str, str]
    source: str


COLOR = Encoding(
    "h264",
    "yuv420p",
    "libx264",
    # A constant rate factor of 23 is x264's default.
    {"crf": "23", "preset": "veryfast", "g": "2", "bf": "0"},
    "rgb24",
)
# Slower presets give equal sizes. Without threads, equal images give equal bytes.
_X265 = "lossless=1:keyint=2:bframes=0:pools=none:frame-threads=1:log-level=none"
_LOSSLESS = {"preset": "ultrafast", "x265-params": _X265}
DEPTH = Encoding("hevc", "gray12le", "libx265", _LOSSLESS, "gray12le")
# Tags of ISO/IEC 23091-2 (ffmpeg's AVCOL_*) for ITU-R BT.601 in limited range, to which
# RGB is converted. Without tags, players would guess from the image size.
_BT601, _LIMITED = 6, 1


def encode_episode(
    images: Iterable[Image | DepthImage], fps: int, encoding: Encoding = COLOR
) -> tuple[bytes, int]:
    """Encode images as an MP4 file that starts with a key frame.

    Equal images give equal bytes.

    Args:
        images: RGB, shape (height, width, 3), or depth up to `DEPTH_MAX` [mm], shape
            (height, width). Height and width are even.
        fps: Frames per second.
        encoding: COLOR or DEPTH.

    Returns:
        The file, and its number of frames.
    """
    av = require("av")
    file = io.BytesIO()
    frames = 0
    with av.open(file, "w", format="mp4") as container:
        stream = container.add_stream(
            encoding.encoder, rate=fps, options=encoding.options
        )
        stream.pix_fmt = encoding.pixels
        codec = stream.codec_context
        codec.thread_count = 1  # the number of threads changes the bytes
        if encoding is COLOR:
            codec.colorspace, codec.color_range = _BT601, _LIMITED
        for image in images:
            if not frames:
                stream.height, stream.width = image.shape[:2]
            pixels = np.ascontiguousarray(image)
            frame = av.VideoFrame.from_ndarray(pixels, encoding.source)
            frame.pts, frame.time_base = frames, Fraction(1, fps)
            container.mux(stream.encode(frame))
            frames += 1
        container.mux(stream.encode(None))
    return file.getvalue(), frames


class VideoFiles(_Files):
    """MP4 files that join a camera's encoded episodes."""

    def __init__(self, folder: Path, fps: int, limit: int) -> None:
        super().__init__(folder, ".mp4", limit)
        self._av = require("av")
        self._fps, self._frames = fps, 0
        self._stream: Any = None

    def append(self, episode: bytes) -> tuple[FilePlace, int]:
        """Append an episode; returns its place and the number of frames before it."""
        place = self.place(len(episode))
        with self._av.open(io.BytesIO(episode)) as source:
            if self._writer is None:
                options = {"movflags": "faststart"}
                self._writer = self._av.open(
                    str(self._new_path()), "w", options=options
                )
                template = source.streams.video[0]
                self._stream = self._writer.add_stream_from_template(template)
                self._frames = 0
            first = self._frames
            for packet in source.demux(video=0):
                if packet.size:  # the last packet is an empty end mark
                    packet.stream = self._stream
                    packet.time_base = Fraction(1, self._fps)
                    packet.pts = packet.dts = self._frames
                    packet.duration = 1
                    self._writer.mux(packet)
                    self._frames += 1
        self._size += len(episode)
        return place, first


VERSION = "v3.0"
MEGABYTE = 1024**2  # LeRobot's
DATA_MB, VIDEO_MB = 100, 200  # largest files; LeRobot's defaults

Feature = dict[str, Any]

# Our own columns of an episode, in addition to LeRobot's, for filtering by trial.
TRIAL = {
    "trial": pa.int64(),
    "seed": pa.int64(),
    "success": pa.bool_(),
    "failure": pa.string(),  # the planner's reason; null for a success
    # The object's shape as the robot knows it; null if it is not a simple one.
    "object_size": pa.list_(pa.float64()),  # along its axes [m]
    "object_round": pa.bool_(),
}

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


# LeRobot's column for text that applies to several frames: here, the planner's mode as
# the subtask. Each frame has all rows of its episode, each with the time it begins.
LANGUAGE = "language_persistent"


def video_key(camera: str, depth: bool = False) -> str:
    """Return the name of the feature with a camera's color or depth images."""
    return f"observation.images.{camera}{'_depth' if depth else ''}"


def videos(layout: Layout) -> dict[str, tuple[str, bool]]:
    """Return the features with images: name to camera, and whether it is depth."""
    pairs = [(camera, False) for camera in layout.cameras]
    pairs += [(camera, True) for camera in layout.depths]
    return {video_key(camera, depth): (camera, depth) for camera, depth in pairs}


def make_features(
    layout: Layout, fps: int, names: Mapping[str, Sequence[str]] | None = None
) -> dict[str, Feature]:
    """Return the features of a data set, as in info.json.

    Args:
        layout: Layout of the recordings.
        fps: Frames per second.
        names: Names of dimensions by feature, which replace numbers in the layout.
    """
    features: dict[str, Feature] = {}
    for name, vectors in layout.vectors.items():
        own, count = (names or {}).get(name, ()), len(vectors.names)
        known = list(own if len(own) == count else vectors.names)
        features[name] = {"dtype": "float32", "shape": [count], "names": known}
        if vectors.units:
            features[name]["info"] = {"units": list(vectors.units)}
    for key, (camera, depth) in videos(layout).items():
        size, intrinsics = layout.cameras[camera], layout.intrinsics.get(camera)
        features[key] = _video(*size, fps, intrinsics, depth)
    if layout.modes:
        features[LANGUAGE] = {"dtype": "language", "shape": [1], "names": None}
    for name, dtype in _SCALARS.items():
        features[name] = {"dtype": dtype, "shape": [1], "names": None}
    return features


def _video(
    height: int,
    width: int,
    fps: int,
    intrinsics: Sequence[float] | None,
    depth: bool,
) -> Feature:
    encoding, channels = (DEPTH, 1) if depth else (COLOR, 3)
    info = {
        "video.height": height,
        "video.width": width,
        "video.codec": encoding.codec,
        "video.pix_fmt": encoding.pixels,
        "video.fps": fps,
        "video.channels": channels,
        "has_audio": False,
        "is_depth_map": depth,
    }
    if depth:
        info |= {  # in metres, linear
            "depth_unit": "mm",  # of statistics
            "video.depth_min": 0.0,
            "video.depth_max": DEPTH_MAX / 1000,
            "video.shift": 0.0,
            "video.use_log": False,
        }
    if intrinsics is not None:  # ours
        names = ("fx", "fy", "cx", "cy")
        info["intrinsics"] = dict(zip(names, intrinsics, strict=True))
    return {
        "dtype": "video",
        "shape": [height, width, channels],
        "names": ["height", "width", "channels"],
        "info": info,
    }


def make_info(
    features: Mapping[str, Feature], fps: int, robot: str, episodes: int, frames: int
) -> dict[str, Any]:
    """Return the content of info.json for a data set with one task."""
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


_LANGUAGE_ROW = pa.struct(
    [
        pa.field("role", pa.string(), nullable=False),
        pa.field("content", pa.string()),
        pa.field("style", pa.string()),
        pa.field("timestamp", pa.float32(), nullable=False),
        pa.field("camera", pa.string()),
        pa.field("tool_calls", pa.list_(pa.string())),
    ]
)


def subtask_rows(modes: Sequence[str], fps: int) -> list[dict[str, Any]]:
    """Return the rows of an episode's subtasks: one at each change of the mode."""
    return [
        {
            "role": "assistant",
            "content": mode,
            "style": "subtask",
            "timestamp": k / fps,
            "camera": None,
            "tool_calls": None,
        }
        for k, mode in enumerate(modes)
        if not k or mode != modes[k - 1]
    ]


def data_schema(features: Mapping[str, Feature]) -> pa.Schema:
    """Return the schema of frames."""
    return pa.schema(
        [(n, _column(f)) for n, f in features.items() if f["dtype"] != "video"]
    )


def _column(feature: Feature) -> pa.DataType:
    if feature["dtype"] == "language":
        return pa.list_(_LANGUAGE_ROW)
    kind, (size,) = _ARROW[feature["dtype"]], feature["shape"]
    return kind if size == 1 else pa.list_(kind, size)  # as LeRobot expects


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
        for statistic in STATISTICS if feature["dtype"] != "language" else ():
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

    The schema's metadata declare the index column; see
    https://pandas.pydata.org/docs/development/developer.html.
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
