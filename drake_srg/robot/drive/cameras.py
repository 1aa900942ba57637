"""Drivers of cameras that speak ROS, and a system that outputs their pictures."""

import abc
import dataclasses as dc
import threading
from typing import Any, ClassVar

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, ValueProducer
from pydrake.systems.sensors import CameraInfo, ImageDepth32F, ImageRgba8U

from drake_srg.common.exceptions import ScenarioError
from drake_srg.config import Config, positive
from drake_srg.lifetime import LeafSystem, weak
from drake_srg.robot.drive.link import Robot
from drake_srg.robot.serve.commands import CommandError, seconds
from drake_srg.robot.serve.pictures import CAMERA_INFO, COLOR, DEPTH
from drake_srg.vision.camera import DRAKE_PIXEL_CENTER, calibrated_model

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
    """A colour and a depth image with the same time stamp.

    Attributes:
        stamp: Their time by the camera's clock [s].
        color: RGBA, shape (h, w, 4).
        depth: Depths as in Drake's images [m], shape (h, w): 0 too close, inf too far.
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
    channels = len(message.encoding.removesuffix("8"))  # a letter for each
    pixels = _rows(message, shape, channels)
    return pixels if code is None else np.asarray(cv2.cvtColor(pixels, code))


def depth_pixels(message: Any, shape: tuple[int, int]) -> npt.NDArray[np.float32]:
    """Return the depths of a sensor_msgs/Image as in Drake's, shape (h, w) [m].

    In ROS, -inf (32FC1) means too close, and +inf, NaN or 0 (16UC1, in mm) unknown.

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
    """Pairs the images of a camera, and keeps the newest pair. It is thread-safe.

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
        """Wait for a picture that is newer than a time; return None if none arrives.

        Args:
            after: The time by the camera's clock [s]; NaN: the robot's time is unknown.
                Then wait for the second picture from now on, because the first may have
                been on its way already.
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
        """Add an image, and keep its pair if that is complete and newer."""
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


_IMAGE, _INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
# A camera's own intrinsics may differ this much from the scenario's [pixels].
_INTRINSICS = 2.0


class Camera(abc.ABC):
    """A live connection to a camera."""

    @abc.abstractmethod
    def picture(self, after: float, patience: float | None = None) -> Picture:
        """Wait for a picture that is newer than a time, and return it.

        Args:
            after: The time by the robot's clock [s].
            patience: How long to wait [s, real]; None: as configured.

        Raises:
            ScenarioError: If no picture arrives.
        """

    @abc.abstractmethod
    def newest(self) -> Picture | None:
        """Return the newest picture at once, if there is one.

        Raises:
            ScenarioError: If the camera's intrinsics are not the scenario's.
        """


@dc.dataclass(kw_only=True)
class RosCamera(Config):
    """A colour and depth camera with aligned images of the same time stamp."""

    version: ClassVar[int]

    # Topics of the images (sensor_msgs/Image: rgb8, bgr8, rgba8 or bgra8; 32FC1 [m] or
    # 16UC1 [mm]) and of the intrinsics (sensor_msgs/CameraInfo; empty: not checked).
    color: str = COLOR
    depth: str = DEPTH
    info: str = CAMERA_INFO
    # Time to wait for a picture from after the localizer asks for one [s].
    patience: float = dc.field(default=10.0, metadata=positive())

    def connect(self, name: str, robot: Robot) -> Camera:
        """Return a link to the camera."""
        return _RosCamera(self, name, robot)


class Ros1Camera(RosCamera):
    """A camera that speaks ROS 1."""

    version = 1


class Ros2Camera(RosCamera):
    """A camera that speaks ROS 2."""

    version = 2


