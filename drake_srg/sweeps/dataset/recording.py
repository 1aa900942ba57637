"""Data of an episode, read from the recording of a trial."""

from __future__ import annotations

import contextlib
import dataclasses as dc
import itertools
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.recording.output import require
from drake_srg.recording.rosbag import OBJECT_POSE, topic_of
from drake_srg.scenario import RobotArm
from drake_srg.types import mode_words

Image = npt.NDArray[np.uint8]
DepthImage = npt.NDArray[np.uint16]

_JOINTS = "/joint_states"
_POSITION = "/{}/position_commanded"
_MODE = "/planner/mode"
_COLOR, _DEPTH = "/camera_{}/color/image_raw", "/camera_{}/depth/image_rect_raw"
_INFO, _POSE = "/camera_{}/color/camera_info", "/camera_{}/pose"
_WRENCH = "/contact_wrench/"

STATE, ACTION = "observation.state", "action"
# LeRobot's name for knowledge of the scene besides the robot's state. Its policies
# treat this vector separately (FeatureType.ENV).
SIGHTING = "observation.environment_state"
TOUCH, PWM = "observation.touch", "observation.motor_pwm"
# Optional features with numbers: topic of a hand to the feature's name and unit.
_NUMBERS = {
    "contact_force": (TOUCH, "N"),
    "grasped": ("observation.grasped", "1"),
    "pwm": (PWM, "1"),
    "motor_current": ("observation.motor_current", "A"),
    "motor_temperature": ("observation.motor_temperature", "degC"),
}

_POSE_NAMES = ("x", "y", "z", "qx", "qy", "qz", "qw")

# Stamps are off because simulated time adds up steps, and they are whole nanoseconds.
_STAMP_TOLERANCE = 1e-6  # s


@dc.dataclass(frozen=True)
class Vectors:
    """A feature with a vector per frame.

    Attributes:
        names: Names of its dimensions.
        units: Units of its dimensions; empty if unknown.
    """

    names: tuple[str, ...]
    units: tuple[str, ...] = ()


@dc.dataclass(frozen=True)
class Layout:
    """The layout that all recordings of a data set share.

    Attributes:
        vectors: Features with numbers, by name. `STATE` has the measured positions of
            an arm's joints, then of its gripper's [rad or m]. `ACTION` has the
            commanded positions of an arm's joints, then its gripper's closure (0 .. 1).
            Several arms follow one another. `SIGHTING` has the object's pose in world
            where the planner last saw it [m], and 1; before a sighting, all are 0.
        cameras: Camera name to (height, width) of its images [pixels], sorted.
        rate: Images per simulated second.
        depths: Names of the cameras with depth images, sorted.
        intrinsics: Camera name to focal lengths fx, fy and principal point cx, cy
            [pixels], counted from the centre of the first pixel, as in ROS.
        modes: Whether the recording has the planner's mode.
    """

    vectors: dict[str, Vectors]
    cameras: dict[str, tuple[int, int]]
    rate: Fraction
    depths: tuple[str, ...] = ()
    intrinsics: dict[str, tuple[float, ...]] = dc.field(default_factory=dict)
    modes: bool = False

    def __str__(self) -> str:
        """Return the layout in one line, for messages."""
        sizes = [f"{name} {w}x{h}" for name, (h, w) in self.cameras.items()]
        more = [n for n in self.vectors if n not in (STATE, ACTION, SIGHTING)]
        return (
            f"{', '.join(sizes)} at {float(self.rate):g} Hz, "
            f"{len(self.vectors[STATE].names)} joints, "
            f"{len(self.vectors[ACTION].names)} commands"
            f"{', object pose' if SIGHTING in self.vectors else ''}"
            f"{''.join(f', depth of {name}' for name in self.depths)}"
            f"{''.join(f', {name}' for name in more)}"
            f"{''.join(f', f = {f[0]:g} of {n}' for n, f in self.intrinsics.items())}"
        )


