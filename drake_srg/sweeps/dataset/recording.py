"""Reads what a data set needs from the recording of a trial."""

from __future__ import annotations

import contextlib
import dataclasses as dc
import re
from collections.abc import Callable, Iterator, Mapping
from fractions import Fraction
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.recording.output import require
from drake_srg.recording.rosbag import OBJECT_POSE

Image = npt.NDArray[np.uint8]

_JOINTS = "/joint_states"
_ARM = "/arm/position_commanded"
_CLOSURE = "/gripper/closure_commanded"
_CAMERA = "/camera_(.+)/color/image_raw"

# Place where the object was last seen in world [m], and whether it has been seen:
# without a sighting, all are 0. No rotation has a quaternion of zeros.
SIGHTING = ("x", "y", "z", "qx", "qy", "qz", "qw", "seen")

# Simulated time adds up steps, and stamps are whole nanoseconds.
_STAMP_TOLERANCE = 1e-6  # s


@dc.dataclass(frozen=True)
class Layout:
    """The layout that all recordings of a data set share.

    Attributes:
        joints: Names of the measured joints, arm first.
        commands: Names of the commanded values: the arm's joints, then the gripper.
        cameras: Camera name to (height, width) of its images [pixels], sorted.
        rate: Images per simulated second.
        located: Whether the planner locates an object: `SIGHTING` is known.
    """

    joints: tuple[str, ...]
    commands: tuple[str, ...]
    cameras: dict[str, tuple[int, int]]
    rate: Fraction
    located: bool = False

    def __str__(self) -> str:
        """Return the layout in one line, for messages."""
        sizes = [f"{name} {w}x{h}" for name, (h, w) in self.cameras.items()]
        return (
            f"{', '.join(sizes)} at {float(self.rate):g} Hz, "
            f"{len(self.joints)} joints, {len(self.commands)} commands"
            f"{', object pose' if self.located else ''}"
        )


@dc.dataclass(frozen=True)
class Signals:
    """Measured and commanded values at the times of a recording's images.

    Attributes:
        layout: Names, cameras and rate.
        state: Measured joint positions [rad or m], shape (K, joints), interpolated
            between the messages before and after the image.
        action: Commanded joint positions [rad or m] and closure (0 .. 1), shape
            (K, commands), from the last message up to the image.
        sighting: `SIGHTING`, shape (K, 8), from the last message up to the image; (K,
            0) if no object is located.
    """

    layout: Layout
    state: npt.NDArray[np.float32]
    action: npt.NDArray[np.float32]
    sighting: npt.NDArray[np.float32]

    def every(self, count: int) -> Signals:
        """Return every `count`-th row, from the first."""
        values = (self.state, self.action, self.sighting)
        return Signals(self.layout, *(rows[::count] for rows in values))


def read_signals(path: Path) -> Signals:
    """Read everything except the images from a trial's recording.

    Args:
        path: A recording.mcap; see `drake_srg.recording.rosbag`.

    Raises:
        ImportError: If rosbags is missing.
        ScenarioError: If it cannot be read, lacks joints, commands or images, contains
            values that are not finite, or its images are not evenly spaced.
    """
    times: dict[str, list[float]] = {}
    values: dict[str, list[Any]] = {_JOINTS: [], _ARM: [], _CLOSURE: []}
    sightings = [np.zeros(len(SIGHTING))]  # nothing is seen at first
    joints: tuple[str, ...] = ()
    with _readable(path):
        located = OBJECT_POSE in _topics(path)
        wanted = "|".join([*values, OBJECT_POSE, _CAMERA])
        for topic, time, decode in _messages(path, wanted):
            times.setdefault(topic, []).append(time)
            if topic == _JOINTS:
                message = decode()
                joints = tuple(message.name)
                values[topic].append(message.position)
            elif topic == OBJECT_POSE:
                sightings.append(_sighting(decode().pose))
            elif topic in values:  # not an image
                values[topic].append(np.atleast_1d(decode().data))
    for topic, rows in values.items():
        if not rows:
            raise ScenarioError(f"{path}: contains no messages on {topic}")

    cameras = sorted(
        match[1] for topic in times if (match := re.fullmatch(_CAMERA, topic))
    )
    if not cameras:
        raise ScenarioError(
            f"{path}: contains no images; recording.bag_cameras must name a camera"
        )
    rate, image_times = _even_times(path, {c: times[_topic(c)] for c in cameras})
    sizes = {c: next(read_images(path, c)).shape[:2] for c in cameras}

    measured, arm = np.array(values[_JOINTS]), np.array(values[_ARM])
    state = [np.interp(image_times, times[_JOINTS], q) for q in measured.T]
    action = [
        _held(image_times, times[_ARM], arm),
        _held(image_times, times[_CLOSURE], np.array(values[_CLOSURE])),
    ]
    commands = (*joints[: arm.shape[1]], "gripper_closure")
    seen = _held(image_times, [0.0, *times.get(OBJECT_POSE, [])], np.array(sightings))
    return Signals(
        Layout(joints, commands, sizes, rate, located),
        _float32(path, "joints", np.stack(state, axis=1)),
        _float32(path, "commands", np.hstack(action)),
        _float32(path, OBJECT_POSE, seen if located else seen[:, :0]),
    )


