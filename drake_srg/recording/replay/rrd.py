"""Writes replay.rrd: a recorded run for the Rerun viewer."""

from __future__ import annotations

import functools
import hashlib
import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.common.installing import require
from drake_srg.recording.output import OutputFile
from drake_srg.recording.replay.glb import Node, Part, Track, read_nodes
from drake_srg.recording.replay.page import RecordedRun, read_run
from drake_srg.types import Vector

_TIME = "time"  # the timeline: simulated time
_SCENE, _PLOTS, _SIGHTS, _MODES, _VIDEO = "scene", "plots", "seen", "planner", "video"
_FRUSTUM = 0.15  # length of a camera's pyramid [m]
# Rerun's names of a node's properties.
_POSE = {"translation": "translation", "rotation": "quaternion", "scale": "scale"}


def write_rrd(folder: Path) -> Path:
    """Write replay.rrd into a folder with the recording of a run.

    It has the scene, plots, modes, the localizer's images and, if there is one, the
    video, on one timeline of simulated time, and a layout of views.

    Returns:
        The path of the file.

    Raises:
        ImportError: If rerun-sdk is missing; the message says how to install it.
        ScenarioError: If a file of the recording is missing or cannot be read.
        OSError: If the file cannot be written.
    """
    rr = require("rerun", "rerun", "--rrd (a download of 170 MB) needs")
    run = read_run(folder)
    try:
        nodes = read_nodes(run.document, run.binary)
    except ValueError as error:
        raise ScenarioError(f"{folder / 'replay.glb'}: {error}") from error
    output = OutputFile(folder / "replay.rrd")
    # The id depends on the recording, so a viewer shows it once.
    identity = hashlib.sha256(run.glb).hexdigest()[:16]
    stream = rr.RecordingStream("drake_srg", recording_id=identity)
    stream.send_recording_name(run.labels.title)
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    stream.save(output.path, default_blueprint=_layout(run))
    _Writer(rr, stream).write(run, nodes)
    stream.disconnect()  # writes the rest
    return output.commit()


def at_times(track: Track, time: Vector) -> Vector:
    """Return a track's value at or before each time, shape (K, n)."""
    rows = np.searchsorted(track.time, time + 1e-9, side="right") - 1
    values: Vector = track.values[np.maximum(rows, 0)]
    return values


def track_times(node: Node) -> Vector:
    """Return the times at which anything of a node changes, shape (K,) [s]."""
    times = [track.time for track in node.tracks.values()]
    return functools.reduce(np.union1d, times, np.zeros(0))


def entity(*parts: str) -> str:
    """Return Rerun's path of an entity; a part may hold any character."""
    import rerun

    return str(rerun.new_entity_path(list(parts)))


