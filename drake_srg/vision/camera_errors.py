"""Errors of real cameras: noise, blur, holes and a wrong calibration."""

import dataclasses as dc
import functools
import statistics
import zlib
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from drake_srg.config import Config
from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector

# Read noise of the sensor, as a share of the noise of a white pixel. The rest is shot
# noise.
_READ_NOISE = 0.5
# Standard deviation of the Gaussian that correlates depth errors [pixels]: real cameras
# match windows of several pixels, so neighbours share errors.
_CORRELATION = 0.7
# Greatest share of the pixels on an edge that lose their depth.
_MOST_LOST = 0.5


@dc.dataclass(kw_only=True)
class CameraErrorsConfig(Config):
    """Errors of a camera; all zeros mean an ideal one.

    The z of the camera's body B points into the scene, x to the right and y down the
    image.
    """

    # Error of the calibration: offset of the believed camera in B [m], and its rotation
    # as a rotation vector in B [rad]. With a ChArUco board, their standard deviations
    # are 0.2 to 1 mm and 0.02 to 0.1 degrees.
    translation: list[float] = dc.field(
        default_factory=lambda: [0.0] * 3, metadata={"length": 3}
    )
    rotation: list[float] = dc.field(
        default_factory=lambda: [0.0] * 3, metadata={"length": 3}
    )
    # Colours are multiplied by two to the power of this, and saturate [stops].
    # Automatic exposure settles within about half a stop.
    exposure: float = dc.field(default=0.0, metadata={"ge": -8.0, "le": 8.0})
    # Standard deviation of white pixels [counts of 255]; black ones have half of it.
    # Indoors, it is 1 to 4: shot noise alone gives 2.5 in a pixel of 10,000 electrons.
    color_noise: float = dc.field(default=0.0, metadata={"ge": 0.0, "le": 64.0})
    # Standard deviation of the Gaussian that blurs colours [pixels]; edges in depth
    # fray by as much. A focused lens with a Bayer pattern has 0.4 to 0.8.
    blur: float = dc.field(default=0.0, metadata={"ge": 0.0, "le": 8.0})
    # Standard deviation of depth at 1 m [m]; it grows with the square of depth. For
    # stereo, it is s / (f b), with s the error of a match (0.05 to 0.1 pixels), f the
    # focal length [pixels] and b the baseline [m]: 0.9 to 1.8 mm for a RealSense D415,
    # 2 to 4 mm for a D435. Structured light (Zivid, Photoneo) has 0.05 to 0.3 mm.
    depth_noise: float = dc.field(default=0.0, metadata={"ge": 0.0, "le": 0.1})
    # Share of pixels without depth on surfaces that face the camera: up to 0.02 for
    # active cameras on dull surfaces. Slanting surfaces and edges lose more.
    depth_dropout: float = dc.field(default=0.0, metadata={"ge": 0.0, "le": 0.5})


def X_BE_believed(config: CameraErrorsConfig) -> RigidTransform:
    """Return the believed pose of a camera, in its true body frame [m]."""
    turn = cv2.Rodrigues(np.array(config.rotation, dtype=float))[0]
    return RigidTransform(
        RotationMatrix.ProjectToRotationMatrix(turn), config.translation
    )


