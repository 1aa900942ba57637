"""The pose of a known solid from the depth of its visible surface, for a servo."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.common.convex_pieces import Solid
from drake_srg.servoing.sightings import PoseSighting
from drake_srg.servoing.tracker import Tracker
from drake_srg.types import Vector
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.color import ColorRange
from drake_srg.vision.mask import Mask, has_depth
from drake_srg.vision.solids import signed_distance

_STEPS, _STILL = 20, 1e-5  # Gauss-Newton steps, and the step that ends them [m]
# Distance from the surface at which a point counts half [m]: pixels on the rim show
# what is behind.
_SOFT = 0.004
# The position is determined unless the normals are all this near to a plane (root mean
# square of their sines).
_LEAST = 0.05
_DAMPING = 1e-3  # of the mean square of the normals
_MOST_POINTS = 1500


def fit_translation(
    points: Vector, solid: Solid, R_CO: RotationMatrix
) -> Vector | None:
    """Return where a solid of known orientation is whose surface has the points.

    Gauss-Newton on the robustly weighted distances from the surface, from half of the
    least extent behind the middle of the points.

    Args:
        points: In the camera's frame, shape (n, 3) [m].
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
        # On the way, all points may be nearest to the same face.
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
    Output: `sighting` (PoseSighting), computed when it is evaluated. The object's
    orientation in the camera is taken to be that at the servo's goal; see
    `fit_translation`. There is no pose unless the object's colour lies wholly within
    the image. Unlike `BlobLocalizer`, it takes a few milliseconds, looks for no other
    poses, and does not judge its fit.

    Args:
        solid: The object's shape.
        p_OS: Its centre in the object, to which it is parallel, shape (3,) [m].
        color: Of the object.
        R_CO: The object's orientation in the colour imager.
        camera: The camera's model.
        min_area: Smaller regions do not count [pixels].

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
        *,
        min_area: int = 50,
    ) -> None:
        super().__init__(color, camera, min_area=min_area, nothing=PoseSighting())
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
            # Pixels on the rim mix the object with what is behind it.
            inner = cv2.erode(region.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
            inner &= has_depth(depth)
            points = self._rays[inner] * depth[inner][:, np.newaxis]
            points = points[:: 1 + len(points) // _MOST_POINTS]
            p_CS = fit_translation(points, self._solid, self._R_CO)
        X_CO = None
        if p_CS is not None:
            X_CO = RigidTransform(self._R_CO, p_CS - self._R_CO @ self._p_OS)
        return PoseSighting(frame, X_CO)
