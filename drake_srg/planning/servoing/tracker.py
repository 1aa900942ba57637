"""Trackers of an object in the images of a camera in the hand."""

from __future__ import annotations

import dataclasses as dc
import math
import zlib
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context, EventStatus, State
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from drake_srg.common.geometry import Solid
from drake_srg.common.shared import Shared
from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.color import ColorRange
from drake_srg.vision.images import Mask, has_depth
from drake_srg.vision.solids import signed_distance


@dc.dataclass(frozen=True, eq=False)
class Capture:
    """Time of an image, and the arm's positions at that time."""

    time: float = -np.inf  # by the servo's clock [s]
    q: Vector = dc.field(default_factory=lambda: np.zeros(0))  # shape (N,) [rad]


@dc.dataclass(frozen=True, eq=False)
class Sighting(Shared):
    """Base class of the content of one image."""

    frame: int = 0  # equal for equal images
    # When the image was taken, by the clock of camera and arm [s]; NaN: now.
    stamp: float = dc.field(default=np.nan, kw_only=True)
    # The same by the servo's clock, with the arm's positions; None: now.
    taken: Capture | None = dc.field(default=None, kw_only=True)


@dc.dataclass(frozen=True, eq=False)
class PoseSighting(Sighting):
    """An object's pose in one image."""

    # The object in the colour imager C (z into the scene) [m]; None if it is not seen.
    X_CO: RigidTransform | None = None


@dc.dataclass(frozen=True, eq=False)
class FeatureSighting(Sighting):
    """Image points of an object in one image."""

    # Image coordinates at focal length 1, shape (n, 2), and depths [m], shape (n,); n =
    # 0: the object is not in the image, or not all of it.
    points: Vector = dc.field(default_factory=lambda: np.zeros((0, 2)))
    depths: Vector = dc.field(default_factory=lambda: np.zeros(0))


_SPAN = 1.0  # greatest delay of a sighting [s]


@dc.dataclass(frozen=True)
class ArmHistory(Shared):
    """Positions of an arm in the last second.

    Attributes:
        stamps: Times of measurement by the arm's clock, increasing, shape (K,) [s].
        times: Times of arrival by our clock, shape (K,) [s].
        positions: Positions of the joints, shape (K, N) [rad].
    """

    stamps: Vector = dc.field(default_factory=lambda: np.zeros(0))
    times: Vector = dc.field(default_factory=lambda: np.zeros(0))
    positions: Vector = dc.field(default_factory=lambda: np.zeros((0, 0)))

    def followed_by(self, stamp: float, time: float, q: Vector) -> ArmHistory:
        """Return the history with one more measurement.

        A measurement that is not new changes nothing. If the arm's clock jumps back,
        the history starts again.

        Args:
            stamp: Time of measurement by the arm's clock [s]; NaN: unknown.
            time: Time of arrival by our clock [s].
            q: The joints' positions, shape (N,) [rad].
        """
        known = self if len(self.stamps) and stamp >= self.stamps[-1] else None
        if np.isnan(stamp) or (known is not None and stamp == known.stamps[-1]):
            return self
        if known is None:
            return ArmHistory(np.array([stamp]), np.array([time]), q[np.newaxis].copy())
        kept = known.stamps >= stamp - _SPAN
        return ArmHistory(
            np.append(known.stamps[kept], stamp),
            np.append(known.times[kept], time),
            np.vstack([known.positions[kept], q]),
        )

    def at(self, stamp: float) -> Capture | None:
        """Return our time, and the arm's positions, at a time of the arm's clock [s].

        Returns:
            Both, interpolated between measurements; None outside of the history.
        """
        if not len(self.stamps) or not self.stamps[0] <= stamp <= self.stamps[-1]:
            return None
        q = [np.interp(stamp, self.stamps, joint) for joint in self.positions.T]
        return Capture(float(np.interp(stamp, self.stamps, self.times)), np.array(q))


