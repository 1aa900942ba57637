"""Reads what a recorded run has left in its folder."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence
from pathlib import Path

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.recording.log import read_log
from drake_srg.recording.run_timeline import Labels, run_timeline
from drake_srg.recording.timeline import Timeline
from drake_srg.replay.glb import EXTRAS, Json, read_glb


@dc.dataclass(frozen=True)
class RecordedRun:
    """A recorded run.

    Attributes:
        glb: The file replay.glb.
        document: Its JSON.
        binary: Its binary chunk.
        labels: The run's title, and names for its log.
        timeline: Modes and plots of its log.
        sights: What the planner looked at: `time` [s], `camera`, `image`, an index of
            `images`, and `blobs` if there is a localizer.
        images: JPEG files.
        video: Path of video.mp4; None if there is no video.
        video_start: Simulated time of its first frame [s].
    """

    glb: bytes
    document: Json
    binary: bytes
    labels: Labels
    timeline: Timeline
    sights: Sequence[Json]
    images: Sequence[bytes]
    video: Path | None
    video_start: float


def read_run(folder: Path) -> RecordedRun:
    """Read replay.glb and log.npz, and find video.mp4.

    Raises:
        ScenarioError: If a file is missing or cannot be read.
    """
    glb = _read(folder, "replay.glb")
    try:
        document, binary = read_glb(glb)
        extras = document["scenes"][0]["extras"][EXTRAS]
        labels = Labels(**extras["labels"])
        images = _images(document, binary)
        sights = list(extras["sights"])
        for sight in sights:
            images[sight["image"]]  # is there
        video_start = float(extras["video_start"])
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise ScenarioError(
            f"{folder / 'replay.glb'}: not the scene of a recorded run: "
            f"{one_line(error)}"
        ) from error
    _read(folder, "log.npz")
    try:
        timeline = run_timeline(read_log(folder / "log.npz"), labels)
    except (ValueError, KeyError, OSError) as error:
        raise ScenarioError(
            f"{folder / 'log.npz'}: not the log of a run: {one_line(error)}"
        ) from error
    video = folder / "video.mp4"
    return RecordedRun(
        glb=glb,
        document=document,
        binary=binary,
        labels=labels,
        timeline=timeline,
        sights=sights,
        images=images,
        video=video if video.is_file() else None,
        video_start=video_start,
    )


def _read(folder: Path, name: str) -> bytes:
    try:
        return (folder / name).read_bytes()
    except OSError as error:
        raise ScenarioError(
            f"{folder / name}: {error.strerror or error} "
            "(allowed: the folder of a run recorded without --no-record)"
        ) from error


def _images(document: Json, binary: bytes) -> list[bytes]:
    """Return the images of a GLB file, which are JPEG files."""
    views = (
        document["bufferViews"][i["bufferView"]] for i in document.get("images", [])
    )
    return [binary[view["byteOffset"] :][: view["byteLength"]] for view in views]
