"""The finder of unknown things that stand on tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import cv2
import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context

from drake_srg.lifetime import LeafSystem
from drake_srg.types import Blob, Box, Obstacle, Shape, Vector
from drake_srg.vision.camera import CameraModel, declare_camera_ports, eval_camera_port
from drake_srg.vision.images import Mask, narrowest_rectangle, robust_deviation
from drake_srg.vision.solids import signed_distance
from drake_srg.vision.surfaces import Surface

# A point stands on a surface if it is higher by this many standard deviations of noise:
# one in three million normally distributed values exceeds it.
_DEVIATIONS = 5.0
_LEAST_PIXELS = 8  # least number of points of an obstacle: noise makes smaller groups
# Points this near to a surface [m] mostly show the surface itself. Their scatter shows
# the noise of measured heights.
_NEAR = 0.03
# Quantile of an obstacle's heights that counts as its top. The highest of many noisy
# points would be a millimetre higher.
_TOP = 0.98
# Greatest and least height of an obstacle above its surface [m]. A marker on a table is
# not in the way.
_MAX_HEIGHT, _MIN_HEIGHT = 0.3, 0.008
# A point this near to a known object belongs to it [m]. The estimated pose may be 3 mm
# off, and points at the rim another 3 mm.
_KNOWN = 0.006


class ObstacleFinder(LeafSystem):
    """Finds things on surfaces by depth alone, and returns upright boxes around them.

    Points well above a surface are grouped by the gaps between them, as seen from
    above. "Well above" depends on the noise of the surfaces' own depth. Points of the
    best blob of a known object are left out. So are groups that reach up to 0.3 m or
    over the surface's edge: they belong to the robot or hang over the scene.

    .. pydrake_system::

        name: ObstacleFinder
        input_ports:
        - CAMERA.depth_image
        - CAMERA.body_pose_in_world
        - blobs (optional)
        output_ports:
        - obstacles

    Every camera has its two input ports, like those of BlobLocalizer. The input `blobs`
    is BlobLocalizer's output. The output `obstacles` is a list[Obstacle]. Each box
    stands on its surface and is wider than the visible thing by at most a pixel.

    Args:
        cameras: Camera name to its model.
        surfaces: The surfaces to search, without the one on which the robot stands.
        known: Shapes of the known objects, by the names in their blobs.

    Raises:
        ValueError: If there are no cameras or surfaces.
    """

    def __init__(
        self,
        cameras: Mapping[str, CameraModel],
        surfaces: Sequence[Surface],
        known: Mapping[str, Shape],
    ):
        super().__init__()
        if not cameras or not surfaces:
            raise ValueError("ObstacleFinder needs at least one camera and one surface")
        self._imagers = {name: model.imager("depth") for name, model in cameras.items()}
        self._rays = {
            name: imager.rays(
                slice(0, imager.info.width()), slice(0, imager.info.height())
            ).astype(np.float32)
            for name, imager in self._imagers.items()
        }
        self._surfaces = tuple(surfaces)
        self._known = dict(known)
        declare_camera_ports(self, cameras, ("depth_image", "body_pose_in_world"))
        blobs: list[Blob] = []
        self.DeclareAbstractInputPort("blobs", AbstractValue.Make(blobs))
        obstacles: list[Obstacle] = []
        self.DeclareAbstractOutputPort(
            "obstacles",
            lambda: AbstractValue.Make(obstacles),
            self._calc_obstacles,
            {self.all_input_ports_ticket()},
        )

    def _calc_obstacles(self, context: Context, output: AbstractValue) -> None:
        seen = [self._points(context, camera) for camera in self._imagers]
        points = np.concatenate([points for points, _ in seen])
        pixel = max(pixel for _, pixel in seen)
        margin = _KNOWN + 2 * pixel
        points = points[~self._is_known(context, points, margin)]
        output.set_value(
            [
                _box_around(group, surface.height, 0.5 * pixel)
                for group in _groups(points, 2 * pixel)
                if (surface := self._carrier(group)) is not None
            ]
        )

    def _points(self, context: Context, camera: str) -> tuple[Vector, float]:
        """Return the points well above surfaces that a camera sees.

        Returns:
            The points in W [m], shape (n, 3), and the width of a pixel there [m].
        """
        imager = self._imagers[camera]
        depth = eval_camera_port(self, context, camera, "depth_image")[..., 0]
        X_WB = eval_camera_port(self, context, camera, "body_pose_in_world")
        X_WD = X_WB @ imager.X_BI
        R_WD, p_WD = X_WD.rotation().matrix(), X_WD.translation()
        # The median removes single pixels, holes among them.
        depth = cv2.medianBlur(np.nan_to_num(depth, posinf=0.0), 3)
        rays = self._rays[camera]
        z = p_WD[2] + depth * cv2.transform(rays, R_WD[2:])
        lowest = min(surface.height for surface in self._surfaces)

        def p_W(pixels: Mask, step: int = 1) -> Vector:
            some = depth[::step, ::step][pixels]
            p_D = rays[::step, ::step][pixels] * some[:, None]
            return np.asarray(p_D @ R_WD.T + p_WD)

        # A quarter of the pixels shows how the surfaces' own points scatter.
        near = (depth > 0) & (z > lowest - _NEAR)
        least = self._least_height(p_W(near[::2, ::2], step=2))
        # Lower points need not be compared with each surface.
        high = near & (z > lowest + least)
        points = p_W(high)
        height, _ = self._heights(points)
        stands = (height > least) & (height < _MAX_HEIGHT)
        if not stands.any():
            return np.zeros((0, 3)), 0.0
        farthest = float(depth[high][stands].max())
        return points[stands], farthest / imager.info.focal_x()

    def _heights(self, p_W: Vector) -> tuple[Vector, Mask]:
        """Return the heights of points above their surface, and which have a surface.

        Points without a surface get their height above the lowest one [m], shape (n,).
        """
        lowest = min(surface.height for surface in self._surfaces)
        height, on_surface = p_W[:, 2] - lowest, np.zeros(len(p_W), bool)
        for surface in self._surfaces:
            above = surface.contains(p_W)
            height[above] = p_W[above, 2] - surface.height
            on_surface |= above
        return height, on_surface

    def _least_height(self, p_W: Vector) -> float:
        """Return the height above which points stand on the surfaces [m].

        Args:
            p_W: Points of the surfaces, among others, shape (n, 3).
        """
        height, on_surface = self._heights(p_W)
        flat = height[on_surface & (np.abs(height) < _NEAR)]
        if not len(flat):
            return _MIN_HEIGHT
        offset = float(np.median(flat))
        noise = robust_deviation(flat - offset)
        return offset + max(_MIN_HEIGHT, _DEVIATIONS * noise)

    def _is_known(self, context: Context, points: Vector, margin: float) -> Mask:
        """Return which points belong to the most trustworthy blob of a known object."""
        known = np.zeros(len(points), bool)
        port = self.GetInputPort("blobs")
        blobs: list[Blob] = port.Eval(context) if port.HasValue(context) else []
        for name, shape in self._known.items():
            own = [blob for blob in blobs if blob.object_name == name]
            if own:
                blob = max(own, key=lambda blob: blob.trust)
                p_O = (points - blob.position) @ blob.X_WO.rotation().matrix()
                known |= signed_distance(shape, p_O)[0] < margin
        return known

    def _carrier(self, group: Vector) -> Surface | None:
        """Return the surface on which a group of points stands, if any."""
        for surface in self._surfaces:
            top = group[:, 2].max() - surface.height
            if surface.contains(group, _NEAR).all() and top < _MAX_HEIGHT - _NEAR:
                return surface
        return None


def _groups(points: Vector, gap: float) -> Iterator[Vector]:
    """Yield groups of enough points with gaps below about `gap` [m].

    Args:
        points: Shape (n, 3) [m]; gaps are those seen from above.
        gap: Width of the cells in which the points are counted [m].
    """
    if len(points) == 0:
        return
    cells = ((points[:, :2] - points[:, :2].min(axis=0)) / gap).astype(int) + 1
    taken = np.zeros(cells.max(axis=0) + 2, np.uint8)
    taken[cells[:, 0], cells[:, 1]] = 1
    count, labels = cv2.connectedComponents(taken, connectivity=8)
    label = labels[cells[:, 0], cells[:, 1]]
    for i in range(1, count):
        if (label == i).sum() >= _LEAST_PIXELS:
            yield points[label == i]


def _box_around(group: Vector, height: float, margin: float) -> Obstacle:
    """Return the narrowest upright box around points (n, 3), from `height` up [m].

    Args:
        group: The points [m].
        height: Height of the surface on which they stand [m].
        margin: Margin of the box on each side [m].
    """
    middle = group[:, :2].mean(axis=0)
    center, sides, yaw = narrowest_rectangle(group[:, :2] - middle)
    x, y = middle + center
    length, width = sides + 2 * margin
    tall = float(np.quantile(group[:, 2], _TOP)) - height
    return Obstacle(
        Box([float(length), float(width), tall]),
        RigidTransform(RotationMatrix.MakeZRotation(yaw), [x, y, height + tall / 2]),
    )
