"""Pictures from a camera's messages: colour and depth of the same time."""

import dataclasses as dc
import threading
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from drake_srg.bridges.commands import CommandError
from drake_srg.bridges.trajectory_topics import seconds

# Conversions of 8-bit colour images to RGBA, by ROS encoding.
_COLORS = {
    "rgb8": cv2.COLOR_RGB2RGBA,
    "bgr8": cv2.COLOR_BGR2RGBA,
    "bgra8": cv2.COLOR_BGRA2RGBA,
    "rgba8": None,
}
_KEPT = 4  # unpaired images of each kind


@dc.dataclass(frozen=True, eq=False)
class Picture:
    """A colour and a depth image of the same time.

    Attributes:
        stamp: The time by the camera's clock [s].
        color: RGBA, shape (h, w, 4).
        depth: Depths as Drake has them [m], shape (h, w): 0 too close, inf too far.
    """

    stamp: float
    color: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.float32]


def color_pixels(message: Any, shape: tuple[int, int]) -> npt.NDArray[np.uint8]:
    """Return the RGBA pixels of a sensor_msgs/Image, shape (h, w, 4).

    Raises:
        CommandError: If it has another size or encoding.
    """
    if message.encoding not in _COLORS:
        allowed = ", ".join(_COLORS)
        raise CommandError(
            "encoding", f"encoding must be one of {allowed}; got {message.encoding!r}"
        )
    code = _COLORS[message.encoding]
    channels = 3 if message.encoding.endswith("8") and len(message.encoding) == 4 else 4
    pixels = _rows(message, shape, channels)
    return pixels if code is None else np.asarray(cv2.cvtColor(pixels, code))


def depth_pixels(message: Any, shape: tuple[int, int]) -> npt.NDArray[np.float32]:
    """Return the depths of a sensor_msgs/Image as Drake has them, shape (h, w) [m].

    ROS writes -inf (32FC1) for too close, +inf, NaN or 0 (16UC1, in mm) for unknown.

    Raises:
        CommandError: If it has another size or encoding.
    """
    if message.is_bigendian:
        raise CommandError("encoding", "must be little endian")
    if message.encoding == "32FC1":
        depth = _rows(message, shape, 4).view(np.float32)[..., 0].copy()
        depth[np.isnan(depth)] = np.inf
        depth[depth < 0.0] = 0.0
        return depth
    if message.encoding == "16UC1":
        counts = _rows(message, shape, 2).view("<u2")[..., 0]
        depth = 1e-3 * counts.astype(np.float32)
        depth[counts == 0] = np.inf
        return depth
    raise CommandError(
        "encoding", f"encoding must be 32FC1 or 16UC1; got {message.encoding!r}"
    )


def _rows(message: Any, shape: tuple[int, int], size: int) -> npt.NDArray[np.uint8]:
    """Return an image's bytes without padding, shape (h, w, size)."""
    height, width = shape
    if (message.height, message.width) != shape:
        raise CommandError(
            "size",
            f"must have {width} x {height} pixels, as the scenario's camera has, got "
            f"{message.width} x {message.height}",
        )
    data = np.frombuffer(np.asarray(message.data, dtype=np.uint8), dtype=np.uint8)
    if message.step < width * size or data.size != height * message.step:
        raise CommandError(
            "length",
            f"needs {height} rows of at least {width * size} bytes, got {data.size} "
            f"bytes in rows of {message.step}",
        )
    rows = data.reshape(height, message.step)[:, : width * size]
    return np.ascontiguousarray(rows).reshape(height, width, size)


class Album:
    """Pairs the images of a camera, and keeps the newest pair. Any thread may call.

    Args:
        shape: Height and width of the images [pixels].
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        self._shape = shape
        self._changed = threading.Condition()
        self._color: dict[float, npt.NDArray[np.uint8]] = {}
        self._depth: dict[float, npt.NDArray[np.float32]] = {}
        self._newest: Picture | None = None
        self._count = 0

    def add_color(self, message: Any) -> None:
        """Add a colour image; raises a CommandError if it is refused."""
        self._add(message, self._color, color_pixels(message, self._shape))

    def add_depth(self, message: Any) -> None:
        """Add a depth image; raises a CommandError if it is refused."""
        self._add(message, self._depth, depth_pixels(message, self._shape))

    @property
    def newest(self) -> Picture | None:
        """The newest picture, if there is one."""
        with self._changed:
            return self._newest

    def wait(self, after: float, patience: float) -> Picture | None:
        """Return the newest picture once it is newer than a time; None: none came.

        Args:
            after: By the camera's clock [s]; NaN: the robot tells no time. Then it is
                the second picture to arrive from now on, because the first may have
                been on its way.
            patience: How long to wait [s, real].
        """
        enough = self._count + 2

        def newer() -> bool:
            if np.isnan(after):
                return self._count >= enough
            return self._newest is not None and self._newest.stamp > after

        with self._changed:
            return self._newest if self._changed.wait_for(newer, patience) else None

    def _add(self, message: Any, images: dict[float, Any], pixels: Any) -> None:
        """Add an image to those of its kind, and keep the pair if that is newer."""
        stamp = seconds(message.header.stamp)
        with self._changed:
            images[stamp] = pixels
            while len(images) > _KEPT:
                del images[next(iter(images))]
            newer = self._newest is None or stamp > self._newest.stamp
            if newer and stamp in self._color and stamp in self._depth:
                self._count += 1
                self._newest = Picture(stamp, self._color[stamp], self._depth[stamp])
                self._changed.notify_all()
