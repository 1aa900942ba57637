"""Pixels to rays and back, for Drake's cameras."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform
from pydrake.systems.sensors import CameraInfo, RgbdSensor

from drake_srg.types import Vector

# Measured on rendered boxes with edges at random places (see
# tests/vision/test_camera.py): pixel (u, v) of Drake's images samples the scene along
# the ray through (u + 0.5, v + 0.5), in columns and rows, in colour and in depth.
DRAKE_PIXEL_CENTER = 0.5


@dc.dataclass(frozen=True)
class CameraModel:
    """Intrinsics of a colour and depth camera and where its imagers sit.

    Frames: B the camera body, C the colour imager, D the depth imager; an imager's z
    points into the scene, x to the right and y down the image.

    Attributes:
        color: Intrinsics of the colour image.
        depth: Intrinsics of the depth image; None where it is the colour camera's.
        X_BC: Pose of the colour imager in the body.
        X_BD: Pose of the depth imager in the body; None for `X_BC`.
        pixel_center: Where pixel (0, 0) is sampled [pixels]. Drake's renderers sample
            at 0.5; calibrations by OpenCV's convention mean 0.
    """

    color: CameraInfo
    depth: CameraInfo | None = None
    X_BC: RigidTransform = dc.field(default_factory=RigidTransform)
    X_BD: RigidTransform | None = None
    pixel_center: float = DRAKE_PIXEL_CENTER

    @classmethod
    def from_sensor(cls, sensor: RgbdSensor) -> CameraModel:
        """The model of a Drake sensor, from its default render cameras."""
        color = sensor.default_color_render_camera().core()
        depth = sensor.default_depth_render_camera().core()
        return cls(
            color=color.intrinsics(),
            depth=depth.intrinsics(),
            X_BC=color.sensor_pose_in_camera_body(),
            X_BD=depth.sensor_pose_in_camera_body(),
        )

    def imager(self, which: str) -> Imager:
        """The "color" or the "depth" imager."""
        if which == "color":
            return Imager(self.color, self.X_BC, self.pixel_center)
        return Imager(
            self.depth or self.color,
            self.X_BC if self.X_BD is None else self.X_BD,
            self.pixel_center,
        )


class Imager:
    """One imager: `info` its intrinsics, `X_BI` its pose in the camera body."""

    def __init__(self, info: CameraInfo, X_BI: RigidTransform, pixel_center: float):
        self.info = info
        self.X_BI = X_BI
        self._offset = np.array(
            [info.center_x() - pixel_center, info.center_y() - pixel_center]
        )
        self._focal = np.array([info.focal_x(), info.focal_y()])

    def rays(self, columns: slice, rows: slice) -> Vector:
        """Rays through pixel centres in the imager's frame, scaled to z = 1.

        A depth image holds z, so depth times ray is the point.

        Returns:
            Shape (rows, columns, 3).
        """
        u, v = np.meshgrid(
            np.arange(columns.start, columns.stop), np.arange(rows.start, rows.stop)
        )
        xy = (np.stack([u, v], axis=-1) - self._offset) / self._focal
        return np.concatenate([xy, np.ones((*u.shape, 1))], axis=-1)

    def project(self, p_I: Vector) -> Vector:
        """Pixel coordinates (u, v) of points in the imager's frame, (..., 3).

        Returns:
            Shape (..., 2); a pixel's centre has whole coordinates.
        """
        z = np.maximum(p_I[..., 2:], 1e-9)
        return np.asarray(p_I[..., :2] / z * self._focal + self._offset)

    def same_as(self, other: Imager) -> bool:
        """Whether both imagers take their pixels along the same rays."""
        a, b = self.info, other.info
        return (
            (a.width(), a.height()) == (b.width(), b.height())
            and np.array_equal(a.intrinsic_matrix(), b.intrinsic_matrix())
            and self.X_BI.IsExactlyEqualTo(other.X_BI)
        )

    def lookup(
        self, p_I: Vector, image: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.bool_]:
        """Values of a boolean image at points in this imager's frame; False outside.

        Args:
            p_I: Shape (..., 3).
            image: Shape (height, width).
        """
        uv = self.project(p_I)
        uv = np.where(np.isfinite(uv) & (p_I[..., 2:] > 0), uv, -1.0)
        u, v = np.rint(np.clip(uv, -1, 1e6)).astype(int).reshape(-1, 2).T
        inside = (u >= 0) & (v >= 0) & (u < image.shape[1]) & (v < image.shape[0])
        found = np.zeros(inside.shape, dtype=bool)
        found[inside] = image[v[inside], u[inside]]
        return found.reshape(p_I.shape[:-1])
