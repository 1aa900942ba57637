"""Camera models: rays through pixels, and the corrections of a calibration."""

import dataclasses as dc
from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt
from pydrake.common.schema import Transform
from pydrake.common.value import AbstractValue
from pydrake.geometry import ColorRenderCamera, DepthRenderCamera
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context
from pydrake.systems.sensors import (
    CameraConfig,
    CameraInfo,
    ImageDepth32F,
    ImageRgba8U,
    RgbdSensor,
)

from drake_srg.config import Config, positive
from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector
from drake_srg.vision.images import Mask

# Pixel (u, v) of Drake's images samples the scene along the ray through (u + 0.5,
# v + 0.5), both in colour and in depth. This was measured on rendered boxes with edges
# at random places; see tests/vision/test_camera.py.
DRAKE_PIXEL_CENTER = 0.5


@dc.dataclass(frozen=True)
class CameraModel:
    """The intrinsics of a colour and depth camera and the poses of its imagers.

    Frames: B is the camera body, C the colour imager and D the depth imager. An
    imager's z points into the scene, x to the right and y down the image.

    Attributes:
        color: Intrinsics of the colour image.
        depth: Intrinsics of the depth image; None for those of the colour image.
        X_BC: Pose of the colour imager in the body.
        X_BD: Pose of the depth imager in the body; None for `X_BC`.
        pixel_center: Sampling point of pixel (0, 0) [pixels]. Drake's renderers sample
            at 0.5. OpenCV's calibrations assume 0.
    """

    color: CameraInfo
    depth: CameraInfo | None = None
    X_BC: RigidTransform = dc.field(default_factory=RigidTransform)
    X_BD: RigidTransform | None = None
    pixel_center: float = DRAKE_PIXEL_CENTER

    @classmethod
    def from_config(cls, config: CameraConfig) -> "CameraModel":
        """Return the model of the camera that Drake builds from a config."""
        return cls._from_render_cameras(*config.MakeCameras())

    @classmethod
    def from_sensor(cls, sensor: RgbdSensor) -> "CameraModel":
        """Return the model of a Drake sensor, from its default render cameras."""
        return cls._from_render_cameras(
            sensor.default_color_render_camera(), sensor.default_depth_render_camera()
        )

    @classmethod
    def _from_render_cameras(
        cls, color: ColorRenderCamera, depth: DepthRenderCamera
    ) -> "CameraModel":
        return cls(
            color=color.core().intrinsics(),
            depth=depth.core().intrinsics(),
            X_BC=color.core().sensor_pose_in_camera_body(),
            X_BD=depth.core().sensor_pose_in_camera_body(),
        )

    def imager(self, which: str) -> "Imager":
        """Return the "color" or the "depth" imager."""
        if which == "color":
            return Imager(self.color, self.X_BC, self.pixel_center)
        return Imager(
            self.depth or self.color,
            self.X_BC if self.X_BD is None else self.X_BD,
            self.pixel_center,
        )


class Imager:
    """One imager of a camera.

    Args:
        info: Its intrinsics.
        X_BI: Its pose in the camera body.
        pixel_center: See `CameraModel`.
    """

    def __init__(self, info: CameraInfo, X_BI: RigidTransform, pixel_center: float):
        self.info = info
        self.X_BI = X_BI
        self._offset = np.array(
            [info.center_x() - pixel_center, info.center_y() - pixel_center]
        )
        self._focal = np.array([info.focal_x(), info.focal_y()])

    def rays(self, columns: slice, rows: slice) -> Vector:
        """Return rays through pixel centres in the imager's frame, scaled to z = 1.

        A depth image holds z, so depth times ray is the point.

        Args:
            columns: Columns of the window, start and stop given.
            rows: Likewise, its rows.

        Returns:
            Shape (rows, columns, 3).
        """
        u, v = np.meshgrid(
            np.arange(columns.start, columns.stop), np.arange(rows.start, rows.stop)
        )
        return np.stack([*self.slopes(u, v), np.ones(u.shape)], axis=-1)

    def slopes(self, u: npt.NDArray[Any], v: npt.NDArray[Any]) -> tuple[Vector, Vector]:
        """Return x and y of the rays through pixels, scaled to z = 1.

        Args:
            u: Columns of the pixels, any shape.
            v: Their rows, of the same shape.
        """
        (x, y), (fx, fy) = self._offset, self._focal
        return (u - x) / fx, (v - y) / fy

    def project(self, p_I: Vector) -> Vector:
        """Return the pixel coordinates (u, v) of points.

        Args:
            p_I: Points in the imager's frame [m], shape (..., 3).

        Returns:
            Shape (..., 2); a pixel's centre has whole coordinates.
        """
        z = np.maximum(p_I[..., 2:], 1e-9)
        return np.asarray(p_I[..., :2] / z * self._focal + self._offset)

    def same_as(self, other: "Imager") -> bool:
        """Return whether both imagers sample the scene along the same rays."""
        a, b = self.info, other.info
        return (
            (a.width(), a.height()) == (b.width(), b.height())
            and np.array_equal(a.intrinsic_matrix(), b.intrinsic_matrix())
            and self.X_BI.IsExactlyEqualTo(other.X_BI)
        )

    def lookup(self, p_I: Vector, image: Mask) -> Mask:
        """Return the values of a boolean image at points; False outside the image.

        Args:
            p_I: Points in the imager's frame [m], shape (..., 3).
            image: Shape (height, width).

        Returns:
            Shape (...).
        """
        uv = self.project(p_I)
        uv = np.where(np.isfinite(uv) & (p_I[..., 2:] > 0), uv, -1.0)
        u, v = np.rint(np.clip(uv, -1, 1e6)).astype(int).reshape(-1, 2).T
        inside = (u >= 0) & (v >= 0) & (u < image.shape[1]) & (v < image.shape[0])
        found = np.zeros(inside.shape, dtype=bool)
        found[inside] = image[v[inside], u[inside]]
        return found.reshape(p_I.shape[:-1])