@dc.dataclass(frozen=True)
class Signals:
    """Measured and commanded values at the times of a recording's images.

    Attributes:
        layout: Names, cameras and rate.
        values: Values by feature of `Layout.vectors`, shape (K, n). Positions of joints
            are interpolated between the messages before and after the image; all
            others come from the last message up to the image.
        modes: The planner's mode at each image, in words; empty if unknown.
    """

    layout: Layout
    values: dict[str, npt.NDArray[np.float32]]
    modes: list[str] = dc.field(default_factory=list)

    def every(self, count: int) -> Signals:
        """Return every `count`-th row, from the first."""
        values = {name: rows[::count] for name, rows in self.values.items()}
        return dc.replace(self, values=values, modes=self.modes[::count])


def read_signals(path: Path) -> Signals:
    """Read everything except the images from a trial's recording.

    Args:
        path: A recording.mcap; see `drake_srg.recording.rosbag`.

    Raises:
        ScenarioError: If it cannot be read, lacks joints, commands or images, contains
            values that are not finite, or its images are not evenly spaced.
    """
    times: dict[str, list[float]] = {}
    values: dict[str, list[Any]] = {}
    joints: tuple[str, ...] = ()
    with _readable(path):
        topics = _topics(path)
        robots = _robots(topics)
        commands = [topic for robot in robots for topic in _commands(robot)]
        wanted = [_JOINTS, *commands, _MODE, OBJECT_POSE, "/camera_.+"]
        for robot in robots:
            hand = topic_of(robot.gripper_model)
            wanted += [f"{hand}/{name}" for name in _NUMBERS]
            wanted.append(f"{hand}{_WRENCH}.+")
        for topic, time, decode in _messages(path, "|".join(wanted)):
            times.setdefault(topic, []).append(time)
            if _owner(topic, _COLOR) or _owner(topic, _DEPTH):
                continue
            message = decode()
            values.setdefault(topic, []).append(_value(topic, message))
            if topic == _JOINTS:
                joints = tuple(message.name)
    for topic in (_JOINTS, *commands):
        if topic not in values:
            raise ScenarioError(f"{path}: contains no messages on {topic}")

    cameras = _owners(times, _COLOR)
    if not cameras:
        raise ScenarioError(
            f"{path}: contains no images; recording.bag_cameras must name a camera"
        )
    depths = _owners(times, _DEPTH)
    images = [_COLOR.format(name) for name in cameras]
    images += [_DEPTH.format(name) for name in depths]
    rate, image_times = _even_times(path, {topic: times[topic] for topic in images})

    def held(topic: str) -> npt.NDArray[Any]:
        return _held(image_times, times[topic], np.array(values[topic]))

    measured = np.array(values[_JOINTS])[:, 0]
    state = [np.interp(image_times, times[_JOINTS], q) for q in measured.T]
    action = [held(topic) for topic in commands]
    found = {
        STATE: (Vectors(joints), np.stack(state, axis=1)),
        ACTION: (Vectors(_command_names(joints, robots, action)), np.hstack(action)),
    }
    if OBJECT_POSE in topics:
        poses = [np.zeros(8), *values.get(OBJECT_POSE, [])]  # at first, no sighting
        seen = _held(image_times, [0.0, *times.get(OBJECT_POSE, [])], np.array(poses))
        found[SIGHTING] = Vectors((*_POSE_NAMES, "seen")), seen
    found |= _more(values, held, joints, robots)
    layout = Layout(
        {name: vectors for name, (vectors, _) in found.items()},
        {c: next(read_images(path, c)).shape[:2] for c in cameras},
        rate,
        depths,
        {
            name: tuple(values[_INFO.format(name)][0].tolist())
            for name in _owners(times, _INFO)
        },
        modes=_MODE in values,
    )
    return Signals(
        layout,
        {name: _float32(path, name, rows) for name, (_, rows) in found.items()},
        held(_MODE).tolist() if _MODE in values else [],
    )


