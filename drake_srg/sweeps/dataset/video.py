"""Writes the videos of a data set: many episodes per file, fast random access."""

from __future__ import annotations

import io
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from drake_srg.recording.output import require
from drake_srg.sweeps.dataset.files import FilePlace, next_place
from drake_srg.sweeps.dataset.recording import Image

CODEC, PIXEL_FORMAT = "h264", "yuv420p"

_ENCODER = {
    "crf": "23",  # constant rate factor of x264, its own default
    "preset": "veryfast",
    # Every second frame is a key frame, as in LeRobot's own videos, because learning
    # reads frames in random order. Without B-frames, the file is in order of time.
    "g": "2",
    "bf": "0",
}
# ISO/IEC 23091-2 (and ffmpeg's AVCOL_*): ITU-R BT.601 in its limited range, to which
# RGB is converted below. Without the tags, players would guess by the image size.
_BT601, _LIMITED = 6, 1


def encode_episode(images: Iterable[Image], fps: int) -> tuple[bytes, int]:
    """Encode images as an MP4 file that starts with a key frame.

    Equal images give equal bytes.

    Args:
        images: RGB, shape (height, width, 3), with even height and width.
        fps: Frames per second.

    Returns:
        The file, and its number of frames.
    """
    av = require("av")
    file = io.BytesIO()
    frames = 0
    with av.open(file, "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=fps, options=_ENCODER)
        stream.pix_fmt = PIXEL_FORMAT
        codec = stream.codec_context
        codec.thread_count = 1  # the number of threads changes the bytes
        codec.colorspace, codec.color_range = _BT601, _LIMITED
        for image in images:
            if not frames:
                stream.height, stream.width = image.shape[:2]
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), "rgb24")
            frame.pts, frame.time_base = frames, Fraction(1, fps)
            container.mux(stream.encode(frame))
            frames += 1
        container.mux(stream.encode(None))
    return file.getvalue(), frames


class VideoFiles:
    """Joins a camera's encoded episodes into files of limited size.

    The last file is complete after `close`.

    Args:
        folder: Folder for chunk-000/file-000.mp4 and so on.
        fps: Frames per second.
        limit: Largest size of a file [bytes]; an episode beyond it gets its own file.

    Raises:
        ImportError: If PyAV is missing.
        OSError: If a file cannot be written.
    """

    def __init__(self, folder: Path, fps: int, limit: int):
        self._av = require("av")
        self._folder, self._fps, self._limit = folder, fps, limit
        self._place: FilePlace | None = None
        self._size = self._frames = 0
        self._container: Any = None
        self._stream: Any = None

    def append(self, episode: bytes) -> tuple[FilePlace, int]:
        """Append an episode; returns its place and the number of frames before it."""
        if self._place is None or self._size + len(episode) > self._limit:
            self.close()
            self._place = next_place(self._place)
            self._size = self._frames = 0
        first = self._frames
        with self._av.open(io.BytesIO(episode)) as source:
            if self._container is None:
                self._open(source.streams.video[0])
            for packet in source.demux(video=0):
                if packet.size:  # the last packet is an empty end mark
                    packet.stream = self._stream
                    packet.time_base = Fraction(1, self._fps)
                    packet.pts = packet.dts = self._frames
                    packet.duration = 1
                    self._container.mux(packet)
                    self._frames += 1
        self._size += len(episode)
        return self._place, first

    def close(self) -> None:
        """Complete the open file, if any."""
        container, self._container = self._container, None
        if container is not None:
            container.close()

    def _open(self, template: Any) -> None:
        assert self._place is not None
        path = self._place.path(self._folder, ".mp4")
        path.parent.mkdir(parents=True, exist_ok=True)
        self._container = self._av.open(
            str(path), "w", options={"movflags": "faststart"}
        )
        self._stream = self._container.add_stream_from_template(template)