# Ports of Drake's RgbdSensor, and of the systems that use its images.
_PORTS = {
    "color_image": ImageRgba8U,
    "depth_image": ImageDepth32F,
    "body_pose_in_world": RigidTransform,
}


def declare_camera_ports(
    system: LeafSystem, cameras: Iterable[str], ports: Iterable[str]
) -> None:
    """Declare input ports `CAMERA.PORT`, for images and poses X_WB of cameras."""
    for camera in cameras:
        for port in ports:
            value = AbstractValue.Make(_PORTS[port]())
            system.DeclareAbstractInputPort(f"{camera}.{port}", value)


def eval_camera_port(
    system: LeafSystem, context: Context, camera: str, port: str
) -> Any:
    """Return the pixels of an image or the pose at a port of `declare_camera_ports`.

    Raises:
        RuntimeError: If the port is not connected.
    """
    source = system.GetInputPort(f"{camera}.{port}")
    if not source.HasValue(context):
        raise RuntimeError(
            f"{type(system).__name__}'s input port {source.get_name()!r} is not "
            "connected"
        )
    value = source.Eval(context)
    return value if isinstance(value, RigidTransform) else value.data


@dc.dataclass(kw_only=True)
class CameraCalibrationConfig(Config):
    """A camera's calibrated intrinsics and pose, as `drake-srg calibrate` writes them.

    The localizer uses these values. Simulated images still come from the camera's entry
    in `cameras`.
    """

    # Focal lengths and principal point of the colour image [pixels]; the image's upper
    # left corner is [0, 0], as in Drake's CameraInfo.
    focal: list[float] = dc.field(
        default_factory=lambda: [500.0] * 2, metadata=positive(length=2)
    )
    center: list[float] = dc.field(
        default_factory=lambda: [320.0, 240.0], metadata={"length": 2}
    )
    # Pose of the camera's body. Its base frame is that of the entry in `cameras`.
    X_PB: Transform = dc.field(default_factory=Transform)


def calibrated_model(
    config: CameraConfig, calibration: CameraCalibrationConfig | None
) -> CameraModel:
    """Return a camera's model with its calibrated intrinsics.

    If both images share intrinsics, the depth image gets the calibrated ones, too.

    Args:
        config: The camera.
        calibration: Its calibration; None keeps the configured intrinsics.
    """
    model = CameraModel.from_config(config)
    if calibration is None:
        return model
    (fx, fy), (cx, cy) = calibration.focal, calibration.center
    width, height = model.color.width(), model.color.height()
    color = CameraInfo(width, height, fx, fy, cx, cy)
    shared = model.imager("depth").same_as(model.imager("color"))
    return dc.replace(model, color=color, depth=color if shared else model.depth)


class CalibratedPose(LeafSystem):
    """Replaces a camera's configured pose by its calibrated pose.

    .. pydrake_system::

        name: CalibratedPose
        input_ports:
        - body_pose_in_world
        output_ports:
        - body_pose_in_world

    Args:
        X_PB: The camera's body in its base frame, according to its config [m].
        X_PB_calibrated: The same, calibrated [m].
    """

    def __init__(self, X_PB: RigidTransform, X_PB_calibrated: RigidTransform) -> None:
        super().__init__()
        self._X_BE = X_PB.inverse() @ X_PB_calibrated
        value = AbstractValue.Make(RigidTransform())
        source = self.DeclareAbstractInputPort("body_pose_in_world", value)
        self.DeclareAbstractOutputPort(
            "body_pose_in_world", value.Clone, self._calc_pose, {source.ticket()}
        )

    def _calc_pose(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self.get_input_port().Eval(context) @ self._X_BE)