def _command_names(
    joints: Sequence[str],
    robots: Sequence[RobotArm],
    action: Sequence[npt.NDArray[np.float64]],
) -> tuple[str, ...]:
    """Return the names of commanded values: positions and closure of each arm."""
    # The longest prefix counts, because an arm's name may begin with that of another.
    prefixes = [robot.system("") for robot in robots]
    arms = [
        max(filter(name.startswith, prefixes), key=len, default="") for name in joints
    ]
    names: list[str] = []
    for prefix, position in zip(prefixes, action[::2], strict=True):
        own = [name for name, arm in zip(joints, arms, strict=True) if arm == prefix]
        names += [*own[: position.shape[1]], f"{prefix}gripper_closure"]
    return tuple(names)


def _value(topic: str, message: Any) -> Any:
    """Return a message's content for a data set: an array, or the mode in words."""
    if topic == _JOINTS:
        return np.stack([message.position, message.effort])
    if topic == OBJECT_POSE or _owner(topic, _POSE):
        pose = _pose(message.pose)
        return np.append(pose, 1.0) if topic == OBJECT_POSE else pose
    if topic == _MODE:
        return mode_words(message.data)
    if _owner(topic, _INFO):
        return message.k[[0, 4, 2, 5]]
    if _WRENCH in topic:
        parts = message.wrench.torque, message.wrench.force
        return np.array([[part.x, part.y, part.z] for part in parts]).ravel()
    return np.atleast_1d(message.data)


def _more(
    values: Mapping[str, list[Any]],
    held: Callable[[str], npt.NDArray[Any]],
    joints: Sequence[str],
    robots: Sequence[RobotArm],
) -> dict[str, tuple[Vectors, npt.NDArray[Any]]]:
    """Return the optional features by name, and their values.

    Args:
        values: Values by topic, as from `_value`.
        held: Returns a topic's values at the times of the images.
        joints: Names of the joints.
        robots: The arms.
    """
    found = {}
    measured = np.isfinite(np.array(values[_JOINTS])[:, 1]).all(axis=0)
    if measured.any():
        felt = tuple(itertools.compress(joints, measured))
        efforts = Vectors(felt, ("N m",) * len(felt))
        found["observation.effort"] = efforts, held(_JOINTS)[:, 1, measured]
    hands = {robot: topic_of(robot.gripper_model) for robot in robots}
    for number, (feature, unit) in _NUMBERS.items():
        rows: list[npt.NDArray[Any]] = []
        names: tuple[str, ...] = ()
        for robot, hand in hands.items():
            if (topic := f"{hand}/{number}") in values:
                rows.append(held(topic))
                names += tuple(map(robot.system, map(str, range(rows[-1].shape[1]))))
        if names:
            found[feature] = Vectors(names, (unit,) * len(names)), np.hstack(rows)
    pose = Vectors(_POSE_NAMES, ("m",) * 3 + ("1",) * 4)
    for camera in _owners(values, _POSE):
        found[f"camera_pose.{camera}"] = pose, held(_POSE.format(camera))
    axes = ("tx", "ty", "tz", "fx", "fy", "fz")
    wrench = Vectors(axes, ("N m",) * 3 + ("N",) * 3)
    for robot, hand in hands.items():
        for link in _owners(values, f"{hand}{_WRENCH}{{}}"):
            feature = f"observation.contact_wrench.{robot.system(link)}"
            found[feature] = wrench, held(f"{hand}{_WRENCH}{link}")
    return found


_WORDS = {STATE: "joints", ACTION: "commands", SIGHTING: OBJECT_POSE}


def _float32(
    path: Path, feature: str, values: npt.NDArray[np.float64]
) -> npt.NDArray[np.float32]:
    """Return values as 32-bit floats; a ScenarioError unless all are finite."""
    with np.errstate(over="ignore"):
        single = values.astype(np.float32)
    if not np.isfinite(single).all():
        what = _WORDS.get(feature, feature)
        raise ScenarioError(f"{path}: {what}: values must be finite as 32-bit floats")
    return single