class _RosCamera(Camera):
    def __init__(self, config: RosCamera, name: str, robot: Robot) -> None:
        self._config, self._name = config, name
        scenario = robot.scenario
        model = calibrated_model(
            scenario.cameras[name], scenario.camera_calibrations.get(name)
        )
        self._expected = model.color
        shape = (model.color.height(), model.color.width())
        self._album = Album(shape)
        self._misfit = ""
        node, largest = robot.nodes.of(config.version), 8 * shape[0] * shape[1] + 1024
        node.subscribe(config.color, _IMAGE, self._album.add_color, largest)
        node.subscribe(config.depth, _IMAGE, self._album.add_depth, largest)
        if config.info:
            node.subscribe(config.info, _INFO, self._check_info)

    def picture(self, after: float, patience: float | None = None) -> Picture:
        config = self._config
        patience = patience or config.patience
        found = self._album.wait(after, patience)
        self._check()
        if found is None:
            raise ScenarioError(
                f"cameras.{self._name}: no picture newer than {after:.2f} s arrived "
                f"within {patience:g} s on {config.color} and {config.depth}; "
                "camera and joint states need one clock"
            )
        return found

    def newest(self) -> Picture | None:
        self._check()
        return self._album.newest

    def _check(self) -> None:
        if self._misfit:
            raise ScenarioError(f"cameras.{self._name}: {self._misfit}")

    def _check_info(self, message: Any) -> None:
        # ROS 1 calls the matrix K, and so does rosbags.
        matrix = message.K if hasattr(message, "K") else message.k
        fx, _, cx, _, fy, cy, *_ = np.array(matrix, dtype=float)
        given = np.array([fx, fy, cx + DRAKE_PIXEL_CENTER, cy + DRAKE_PIXEL_CENTER])
        expected = _intrinsics(self._expected)
        if not np.all(np.abs(given - expected) <= _INTRINSICS):
            self._misfit = (
                f"its intrinsics fx, fy, cx, cy {np.round(given, 1).tolist()} are not "
                f"the scenario's {np.round(expected, 1).tolist()}: calibrate it"
            )
            raise CommandError("intrinsics", self._misfit)


def _intrinsics(info: CameraInfo) -> Any:
    return np.array([info.focal_x(), info.focal_y(), info.center_x(), info.center_y()])


class CameraFeed(LeafSystem):
    """Outputs pictures of a camera, with the ports of Drake's RgbdSensor.

    .. pydrake_system::

        name: CameraFeed
        input_ports:
        - stamp
        output_ports:
        - color_image
        - depth_image
        - body_pose_in_world

    Evaluating an image waits for a picture that is newer than `stamp` (1), the time by
    the robot's clock [s]: an older one might show the arm on its way. So a system that
    must not wait, such as the control loop, must not evaluate these ports.

    Args:
        X_WB: The pose of the camera's body in world [m].
    """

    def __init__(self, camera: Camera, X_WB: RigidTransform) -> None:
        super().__init__()
        self._camera = camera
        self._stamp = self.DeclareVectorInputPort(name="stamp", size=1)
        # It depends on time, too: the view changes without the inputs. An update event
        # could not fetch the picture instead: it would wait for the camera each time,
        # even if nobody reads the picture.
        entry = self.DeclareCacheEntry(
            description="picture",
            value_producer=ValueProducer(
                allocate=lambda: AbstractValue.Make(object()),
                calc=weak(self._calc_picture),
            ),
            prerequisites_of_calc={self.time_ticket(), self._stamp.ticket()},
        )
        self._entry = entry.cache_index()
        for name, model, calc in (
            ("color_image", ImageRgba8U(), self._calc_color),
            ("depth_image", ImageDepth32F(), self._calc_depth),
        ):
            self.DeclareAbstractOutputPort(
                name, AbstractValue.Make(model).Clone, calc, {entry.ticket()}
            )
        self.DeclareAbstractOutputPort(
            "body_pose_in_world",
            AbstractValue.Make(X_WB).Clone,
            lambda context, output: None,  # it never moves
            {self.nothing_ticket()},
        )

    def _calc_picture(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._camera.picture(self._stamp.Eval(context)[0]))

    def _picture(self, context: Context) -> Picture:
        entry = self.get_cache_entry(self._entry)
        picture: Picture = entry.EvalAbstract(context).get_value()
        return picture

    def _calc_color(self, context: Context, output: AbstractValue) -> None:
        pixels = self._picture(context).color
        image = ImageRgba8U(pixels.shape[1], pixels.shape[0])
        image.mutable_data[:] = pixels
        output.set_value(image)

    def _calc_depth(self, context: Context, output: AbstractValue) -> None:
        depth = self._picture(context).depth
        image = ImageDepth32F(depth.shape[1], depth.shape[0])
        image.mutable_data[:] = depth[..., np.newaxis]
        output.set_value(image)
