"""LeRobot data sets from the recordings of a sweep.

Each trial becomes an episode, and each image time a frame; see docs/dataset.md and, for
the format, `drake_srg.sweeps.dataset.format`.
"""

from __future__ import annotations

import contextlib
import dataclasses as dc
import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.status_line import StatusLine
from drake_srg.common.tables import read_json
from drake_srg.objects.models import known_shape
from drake_srg.scenario import Scenario, draw_scenario, robot_arms
from drake_srg.scenario.typed_yaml import parse_yaml
from drake_srg.sweeps.dataset import format as fmt
from drake_srg.sweeps.dataset.format import (
    ImageStatistics,
    ParquetFiles,
    Statistics,
    VideoFiles,
    column_statistics,
    encode_episode,
)
from drake_srg.sweeps.dataset.recording import (
    PWM,
    STATE,
    TOUCH,
    DepthImage,
    Image,
    Layout,
    Signals,
    read_depths,
    read_images,
    read_signals,
)
from drake_srg.sweeps.files import sync
from drake_srg.sweeps.info import SweepInfo, read_sweep
from drake_srg.sweeps.rows import read_rows
from drake_srg.types import Cylinder

# Number of episodes whose metadata form one row group.
_EPISODES_AT_ONCE = 100


class DatasetWriter:
    """Writes the files of a data set with one task.

    Use it as a context manager. The data set is complete after `finish`. Only a few
    episodes are in memory at a time.

    Args:
        root: Folder to create.
        layout: Layout of all episodes.
        fps: Frames per second.
        task: The task in words.
        robot: The robot's type.
        names: See `format.make_features`.

    Raises:
        OSError: If a file cannot be written.
    """

    def __init__(
        self,
        root: Path,
        layout: Layout,
        fps: int,
        *,
        task: str,
        robot: str,
        names: Mapping[str, Sequence[str]] | None = None,
    ):
        self._root, self._layout, self._fps = root, layout, fps
        self._task, self._robot = task, robot
        self._features = fmt.make_features(layout, fps, names)
        self._data_schema = fmt.data_schema(self._features)
        self._numbers = [n for n in self._data_schema.names if n != fmt.LANGUAGE]
        self._episode_schema = fmt.episode_schema(self._features)
        data_limit = fmt.DATA_MB * fmt.MEGABYTE
        video_limit = fmt.VIDEO_MB * fmt.MEGABYTE
        self._data = ParquetFiles(root / "data", self._data_schema, data_limit)
        self._episodes = ParquetFiles(
            root / "meta" / "episodes", self._episode_schema, data_limit
        )
        self._videos = {
            key: VideoFiles(root / "videos" / key, fps, video_limit)
            for key in fmt.videos(layout)
        }
        self._images = {
            key: ImageStatistics(depth)
            for key, (_, depth) in fmt.videos(layout).items()
        }
        self._rows: list[dict[str, Any]] = []
        self._count = 0
        self._frames = 0

    def __enter__(self) -> DatasetWriter:
        return self

    def __exit__(self, *error: object) -> None:
        self._close()

    @property
    def frames(self) -> int:
        """Number of frames added so far."""
        return self._frames

    def add(
        self,
        signals: Signals,
        images: Mapping[str, Iterator[Image | DepthImage]],
        about: Mapping[str, Any],
    ) -> None:
        """Add an episode.

        Args:
            signals: One row per frame.
            images: Images by feature of `format.videos`, one per frame.
            about: Values of the columns in `format.TRIAL`.
        """
        table = self._table(signals, about["success"])
        length = table.num_rows
        place = self._data.append(table)
        row = {
            "episode_index": self._count,
            "tasks": [self._task],
            "length": length,
            "data/chunk_index": place.chunk,
            "data/file_index": place.file,
            "dataset_from_index": self._frames,
            "dataset_to_index": self._frames + length,
            **about,
        }
        for name in self._numbers:
            row |= _flat(name, column_statistics(table[name]))
        for key, stream in images.items():
            row |= self._add_video(key, stream, length)
        self._rows.append(row)
        self._count += 1
        self._frames += length
        if len(self._rows) == _EPISODES_AT_ONCE:
            self._write_rows()

    def finish(self) -> None:
        """Complete the files, and write info.json, tasks and overall statistics."""
        self._write_rows()
        self._close()
        info = fmt.make_info(
            self._features, self._fps, self._robot, self._count, self._frames
        )
        _write_json(self._root / "meta" / "info.json", info)
        paths = sorted((self._root / "data").glob("*/*.parquet"))
        statistics = {  # one column at a time, to save memory
            name: column_statistics(
                pa.concat_tables(
                    pq.ParquetFile(path).read(columns=[name]) for path in paths
                )[name]
            )
            for name in self._numbers
        }
        for key, images in self._images.items():
            statistics[key] = images.statistics()
        _write_json(self._root / "meta" / "stats.json", statistics)
        pq.write_table(
            fmt.tasks_table([self._task]), self._root / "meta" / "tasks.parquet"
        )

    def _close(self) -> None:
        with contextlib.ExitStack() as stack:  # closes all files, even if one fails
            stack.callback(self._data.close)
            stack.callback(self._episodes.close)
            for video in self._videos.values():
                stack.callback(video.close)

    def _table(self, signals: Signals, success: bool) -> pa.Table:
        length = len(signals.values[STATE])
        frame = np.arange(length)
        last = frame == length - 1
        columns = {name: _vectors(rows) for name, rows in signals.values.items()}
        columns |= {
            "next.done": last,
            "next.success": last & success,
            "timestamp": (frame / self._fps).astype(np.float32),
            "frame_index": frame,
            "episode_index": np.full(length, self._count),
            "index": self._frames + frame,
            "task_index": np.zeros(length, dtype=np.int64),
        }
        if self._layout.modes:
            rows = fmt.subtask_rows(signals.modes, self._fps)
            columns[fmt.LANGUAGE] = [rows] * length
        return pa.table(columns, schema=self._data_schema)

    def _add_video(
        self, key: str, images: Iterator[Image | DepthImage], length: int
    ) -> dict[str, Any]:
        """Add an episode's images of one feature; return their metadata."""
        _, depth = fmt.videos(self._layout)[key]
        statistics = ImageStatistics(depth)

        def counted() -> Iterator[Image | DepthImage]:
            for image in images:
                shown = np.minimum(image, fmt.DEPTH_MAX) if depth else image
                statistics.add(shown)
                yield shown

        encoding = fmt.DEPTH if depth else fmt.COLOR
        episode, frames = encode_episode(counted(), self._fps, encoding)
        if frames != length:
            raise ValueError(f"{key}: needs {length} images, got {frames}")
        self._images[key].merge(statistics)
        place, first = self._videos[key].append(episode)
        return {
            f"videos/{key}/chunk_index": place.chunk,
            f"videos/{key}/file_index": place.file,
            f"videos/{key}/from_timestamp": first / self._fps,
            f"videos/{key}/to_timestamp": (first + length) / self._fps,
            **_flat(key, statistics.statistics()),
        }

    def _write_rows(self) -> None:
        """Write the metadata of the episodes added since the last call."""
        if not self._rows:
            return
        rows, self._rows = self._rows, []
        size = pa.Table.from_pylist(rows, schema=self._episode_schema).nbytes
        place = self._episodes.place(size)
        for row in rows:
            row["meta/episodes/chunk_index"] = place.chunk
            row["meta/episodes/file_index"] = place.file
        self._episodes.append(pa.Table.from_pylist(rows, schema=self._episode_schema))