def read_images(path: Path, camera: str, every: int = 1) -> Iterator[Image]:
    """Yield the color images of a camera in order: RGB, shape (height, width, 3).

    Images are read one at a time, so memory does not grow with the recording. An odd
    last row or column is left out, because video needs even sizes.

    Args:
        path: A recording.mcap.
        camera: Name of the camera.
        every: Stride: 2 yields the first, third, fifth image and so on.
    """
    for message in _image_messages(path, _COLOR.format(camera), every):
        yield _even(message.data.reshape(message.height, message.width, 3))


def read_depths(path: Path, camera: str, every: int = 1) -> Iterator[DepthImage]:
    """Yield the depth images of a camera in order [mm], shape (height, width).

    0 means that there is no depth. See `read_images` for everything else.
    """
    for message in _image_messages(path, _DEPTH.format(camera), every):
        if message.encoding != "16UC1" or message.is_bigendian:
            raise ScenarioError(
                f"{path}: depth images of {camera} must be 16UC1 in little endian, got "
                f"{message.encoding}"
            )
        depth = message.data.view("<u2").reshape(message.height, message.width)
        yield _even(depth)


def _image_messages(path: Path, topic: str, every: int) -> Iterator[Any]:
    with _readable(path):
        messages = _messages(path, re.escape(topic))
        for _, _, decode in itertools.islice(messages, 0, None, every):
            yield decode()


def _even(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return an image without an odd last row or column."""
    height, width = image.shape[:2]
    return image[: height // 2 * 2, : width // 2 * 2]


def _pose(pose: Any) -> npt.NDArray[np.float64]:
    """Return x, y, z, qx, qy, qz, qw of a geometry_msgs/msg/Pose."""
    p, q = pose.position, pose.orientation
    return np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w])


def _topics(path: Path) -> list[str]:
    """Return the topics of a recording in order, including those without messages."""
    with require("rosbags.rosbag2").Reader(path) as reader:
        return [connection.topic for connection in reader.connections]


def _robots(topics: Iterable[str]) -> list[RobotArm]:
    """Return the arms of a recording, in order of their topics; at least one."""
    models = [model for topic in topics if (model := _owner(topic, _POSITION))]
    return [RobotArm("" if model == "arm" else model) for model in models or ["arm"]]


def _commands(robot: RobotArm) -> tuple[str, str]:
    """Return the topics of an arm's position and of its hand's closure."""
    hand = topic_of(robot.gripper_model)
    return _POSITION.format(robot.arm_model), f"{hand}/closure_commanded"


def _owner(topic: str, kind: str) -> str:
    """Return a topic's camera or link; "" if the topic is of another kind."""
    match = re.fullmatch(kind.format("(.+)"), topic)
    return match[1] if match else ""


def _owners(topics: Iterable[str], kind: str) -> tuple[str, ...]:
    """Return the cameras or links with a topic of a kind, sorted."""
    return tuple(sorted(name for topic in topics if (name := _owner(topic, kind))))


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

    For damaged files, rosbags raises ReaderError, SerdeError, ZstdError, ValueError,
    KeyError and others.
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
    """Return the rate of images [Hz], and their times [s]: multiples of the period."""
    first = next(iter(stamps.values()))
    rate = Fraction(1.0 / first[0]).limit_denominator(1000)
    times = np.arange(1, len(first) + 1) / float(rate)
    for topic, found in stamps.items():
        if len(found) != len(times) or np.abs(found - times).max() > _STAMP_TOLERANCE:
            raise ScenarioError(
                f"{path}: images on {topic} must be evenly spaced and at the times of "
                "the other images"
            )
    return rate, times


def _held(
    at: npt.NDArray[np.float64], times: list[float], values: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Return the latest value at each time; before the first value, the first one."""
    index = np.searchsorted(times, at + _STAMP_TOLERANCE, side="right") - 1
    return values[np.maximum(index, 0)]
