"""Writes a LeRobot data set episode by episode."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from drake_srg.sweeps.dataset import format as fmt
from drake_srg.sweeps.dataset.files import ParquetFiles
from drake_srg.sweeps.dataset.recording import Image, Layout, Signals
from drake_srg.sweeps.dataset.statistics import (
    ImageStatistics,
    Statistics,
    column_statistics,
)
from drake_srg.sweeps.dataset.video import VideoFiles, encode_episode


class DatasetWriter:
    """Writes the files of a data set with one task.

    Use it as a context manager. The data set is complete after `finish`. However many
    episodes there are, only a few of them are in memory.

    Args:
        root: Folder to create.
        layout: Layout of all episodes.
        fps: Frames per second.
        task: The task in words.
        robot: The robot's type.
        data_limit: Largest size of a Parquet file [bytes].
        video_limit: Largest size of a video [bytes].
        episodes_at_once: Episodes whose metadata form one row group.

    Raises:
        ImportError: If PyAV is missing.
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
        data_limit: int = fmt.DATA_MB * fmt.MEGABYTE,
        video_limit: int = fmt.VIDEO_MB * fmt.MEGABYTE,
        episodes_at_once: int = 100,
    ):
        self._root, self._layout, self._fps = root, layout, fps
        self._task, self._robot = task, robot
        self._episodes_at_once = episodes_at_once
        self._features = fmt.make_features(layout, fps)
        self._data_schema = fmt.data_schema(self._features)
        self._episode_schema = fmt.episode_schema(self._features)
        self._data = ParquetFiles(root / "data", self._data_schema, data_limit)
        self._episodes = ParquetFiles(
            root / "meta" / "episodes", self._episode_schema, data_limit
        )
        self._videos = {
            camera: VideoFiles(
                root / "videos" / fmt.video_key(camera), fps, video_limit
            )
            for camera in layout.cameras
        }
        self._images = {camera: ImageStatistics() for camera in layout.cameras}
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
        images: Mapping[str, Iterator[Image]],
        about: Mapping[str, Any],
    ) -> None:
        """Add an episode.

        Args:
            signals: One row per frame.
            images: Camera name to its images, one per frame.
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
        for name in table.column_names:
            row |= _flat(name, column_statistics(table[name]))
        for camera, stream in images.items():
            row |= self._add_video(camera, stream, length)
        self._rows.append(row)
        self._count += 1
        self._frames += length
        if len(self._rows) == self._episodes_at_once:
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
            for name in self._data_schema.names
        }
        for camera, images in self._images.items():
            statistics[fmt.video_key(camera)] = images.statistics()
        _write_json(self._root / "meta" / "stats.json", statistics)
        pq.write_table(
            fmt.tasks_table([self._task]), self._root / "meta" / "tasks.parquet"
        )

    def _close(self) -> None:
        with contextlib.ExitStack() as stack:  # closes all, even if one fails
            stack.callback(self._data.close)
            stack.callback(self._episodes.close)
            for video in self._videos.values():
                stack.callback(video.close)

    def _table(self, signals: Signals, success: bool) -> pa.Table:
        length = len(signals.state)
        frame = np.arange(length)
        last = frame == length - 1
        columns = {
            "observation.state": _vectors(signals.state),
            "action": _vectors(signals.action),
            "next.done": last,
            "next.success": last & success,
            "timestamp": (frame / self._fps).astype(np.float32),
            "frame_index": frame,
            "episode_index": np.full(length, self._count),
            "index": self._frames + frame,
            "task_index": np.zeros(length, dtype=np.int64),
        }
        if self._layout.located:
            columns[fmt.SIGHTING_KEY] = _vectors(signals.sighting)
        return pa.table(columns, schema=self._data_schema)

    def _add_video(
        self, camera: str, images: Iterator[Image], length: int
    ) -> dict[str, Any]:
        """Add an episode's images from a camera; returns their metadata."""
        statistics = ImageStatistics()

        def counted() -> Iterator[Image]:
            for image in images:
                statistics.add(image)
                yield image

        episode, frames = encode_episode(counted(), self._fps)
        if frames != length:
            raise ValueError(f"{camera}: needs {length} images, got {frames}")
        self._images[camera].merge(statistics)
        place, first = self._videos[camera].append(episode)
        key = fmt.video_key(camera)
        return {
            f"videos/{key}/chunk_index": place.chunk,
            f"videos/{key}/file_index": place.file,
            f"videos/{key}/from_timestamp": first / self._fps,
            f"videos/{key}/to_timestamp": (first + length) / self._fps,
            **_flat(key, statistics.statistics()),
        }

    def _write_rows(self) -> None:
        """Write the metadata of episodes that wait for it."""
        if not self._rows:
            return
        rows, self._rows = self._rows, []
        size = pa.Table.from_pylist(rows, schema=self._episode_schema).nbytes
        place = self._episodes.place(size)
        for row in rows:
            row["meta/episodes/chunk_index"] = place.chunk
            row["meta/episodes/file_index"] = place.file
        self._episodes.append(pa.Table.from_pylist(rows, schema=self._episode_schema))


def _vectors(values: Any) -> pa.FixedSizeListArray:
    return pa.FixedSizeListArray.from_arrays(values.reshape(-1), values.shape[1])


def _flat(name: str, statistics: Statistics) -> dict[str, Any]:
    return {f"stats/{name}/{key}": value for key, value in statistics.items()}


def _write_json(path: Path, value: Any) -> None:
    path.write_text(json.dumps(value, indent=4) + "\n", encoding="utf-8")