def _vectors(values: Any) -> Any:
    flat, size = values.reshape(-1), values.shape[1]
    return flat if size == 1 else pa.FixedSizeListArray.from_arrays(flat, size)


def _flat(name: str, statistics: Statistics) -> dict[str, Any]:
    return {f"stats/{name}/{key}": value for key, value in statistics.items()}


def _write_json(path: Path, value: Any) -> None:
    path.write_text(json.dumps(value, indent=4) + "\n", encoding="utf-8")


_RECORDING, _METRICS = "recording.mcap", "metrics.json"


@dc.dataclass(frozen=True)
class Dataset:
    """A data set on disk.

    Attributes:
        path: Its folder.
        episodes: Number of episodes.
        successes: Number of successful episodes.
        frames: Number of frames.
        fps: Frames per second.
        left_out: Numbers of omitted recordings and the reasons, in words.
    """

    path: Path
    episodes: int
    successes: int
    frames: int
    fps: int
    left_out: str = ""


def make_dataset(
    sweep: Path,
    out: Path | None = None,
    *,
    fps: int | None = None,
    only_success: bool = False,
    progress: bool = False,
) -> Dataset:
    """Make a LeRobot data set from the recorded trials of a sweep.

    The folder appears under its name only when it is complete. The sweep may still be
    running; its finished trials are included.

    Args:
        sweep: Folder of a sweep that ran with `--record all` or `failures`.
        out: Folder to create; None: `dataset` in the sweep's folder.
        fps: Frames per second, a divisor of the image rate; None: every image.
        only_success: Whether to leave out trials that failed.
        progress: Whether to show progress on standard error.

    Raises:
        OSError: If `out` cannot be written.
        ScenarioError: If there are no recordings of finished trials, recordings differ
            in their layout, rows cannot be read, `fps` does not fit, or `out` exists.
    """
    out = sweep / "dataset" if out is None else out
    if out.exists():
        raise ScenarioError(f"-o {out}: already exists; remove it or choose another")
    info = read_sweep(sweep)
    task, robot = _task_and_robot(info, sweep)
    trials, left_out = _recorded_trials(sweep, only_success)
    layout = read_signals(trials[0] / _RECORDING).layout
    fps = _whole_rate(layout.rate) if fps is None else fps
    every = _stride(layout.rate, fps)
    out.parent.mkdir(parents=True, exist_ok=True)
    successes = 0
    with tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent) as folder:
        root = Path(folder) / out.name
        names = _finger_names(_scenario(info, int(trials[0].name)))
        with DatasetWriter(
            root, layout, fps, task=task, robot=robot, names=names
        ) as writer:
            with StatusLine(shown=progress) as line:
                for number, trial in enumerate(trials, 1):
                    about = {**_metrics(trial), **_known_object(info, int(trial.name))}
                    successes += about["success"]
                    _add_trial(writer, trial, layout, every, about)
                    line.count(number, len(trials), "episodes")
            writer.finish()
        for path in (*root.rglob("*"), root):  # complete on disk before the rename
            sync(path)
        root.rename(out)
    return Dataset(out, len(trials), successes, writer.frames, fps, left_out)