class _Writer:
    """Logs the parts of a run to a stream."""

    def __init__(self, rr: Any, stream: Any) -> None:
        self._rr, self._stream = rr, stream

    def write(self, run: RecordedRun, nodes: Sequence[Node]) -> None:
        rr = self._rr
        up = rr.ViewCoordinates.RIGHT_HAND_Z_UP
        self._stream.log(_SCENE, up, static=True)
        for node in nodes:
            self._write_node(node)
        self._write_plots(run)
        for sight in run.sights:
            self._stream.set_time(_TIME, duration=sight["time"])
            self._stream.log(
                entity(_SIGHTS, sight["camera"]),
                rr.EncodedImage(
                    contents=run.images[sight["image"]], media_type="image/jpeg"
                ),
            )
        if run.video is not None:
            self._write_video(run.video, run.video_start)

    def _write_node(self, node: Node) -> None:
        rr, path = self._rr, entity(_SCENE, node.name)
        time = track_times(node)
        pose = {
            _POSE[key]: at_times(track, time)
            for key, track in node.tracks.items()
            if key in _POSE
        }
        if pose:
            columns = rr.Transform3D.columns(**pose)
            self._stream.send_columns(path, [self._times(time)], columns)
        for number, part in enumerate(node.parts):
            surface = part.surface
            look = {"triangle_indices": surface.faces, "albedo_factor": part.color}
            if part.targets and "weights" in node.tracks:
                # A static component would hide the shapes over time.
                self._write_shapes(f"{path}/{number}", part, node.tracks["weights"])
            else:
                look["vertex_positions"] = surface.points
                look["vertex_normals"] = surface.normals
            mesh = rr.Mesh3D.from_fields(**look)
            self._stream.log(f"{path}/{number}", mesh, static=True)
        if node.camera is not None:
            pinhole = rr.Pinhole(
                fov_y=node.camera["yfov"],
                aspect_ratio=node.camera["aspectRatio"],
                camera_xyz=rr.ViewCoordinates.RUB,  # glTF's
                image_plane_distance=_FRUSTUM,
            )
            self._stream.log(path, pinhole, static=True)

    def _write_shapes(self, path: str, part: Part, weights: Track) -> None:
        """Write the shapes that a soft part morphs into."""
        points = part.surface.points + np.tensordot(
            weights.values, np.array(part.targets), axes=1
        )
        columns = self._rr.Mesh3D.columns(vertex_positions=points.reshape(-1, 3))
        columns = columns.partition([points.shape[1]] * len(points))
        self._stream.send_columns(path, [self._times(weights.time)], columns)

    def _write_plots(self, run: RecordedRun) -> None:
        rr, time, modes = self._rr, run.timeline.time, run.timeline.mode
        for label, values, names in run.timeline.panels:
            path = entity(_PLOTS, label.replace("\n", " "))
            if names:
                self._stream.log(path, rr.SeriesLines(names=names), static=True)
            count = values.shape[1]
            columns = rr.Scalars.columns(scalars=values.ravel())
            columns = columns.partition([count] * len(values))
            self._stream.send_columns(path, [self._times(time)], columns)
        changes = (a != b for a, b in itertools.pairwise(["", *modes]))
        for when, mode in itertools.compress(zip(time, modes, strict=False), changes):
            self._stream.set_time(_TIME, duration=float(when))
            self._stream.log(_MODES, rr.TextLog(mode.replace("_", " ")))

    def _write_video(self, path: Path, start: float) -> None:
        rr, video = self._rr, self._rr.AssetVideo(path=path)
        try:
            shown = video.read_frame_timestamps_nanos()
        except RuntimeError as error:
            raise ScenarioError(f"{path}: not a video: {one_line(error)}") from error
        self._stream.log(_VIDEO, video, static=True)
        columns = rr.VideoFrameReference.columns_nanos(shown)
        times = self._times(start + 1e-9 * np.asarray(shown))
        self._stream.send_columns(_VIDEO, [times], columns)

    def _times(self, time: Vector) -> Any:
        return self._rr.TimeColumn(_TIME, duration=np.asarray(time, dtype=float))


def _layout(run: RecordedRun) -> Any:
    """Return the views: the scene and pictures on the left, plots on the right."""
    import rerun.blueprint as rrb

    cameras = sorted({sight["camera"] for sight in run.sights})
    pictures = [rrb.Spatial2DView(origin=entity(_SIGHTS, c), name=c) for c in cameras]
    if run.video is not None:
        pictures.insert(0, rrb.Spatial2DView(origin=_VIDEO, name="video"))
    labels = [label.replace("\n", " ") for label, _, _ in run.timeline.panels]
    plots = [
        rrb.TimeSeriesView(origin=entity(_PLOTS, label), name=label) for label in labels
    ]
    left = [rrb.Spatial3DView(origin=_SCENE, name=run.labels.title)]
    if pictures:
        left.append(rrb.Horizontal(*pictures))
    modes = rrb.TextLogView(origin=_MODES, name="planner")
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(*left, row_shares=[2, 1][: len(left)]),
            rrb.Vertical(modes, *plots),
            column_shares=[2, 1],
        ),
        collapse_panels=True,
    )