class CameraErrors(LeafSystem):
    """Adds a real camera's errors to the output of an ideal one.

    .. pydrake_system::

        name: CameraErrors
        input_ports:
        - color_image
        - depth_image
        - body_pose_in_world
        output_ports:
        - color_image
        - depth_image
        - body_pose_in_world

    Noise depends only on seed, name and time, so evaluating an image again gives the
    same image. Pixels without depth hold 0. Edges in depth fray: a pixel may show the
    depth of a pixel beside it [Barron and Malik, Intrinsic Scene Properties from a
    Single RGB-D Image, CVPR 2013, section 6].

    Args:
        config: The errors.
        focal: Focal length of the depth image [pixels].
        seed: The scenario's `random_seed`.
        name: The camera's name. Cameras with different names have different noise.
    """

    def __init__(
        self, config: CameraErrorsConfig, *, focal: float, seed: int, name: str
    ):
        super().__init__()
        self._config, self._focal = config, focal
        self._seed = (seed, zlib.crc32(name.encode()))
        self._X_BE = X_BE_believed(config)
        for port, model, calc in (
            ("color_image", ImageRgba8U(), self._calc_color),
            ("depth_image", ImageDepth32F(), self._calc_depth),
            ("body_pose_in_world", RigidTransform(), self._calc_pose),
        ):
            value = AbstractValue.Make(model)
            source = self.DeclareAbstractInputPort(port, value)
            self.DeclareAbstractOutputPort(
                port, value.Clone, calc, {source.ticket(), self.time_ticket()}
            )

    def _calc_color(self, context: Context, output: AbstractValue) -> None:
        config, image = self._config, self._input(context, "color_image")
        color = np.ascontiguousarray(image[..., :3])
        if config.blur:
            color = cv2.GaussianBlur(color, (0, 0), config.blur)
        if config.exposure:
            color = cv2.convertScaleAbs(color, alpha=2**config.exposure)  # saturates
        if config.color_noise:
            light = np.arange(256, dtype=np.float32) / 255
            variance = _READ_NOISE**2 + (1 - _READ_NOISE**2) * light
            error = _normal(self._generator(context, 0), color.shape)
            error *= cv2.LUT(color, config.color_noise * np.sqrt(variance))
            color = cv2.add(color, error, dtype=cv2.CV_8U)
        spoiled = ImageRgba8U(image.shape[1], image.shape[0])
        spoiled.mutable_data[..., :3] = color
        spoiled.mutable_data[..., 3] = image[..., 3]
        output.set_value(spoiled)

    def _calc_depth(self, context: Context, output: AbstractValue) -> None:
        config, image = self._config, self._input(context, "depth_image")
        depth, random = image[..., 0], self._generator(context, 1)
        if config.blur:
            h, w = depth.shape
            rows, columns = config.blur * _normal(random, (2, h, w))
            rows += np.arange(h, dtype=np.float32)[:, None]
            columns += np.arange(w, dtype=np.float32)
            depth = cv2.remap(
                depth, columns, rows, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE
            )
        if config.depth_noise:
            error = cv2.GaussianBlur(_normal(random, depth.shape), (0, 0), _CORRELATION)
            error *= config.depth_noise / error.std()
            seen = np.where(np.isfinite(depth), depth, 0)
            depth = depth + error * seen * seen
        if config.depth_dropout:
            share = config.depth_dropout * (1 + self._slant(image[..., 0]) ** 2)
            share = np.minimum(share, max(_MOST_LOST, config.depth_dropout))
            lost = random.random(depth.shape, dtype=np.float32) < share
            depth = np.where(lost & np.isfinite(depth), 0, depth)
        spoiled = ImageDepth32F(image.shape[1], image.shape[0])
        spoiled.mutable_data[..., 0] = depth
        output.set_value(spoiled)

    def _calc_pose(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._input(context, "body_pose_in_world") @ self._X_BE)

    def _slant(self, depth: npt.NDArray[np.float32]) -> Vector:
        """Return the tangent of the slant of each pixel's surface."""
        finite = np.where(np.isfinite(depth), depth, 0.0)
        step = cv2.morphologyEx(finite, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
        # The step spans two pixels, each of which is depth / focal wide.
        return np.asarray(0.5 * step * self._focal / np.maximum(finite, 1e-3))

    def _generator(self, context: Context, image: int) -> np.random.Generator:
        time = int(np.float64(context.get_time()).view(np.uint64))
        return np.random.Generator(np.random.SFC64([*self._seed, time, image]))

    def _input(self, context: Context, name: str) -> Any:
        value = self.GetInputPort(name).Eval(context)
        return value if isinstance(value, RigidTransform) else value.data


def _normal(
    random: np.random.Generator, shape: tuple[int, ...]
) -> npt.NDArray[np.float32]:
    """Return independent values of the standard normal distribution."""
    bits = np.frombuffer(random.bytes(2 * int(np.prod(shape))), np.uint16)
    return np.take(_quantiles(), bits).reshape(shape)


@functools.cache
def _quantiles() -> npt.NDArray[np.float32]:
    """Return 2^16 evenly spaced quantiles of the standard normal distribution.

    The largest is 4.3. Picking one with 16 random bits takes a third of the time of
    numpy's generator of normal numbers.
    """
    steps = (np.arange(2**16) + 0.5) / 2**16
    return np.array([statistics.NormalDist().inv_cdf(p) for p in steps], np.float32)