def _add_trial(
    writer: DatasetWriter,
    trial: Path,
    layout: Layout,
    every: int,
    about: Mapping[str, Any],
) -> None:
    """Add the trial in a folder; `about` has its columns of `TRIAL` except `trial`."""
    signals = read_signals(trial / _RECORDING)
    if signals.layout != layout:
        raise ScenarioError(
            f"{trial}: all recordings of a data set must have the same layout: got "
            f"{signals.layout}, expected {layout}"
        )
    writer.add(
        signals.every(every),
        {
            key: (read_depths if depth else read_images)(
                trial / _RECORDING, camera, every
            )
            for key, (camera, depth) in fmt.videos(layout).items()
        },
        about={"trial": int(trial.name), **about},
    )


def _scenario(info: SweepInfo, trial: int) -> Scenario | None:
    """Return a trial's scenario; None if it has no objects (it may follow a script)."""
    tree = parse_yaml(info.tree, info.scenario)
    if not (tree.get("objects") or tree.get("clutter")):
        return None
    return draw_scenario(tree, info.scenario, info.seed + trial).scenario


def _finger_names(scenario: Scenario | None) -> dict[str, list[str]]:
    """Return the dimensions of features with one number per link or joint of a hand."""
    names: dict[str, list[str]] = {TOUCH: [], PWM: []}
    for robot in [] if scenario is None else robot_arms(scenario):
        if robot.gripper is not None:
            names[TOUCH] += map(robot.system, robot.gripper.sensor_names)
            names[PWM] += map(robot.system, robot.gripper.joint_names)
    return names