def _float32(
    path: Path, what: str, values: npt.NDArray[np.float64]
) -> npt.NDArray[np.float32]:
    """Return values as 32-bit floats; a ScenarioError unless all are finite."""
    with np.errstate(over="ignore"):
        single = values.astype(np.float32)
    if not np.isfinite(single).all():
        raise ScenarioError(f"{path}: {what}: values must be finite as 32-bit floats")
    return single


def read_images(path: Path, camera: str, every: int = 1) -> Iterator[Image]:
    """Yield the color images of a camera in order: RGB, shape (height, width, 3).

    Images are read one at a time, so memory does not grow with the recording. An odd
    last row or column is left out, because video needs even sizes.

    Args:
        path: A recording.mcap.
        camera: Name of the camera.
        every: Yield the first image, and then every image that is so many further on.
    """
    with _readable(path):
        messages = _messages(path, re.escape(_topic(camera)))
        for _, _, decode in islice(messages, 0, None, every):
            message = decode()
            height, width = message.height, message.width
            image = message.data.reshape(height, width, 3)
            yield image[: height // 2 * 2, : width // 2 * 2]


def _sighting(pose: Any) -> npt.NDArray[np.float64]:
    """Return `SIGHTING` of a geometry_msgs/msg/Pose."""
    p, q = pose.position, pose.orientation
    return np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w, 1.0])


def _topics(path: Path) -> set[str]:
    """Return the topics of a recording, also those without messages."""
    with require("rosbags.rosbag2").Reader(path) as reader:
        return {connection.topic for connection in reader.connections}


def _topic(camera: str) -> str:
    return f"/camera_{camera}/color/image_raw"


def _messages(
    path: Path, topics: str
) -> Iterator[tuple[str, float, Callable[[], Any]]]:
    """Yield topic, time [s] and decoder of all messages on matching topics."""
    rosbag2, typesys = require("rosbags.rosbag2"), require("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    with rosbag2.Reader(path) as reader:
        chosen = [c for c in reader.connections if re.fullmatch(topics, c.topic)]
        # Without connections, messages() would yield the messages of all topics.
        for connection, time, raw in reader.messages(chosen) if chosen else ():
            decode = partial(store.deserialize_cdr, raw, connection.msgtype)
            yield connection.topic, time * 1e-9, decode


@contextlib.contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Raise a ScenarioError if a recording is damaged.

    rosbags raises exceptions of any kind then: ReaderError, SerdeError, ZstdError,
    ValueError, KeyError and others.
    """
    try:
        yield
    except (ImportError, ScenarioError):
        raise
    except Exception as error:
        raise ScenarioError(f"{path}: cannot be read: {one_line(error)}") from error


def _even_times(
    path: Path, stamps: Mapping[str, list[float]]
) -> tuple[Fraction, npt.NDArray[np.float64]]:
    """Return images per second, and their times [s]: multiples of the period."""
    first = next(iter(stamps.values()))
    rate = Fraction(1.0 / first[0]).limit_denominator(1000)
    times = np.arange(1, len(first) + 1) / float(rate)
    for camera, found in stamps.items():
        if len(found) != len(times) or np.abs(found - times).max() > _STAMP_TOLERANCE:
            raise ScenarioError(
                f"{path}: images of camera {camera} must be evenly spaced and at the "
                "times of the other cameras' images"
            )
    return rate, times


def _held(
    at: npt.NDArray[np.float64], times: list[float], values: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Return the last value up to each time; before the first value, the first."""
    index = np.searchsorted(times, at + _STAMP_TOLERANCE, side="right") - 1
    return values[np.maximum(index, 0)]
