"""Level surfaces of known height, and their use to correct camera poses."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageDepth32F

from drake_srg.lifetime import LeafSystem
from drake_srg.types import Vector
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.images import Mask, has_depth, robust_deviation


@dc.dataclass(frozen=True)
class Surface:
    """A horizontal rectangle on which things stand, in world [m]."""

    min: tuple[float, float]
    max: tuple[float, float]
    height: float

    def contains(self, p_W: Vector, margin: float = 0.0) -> Mask:
        """Return whether each point lies above or below the rectangle.

        Args:
            p_W: Points in world [m], shape (n, 2 or 3).
            margin: Distance beyond the edges that still counts [m].

        Returns:
            Shape (n,).
        """
        inside = np.ones(len(p_W), bool)
        for p, low, high in zip(p_W.T, self.min, self.max, strict=False):
            inside &= (p >= low - margin) & (p <= high + margin)
        return inside


# Largest errors of a calibration in height [m] and tilt [rad]. If a surface differs by
# more, it is not one of the known ones.
_MOST_OFFSET = 0.02
_MOST_TILT = np.deg2rad(2.0)
# Least and greatest number of points. Fewer do not determine a tilt, more add little.
_LEAST_POINTS = 200
_MOST_POINTS = 80_000
# Points within this many standard deviations of the plane fit it.
_INLIERS = 2.5
_ROUNDS = 6  # of fitting the plane and dropping points that do not fit


class CameraLeveling(LeafSystem):
    """Corrects a camera's pose so that known surfaces appear at their known height.

    A pose may have errors in six directions. Any depth image of a table reveals three
    of them: both tilts and the height. They are worth correcting, because a tilt of a
    milliradian shifts the scene by a millimetre at one metre. The system turns the
    camera about its own centre, as little as possible, and raises or lowers it. Things
    on the surface do no harm as long as half of its visible part is free. If no surface
    is visible, the pose does not change.

    .. pydrake_system::

        name: CameraLeveling
        input_ports:
        - depth_image
        - body_pose_in_world
        output_ports:
        - body_pose_in_world

    Args:
        camera: The camera's model.
        surfaces: All horizontal surfaces of known height.

    Raises:
        ValueError: If `surfaces` is empty.
    """

    def __init__(self, camera: CameraModel, surfaces: Sequence[Surface]) -> None:
        super().__init__()
        if not surfaces:
            raise ValueError("CameraLeveling needs at least one surface")
        self._surfaces = tuple(surfaces)
        imager = camera.imager("depth")
        width, height = imager.info.width(), imager.info.height()
        # Only every n-th column and row is used.
        share = width * height / _MOST_POINTS
        self._every = int(np.ceil(np.sqrt(share)))
        rays = imager.rays(slice(0, width), slice(0, height))
        rays = rays[:: self._every, :: self._every]
        self._rays_B = rays @ imager.X_BI.rotation().matrix().T
        self._p_BD = imager.X_BI.translation().copy()
        self._depth = self.DeclareAbstractInputPort(
            name="depth_image", model_value=AbstractValue.Make(ImageDepth32F())
        )
        self._pose = self.DeclareAbstractInputPort(
            name="body_pose_in_world", model_value=AbstractValue.Make(RigidTransform())
        )
        self.DeclareAbstractOutputPort(
            name="body_pose_in_world",
            alloc=lambda: AbstractValue.Make(RigidTransform()),
            calc=self._calc_pose,
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

    def _calc_pose(self, context: Context, output: AbstractValue) -> None:
        X_WB: RigidTransform = self._pose.Eval(context)
        depth = self._depth.Eval(context).data[:: self._every, :: self._every, 0]
        seen = has_depth(depth)
        p_B = self._p_BD + self._rays_B[seen] * depth[seen][:, None]
        p_W = p_B @ X_WB.rotation().matrix().T + X_WB.translation()
        output.set_value(self._leveled(X_WB, p_W))

    def _leveled(self, X_WB: RigidTransform, p_W: Vector) -> RigidTransform:
        # Height of the points above their surface, over x and y.
        over = np.concatenate(
            [
                p_W[surface.contains(p_W)] - [0.0, 0.0, surface.height]
                for surface in self._surfaces
            ]
        )
        over = over[np.abs(over[:, 2]) < _MOST_OFFSET]
        if len(over) < _LEAST_POINTS:
            return X_WB
        A = np.column_stack([over[:, :2] - X_WB.translation()[:2], np.ones(len(over))])
        z = over[:, 2]
        plane = np.array([0.0, 0.0, float(np.median(z))])
        fits = np.ones(len(z), dtype=bool)
        fitted = np.zeros(0, dtype=bool)  # pixels that the plane fits
        for _ in range(_ROUNDS):
            error = z - A @ plane
            spread = robust_deviation(error[fits])
            fits = np.abs(error) <= _INLIERS * spread + 1e-9
            if fits.sum() < _LEAST_POINTS:
                return X_WB
            if np.array_equal(fits, fitted):
                break
            fitted = fits
            A_fits = A * fits[:, None]
            plane = np.linalg.solve(A_fits.T @ A, A_fits.T @ z)
        slope_x, slope_y, offset = plane
        if np.arctan(np.hypot(slope_x, slope_y)) > _MOST_TILT:
            return X_WB
        # A turn about the camera makes the plane level; then its height is corrected.
        normal = np.array([-slope_x, -slope_y, 1.0])
        normal /= np.linalg.norm(normal)
        R_WSeen = _turn_between(normal, np.array([0.0, 0.0, 1.0]))
        height = X_WB.translation()[2] - np.mean([s.height for s in self._surfaces])
        # The turn does not change the camera's distance from the plane.
        rise = height - (height - offset) * normal[2]
        return RigidTransform(
            R_WSeen @ X_WB.rotation(), X_WB.translation() - [0.0, 0.0, rise]
        )


def _turn_between(a: Vector, b: Vector) -> RotationMatrix:
    """Return the least rotation that takes a unit vector (3,) to one near it."""
    v, c = np.cross(a, b), float(a @ b)
    K = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return RotationMatrix.ProjectToRotationMatrix(np.eye(3) + K + K @ K / (1.0 + c))