def _known_object(info: SweepInfo, trial: int) -> dict[str, Any]:
    """Return the columns of `format.TRIAL` about the picked object's shape."""
    unknown = {"object_size": None, "object_round": None}
    scenario = _scenario(info, trial)
    if scenario is None:
        return unknown
    config = scenario.objects.get(scenario.task.pick)
    shape = None if config is None else known_shape(scenario.task.pick, config)
    if shape is None:
        return unknown
    return {
        "object_size": [float(x) for x in shape.bounding_size],
        "object_round": isinstance(shape, Cylinder),
    }


def _task_and_robot(info: SweepInfo, sweep: Path) -> tuple[str, str]:
    """Return the task in words and the scenario's name."""
    name = Path(info.scenario).stem
    task = parse_yaml(info.tree, str(sweep)).get("task") or {}
    if not task.get("pick"):
        return f"Follow the script of {name}.", name
    pick = task["pick"].replace("_", " ")
    return f"Pick up the {pick} and place it on its goal.", name


def _recorded_trials(sweep: Path, only_success: bool) -> tuple[list[Path], str]:
    """Return the folders of recordings in order, and the omitted ones in words.

    A trial's recording is written before its row, so recordings of trials with a row
    are complete even while the sweep runs.
    """
    finished = set(read_rows(sweep)["trial"].to_pylist())
    folders = sorted((sweep / "recordings").glob("[0-9]*[0-9]"))
    # No copies that somebody made.
    folders = [folder for folder in folders if folder.name.isdecimal()]
    ended = [folder for folder in folders if int(folder.name) in finished]
    trials = [  # metrics.json is written last, and not after an error
        folder
        for folder in ended
        if (folder / _RECORDING).exists() and (folder / _METRICS).exists()
    ]
    counts = {
        "that ended in an error": len(ended) - len(trials),
        "unfinished": len(folders) - len(ended),
    }
    left_out = ", ".join(f"{n} {what}" for what, n in counts.items() if n)
    if not trials:
        raise ScenarioError(
            f"{sweep}: contains no recordings of finished trials ({left_out})"
            if left_out
            else f"{sweep}: contains no recordings; sweep with --record all"
        )
    if only_success:
        trials = [folder for folder in trials if _metrics(folder)["success"]]
        if not trials:
            raise ScenarioError(f"{sweep}: --only-success: no recorded trial succeeded")
    return trials, left_out


def _metrics(trial: Path) -> dict[str, Any]:
    path = trial / _METRICS
    keys = ("seed", "success", "failure")
    return read_json(path, lambda metrics: {key: metrics[key] for key in keys})


def _whole_rate(rate: Fraction) -> int:
    if rate.denominator != 1:
        raise ScenarioError(
            f"images are recorded at {float(rate):g} Hz, but a data set needs a whole "
            f"number of frames per second; {_allowed(rate)}"
        )
    return rate.numerator


def _stride(rate: Fraction, fps: int) -> int:
    """Return the number of images per frame."""
    if fps < 1 or (rate / fps).denominator != 1:
        raise ScenarioError(
            f"--fps {fps}: must divide the image rate, {float(rate):g} Hz; "
            f"{_allowed(rate)}"
        )
    return (rate / fps).numerator


def _allowed(rate: Fraction) -> str:
    fitting = [f for f in range(1, int(rate) + 1) if (rate / f).denominator == 1]
    if fitting:
        return f"allowed for --fps: {', '.join(map(str, fitting))}"
    return "record with a recording.bag_camera_period of 1, 1/2, 1/3 ... s"
