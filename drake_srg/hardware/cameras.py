"""Cameras that publish their images with ROS 1 or ROS 2."""

import abc
import dataclasses as dc
from typing import Any, ClassVar

import numpy as np
from pydrake.systems.sensors import CameraInfo

from drake_srg.bridges.commands import CommandError
from drake_srg.bridges.topics import CAMERA_INFO, COLOR, DEPTH
from drake_srg.common.exceptions import ScenarioError
from drake_srg.hardware.link import Robot
from drake_srg.hardware.pictures import Album, Picture
from drake_srg.types import positive
from drake_srg.vision.calibrated_camera import calibrated_model
from drake_srg.vision.camera import DRAKE_PIXEL_CENTER

_IMAGE, _INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
# A camera's own intrinsics may differ this much from the scenario's [pixels].
_INTRINSICS = 2.0


class Camera(abc.ABC):
    """A live connection to a camera."""

    @abc.abstractmethod
    def picture(self, after: float, patience: float | None = None) -> Picture:
        """Return a picture that is newer than a time; waits for it.

        Args:
            after: By the robot's clock [s].
            patience: How long to wait [s, real]; None: as configured.

        Raises:
            ScenarioError: If no picture arrives.
        """

    @abc.abstractmethod
    def newest(self) -> Picture | None:
        """Return the newest picture, if there is one; does not wait.

        Raises:
            ScenarioError: If the camera is not the scenario's.
        """


@dc.dataclass(kw_only=True)
class RosCamera:
    """A colour and depth camera with aligned images of the same time stamp."""

    version: ClassVar[int]

    # Topics of the images (sensor_msgs/Image: rgb8, bgr8, rgba8 or bgra8; 32FC1 [m] or
    # 16UC1 [mm]) and of the intrinsics (sensor_msgs/CameraInfo; empty: not checked).
    color: str = COLOR
    depth: str = DEPTH
    info: str = CAMERA_INFO
    # How long to wait for a picture that is newer than a look [s].
    patience: float = dc.field(default=10.0, metadata=positive())

    def connect(self, name: str, robot: Robot) -> Camera:
        """Return a link to the camera.

        Args:
            name: The camera's, in the scenario.
            robot: The robot that it belongs to.
        """
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
        """See `Camera`."""
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
        """See `Camera`."""
        self._check()
        return self._album.newest

    def _check(self) -> None:
        if self._misfit:
            raise ScenarioError(f"cameras.{self._name}: {self._misfit}")

    def _check_info(self, message: Any) -> None:
        # ROS 1 has the matrix as K, which rosbags calls so too.
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