_NOTHING = Sighting(taken=Capture())


@dc.dataclass(frozen=True)
class _Seen:
    """The history of the arm, and the newest sighting within it."""

    arm: ArmHistory
    sighting: Sighting


class LateSightings(LeafSystem):
    """Looks up the arm's positions at the time of an image.

    .. pydrake_system::

        name: LateSightings
        input_ports:
        - sighting
        - arm_state
        - arm_stamp
        output_ports:
        - sighting

    The input `sighting` (a Sighting) has its `stamp`. `arm_state` (2N), [q; v] in rad
    and rad/s, was measured at `arm_stamp` (1) by the same clock [s]. The output
    `sighting` is the newest one with measurements of the arm before and after it;
    `taken` is filled in. Without such a sighting, and while the input's stamp is NaN,
    the output is a sighting of nothing, taken at minus infinity.

    Args:
        num_joints: N.
        period: Time between updates [s].
    """

    def __init__(self, num_joints: int, period: float) -> None:
        super().__init__()
        self._n = num_joints
        self._late = self.DeclareAbstractInputPort(
            name="sighting", model_value=AbstractValue.Make(Sighting())
        )
        self._measured = self.DeclareVectorInputPort("arm_state", 2 * num_joints)
        self._stamp = self.DeclareVectorInputPort("arm_stamp", 1)
        start = _Seen(ArmHistory(), _NOTHING)
        self._state = self.DeclareAbstractState(AbstractValue.Make(start))
        self.DeclareAbstractOutputPort(
            name="sighting",
            alloc=lambda: AbstractValue.Make(_NOTHING),
            calc=self._calc_sighting,
            prerequisites_of_calc={self.abstract_state_ticket(self._state)},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def _seen(self, context: Context) -> _Seen:
        seen: _Seen = context.get_abstract_state(int(self._state)).get_value()
        return seen

    def _calc_sighting(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._seen(context).sighting)

    def _update(self, context: Context, state: State) -> EventStatus:
        seen = self._seen(context)
        arm = seen.arm.followed_by(
            self._stamp.Eval(context)[0],
            context.get_time(),
            self._measured.Eval(context)[: self._n],
        )
        new = _Seen(arm, self._newest(seen.sighting, self._late.Eval(context), arm))
        state.get_mutable_abstract_state(int(self._state)).set_value(new)
        return EventStatus.Succeeded()

    def _newest(self, known: Sighting, late: Sighting, arm: ArmHistory) -> Sighting:
        if math.isnan(late.stamp):
            return _NOTHING
        taken = None if late.stamp == known.stamp else arm.at(late.stamp)
        return known if taken is None else dc.replace(late, taken=taken)


_LEAST_AREA = 50  # of an object's region [pixels]


def silhouette(mask: Mask) -> Mask | None:
    """Return the largest connected region of a mask, shape (h, w).

    Args:
        mask: Pixels of the object's colour, shape (h, w).

    Returns:
        None if the region is too small, or if it touches the border of the image.
    """
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    areas = stats[1:, cv2.CC_STAT_AREA]
    if not len(areas) or areas.max() < _LEAST_AREA:
        return None
    largest = 1 + int(np.argmax(areas))
    left, top, width, height = stats[largest, :4]
    h, w = mask.shape
    if min(left, top) == 0 or left + width == w or top + height == h:
        return None
    return np.asarray(labels == largest)


def ellipse_ends(region: Mask) -> Vector:
    """Return the right, left, lower and upper end of a region's ellipse.

    The ellipse has the region's first and second moments, which average over all
    pixels; its ends are two standard deviations from the middle, along the image's
    axes. Those of a disc are on its rim.

    Args:
        region: Shape (h, w).

    Returns:
        Columns and rows, shape (4, 2) [pixels].
    """
    rows, columns = np.nonzero(region)
    middle = np.array([columns.mean(), rows.mean()])
    u, v = 2.0 * columns.std(), 2.0 * rows.std()
    return middle + np.array([[u, 0.0], [-u, 0.0], [0.0, v], [0.0, -v]])


class Tracker(LeafSystem):
    """Base class of the trackers: declares their ports and finds the object's pixels.

    Args:
        color: Colour of the object.
        camera: The camera's model.
        nothing: A sighting of nothing, of the type of the port `sighting`.

    Raises:
        ValueError: If colour and depth image do not show the same pixels.
    """

    def __init__(
        self, color: ColorRange, camera: CameraModel, nothing: Sighting
    ) -> None:
        super().__init__()
        if not camera.imager("color").same_as(camera.imager("depth")):
            name = type(self).__name__
            raise ValueError(f"{name} needs colour and depth images of the same pixels")
        self._color = color
        for port, value in (
            ("color_image", ImageRgba8U()),
            ("depth_image", ImageDepth32F()),
        ):
            self.DeclareAbstractInputPort(
                name=port, model_value=AbstractValue.Make(value)
            )
        self.DeclareAbstractOutputPort(
            name="sighting",
            alloc=lambda: AbstractValue.Make(nothing),
            calc=self._calc_sighting,
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

    def sight(self, color: npt.NDArray[Any], depth: npt.NDArray[Any]) -> Sighting:
        """Return what an image shows.

        Args:
            color: RGBA, shape (h, w, 4).
            depth: Shape (h, w) [m].
        """
        region = silhouette(self._color.mask(color))
        return self._sight(zlib.crc32(color.tobytes()), region, depth)

    def _calc_sighting(self, context: Context, output: AbstractValue) -> None:
        color = self.GetInputPort("color_image").Eval(context).data
        depth = self.GetInputPort("depth_image").Eval(context).data[..., 0]
        output.set_value(self.sight(color, depth))

    def _sight(
        self, frame: int, region: Mask | None, depth: npt.NDArray[Any]
    ) -> Sighting:
        """Return what an image shows.

        Args:
            frame: Identifies the image.
            region: The object's pixels, shape (h, w); None if it is not wholly visible.
            depth: Shape (h, w) [m].
        """
        raise NotImplementedError


_STEPS, _STILL = 20, 1e-5  # Gauss-Newton steps, and the step that ends them [m]
# Distance from the surface at which a point counts half [m]: pixels on the rim show
# the background.
_SOFT = 0.004
# The position is determined unless all normals are this near to one plane (root mean
# square of their sines).
_LEAST = 0.05
_DAMPING = 1e-3  # of the mean square of the normals
_MOST_POINTS = 1500


def fit_translation(
    points: Vector, solid: Solid, R_CO: RotationMatrix
) -> Vector | None:
    """Return the position of a solid of known orientation from points of its surface.

    It minimizes robustly weighted distances from the surface by Gauss-Newton. The start
    is half of the solid's least extent behind the middle of the points.

    Args:
        points: Points in the camera's frame, shape (n, 3) [m].
        solid: The solid.
        R_CO: Its orientation in the camera.

    Returns:
        The solid's centre in the camera, shape (3,) [m]; None if the points do not
        determine it.
    """
    if len(points) < 3:
        return None
    R = R_CO.matrix()
    middle = np.median(points, axis=0)
    ray = middle / np.linalg.norm(middle)
    p_CO = middle + 0.5 * float(np.min(solid.bounding_size)) * ray
    for _ in range(_STEPS):
        distance, normals = signed_distance(solid, (points - p_CO) @ R)
        soft = max(_SOFT, float(np.median(np.abs(distance))))
        weight = 1.0 / (1.0 + (distance / soft) ** 2)
        normals = normals @ R.T
        spread = (weight * normals.T) @ normals / weight.sum()
        away = (weight * distance) @ normals / weight.sum()
        # Damped, because all points may be nearest to the same face on the way.
        step = np.linalg.solve(spread + _DAMPING * np.eye(3), away)
        p_CO = p_CO + step
        if np.linalg.norm(step) < _STILL:
            break
    determined = np.linalg.eigvalsh(spread)[0] > _LEAST**2
    return p_CO if determined else None


class SurfaceTracker(Tracker):
    """Finds a known solid of known colour, for a position-based servo.

    .. pydrake_system::

        name: SurfaceTracker
        input_ports:
        - color_image
        - depth_image
        output_ports:
        - sighting

    Inputs: `color_image` (ImageRgba8U) and `depth_image` (ImageDepth32F) of one camera.
    Output: `sighting` (PoseSighting), computed when it is evaluated. The tracker
    assumes the object's orientation in the camera at the servo's goal; see
    `fit_translation`. There is no pose unless the object's colour lies wholly within
    the image. Unlike `BlobLocalizer`, it takes a few milliseconds, looks for no other
    poses, and does not judge its fit.

    Args:
        solid: The object's shape.
        p_OS: Centre of `solid` in the object's frame, to which it is parallel, shape
            (3,) [m].
        color: Colour of the object.
        R_CO: The object's orientation in the colour imager.
        camera: The camera's model.

    Raises:
        ValueError: If colour and depth image do not show the same pixels.
    """

    def __init__(
        self,
        solid: Solid,
        p_OS: Vector,
        color: ColorRange,
        R_CO: RotationMatrix,
        camera: CameraModel,
    ) -> None:
        super().__init__(color, camera, PoseSighting())
        self._solid, self._p_OS = solid, np.asarray(p_OS)
        self._R_CO = R_CO
        info = camera.color
        self._rays = camera.imager("color").rays(
            slice(0, info.width()), slice(0, info.height())
        )

    def _sight(
        self, frame: int, region: Mask | None, depth: npt.NDArray[Any]
    ) -> PoseSighting:
        p_CS = None
        if region is not None:
            # Pixels on the rim mix object and background.
            inner = cv2.erode(region.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
            inner &= has_depth(depth)
            points = self._rays[inner] * depth[inner][:, np.newaxis]
            points = points[:: 1 + len(points) // _MOST_POINTS]
            p_CS = fit_translation(points, self._solid, self._R_CO)
        X_CO = None
        if p_CS is not None:
            X_CO = RigidTransform(self._R_CO, p_CS - self._R_CO @ self._p_OS)
        return PoseSighting(frame, X_CO)


class SilhouetteTracker(Tracker):
    """Finds the silhouette of an object of known colour, for an image-based servo.

    .. pydrake_system::

        name: SilhouetteTracker
        input_ports:
        - color_image
        - depth_image
        output_ports:
        - sighting

    Inputs: `color_image` (ImageRgba8U) and `depth_image` (ImageDepth32F) of one camera.
    Output: `sighting` (FeatureSighting), computed when it is evaluated: four points,
    see `ellipse_ends`, all at the median depth of the silhouette; none unless the
    silhouette lies wholly within the image.

    Args:
        color: Colour of the object.
        camera: The camera's model.

    Raises:
        ValueError: If colour and depth image do not show the same pixels.
    """

    def __init__(self, color: ColorRange, camera: CameraModel) -> None:
        super().__init__(color, camera, FeatureSighting())
        info = camera.color
        self._focal = np.array([info.focal_x(), info.focal_y()])
        self._center = np.array([info.center_x(), info.center_y()])
        self._center -= camera.pixel_center

    def _sight(
        self, frame: int, region: Mask | None, depth: npt.NDArray[Any]
    ) -> FeatureSighting:
        if region is None or not np.any(region & has_depth(depth)):
            return FeatureSighting(frame)
        points = (ellipse_ends(region) - self._center) / self._focal
        z = float(np.median(depth[region & has_depth(depth)]))
        return FeatureSighting(frame, points, np.full(4, z))
