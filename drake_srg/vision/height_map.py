"""Height maps of the things on a table, from depth images."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence

import cv2
import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.perception import PointCloud
from pydrake.systems.framework import Context

from drake_srg.lifetime import LeafSystem
from drake_srg.types import HeightMap, Vector
from drake_srg.vision.camera import (
    CameraModel,
    Imager,
    declare_camera_ports,
    eval_camera_port,
)
from drake_srg.vision.images import Mask, clean, grow, has_depth
from drake_srg.vision.surfaces import Surface

# A pixel is a patch: if its centre is up to this far outside the mapped surface, it may
# still cover a part of it [m].
_AROUND = 0.02
_RESOLUTION = 0.002  # width of a cell [m]
_HOLE = 2  # width of holes that are filled [cells]
_MAX_HEIGHT = 0.35  # greatest height of a thing above the surface [m]
# Cells higher above the surface than this [m] form regions. The map drops regions that
# reach too high or over the edge.
THING = 0.008
# The map is also unknown this far around a dropped region [cells].
_FRINGE = 4
# Cells this near to the surface [m] mostly show the surface itself, so their median
# corrects the heights. With fewer than `_LEAST_FLAT` of them, there is no correction.
_NEAR = 0.01
_LEAST_FLAT = 200


def points_of(
    depth: Vector,
    X_WB: RigidTransform,
    imager: Imager,
    *,
    subpixels: int = 1,
    within: Surface | None = None,
) -> Vector:
    """Return the points that a depth image shows, in world, shape (n, 3) [m].

    Args:
        depth: Along the imager's z [m], shape (height, width).
        X_WB: Pose of the camera's body in world.
        imager: Its depth imager.
        subpixels: Points along each side of a pixel, which is a patch of one depth.
        within: Keep only points above or below this surface, or within 2 cm of its
            edges; None keeps all.
    """
    cleaned = clean(np.asarray(depth, np.float32))
    rows, columns = np.nonzero(has_depth(cleaned))
    z = cleaned[rows, columns].astype(float)
    X_WD = X_WB @ imager.X_BI
    R_WD, p_WD = X_WD.rotation().matrix(), X_WD.translation()
    x, y = imager.slopes(columns, rows)
    # Row by row: n is large, and numpy is fast along contiguous memory.
    p_W = np.stack([z * (r[0] * x + r[1] * y + r[2]) for r in R_WD])
    p_W += p_WD[:, np.newaxis]
    if within is not None:
        near = within.contains(p_W.T, _AROUND)
        p_W, z = p_W[:, near], z[near]
    offsets = (np.arange(subpixels) + 0.5) / subpixels - 0.5
    focal = np.array([imager.info.focal_x(), imager.info.focal_y()])
    cloud = np.empty((3, subpixels**2, len(z)))
    for i, offset in enumerate(itertools.product(offsets, repeat=2)):
        step = R_WD[:, :2] @ (offset / focal)
        np.multiply.outer(step, z, out=cloud[:, i])
        cloud[:, i] += p_W
    return cloud.reshape(3, -1).T


def height_map(
    clouds: Iterable[Vector],
    surface: Surface,
    *,
    ignored: Iterable[Surface] = (),
    thing: float = THING,
    over_edge: bool = False,
) -> HeightMap:
    """Return the heights of things above a surface, and the surface's own height.

    A cell holds the height of its highest point in all clouds. Holes as narrow as a
    pixel are filled from their surroundings. A region that rises above 0.35 m belongs
    to the arm and becomes unknown. So does a region that reaches over the surface's
    edge, unless `over_edge`.

    Args:
        clouds: Points that each camera sees, in world [m], shape (n, 3) each.
        surface: The surface to map.
        ignored: Parts of the surface that stay unknown, such as those under furniture.
        thing: Replaces `THING` [m].
        over_edge: Whether the map keeps things that reach over its edge. Set it only if
            the robot is out of view, because the robot also reaches over the edge.
    """
    low, high = np.array(surface.min), np.array(surface.max)
    nx, ny = np.maximum(np.floor((high - low) / _RESOLUTION).astype(int), 1)
    origin = low + 0.5 * _RESOLUTION
    height = np.full((ny, nx), -np.inf)
    for cloud in clouds:
        seen = _highest(cloud, origin, (ny, nx))
        seen += _offset(seen, surface.height)
        height = np.fmax(height, seen)
    height[~np.isfinite(height)] = np.nan
    height = _filled(height)
    for part in ignored:
        height[_covered(part, origin, height.shape)] = np.nan
    things = height > surface.height + thing
    seeds = height > surface.height + _MAX_HEIGHT
    if not over_edge:
        seeds |= _at_edge(things)
    strange = _connected(things, seeds)
    height[grow(strange, _FRINGE)] = np.nan
    return HeightMap(origin, _RESOLUTION, height)


def _highest(cloud: Vector, origin: Vector, shape: tuple[int, int]) -> Vector:
    """Return the height of the highest point in each cell, -inf without a point."""
    x, y, z = cloud.T
    ix, iy = (
        np.rint((p - start) / _RESOLUTION).astype(np.int32)
        for p, start in zip((x, y), origin, strict=True)
    )
    inside = (ix >= 0) & (iy >= 0) & (ix < shape[1]) & (iy < shape[0])
    height = np.full(shape[0] * shape[1], -np.inf)
    np.maximum.at(height, (iy * shape[1] + ix)[inside], z[inside])
    return height.reshape(shape)


def _offset(height: Vector, level: float) -> float:
    """Return the correction of a camera's heights, from its view of the surface [m].

    The highest of several noisy points is too high on average, and a camera's pose has
    errors.
    """
    flat = height[np.abs(height - level) < _NEAR] - level
    if len(flat) < _LEAST_FLAT:
        return 0.0
    return -float(np.median(flat))


def _covered(part: Surface, origin: Vector, shape: tuple[int, int]) -> Mask:
    """Return the cells whose centre is in a part of the surface."""
    x, y = (
        start + _RESOLUTION * np.arange(count)
        for start, count in zip(origin, shape[::-1], strict=True)
    )
    inside_x = (x >= part.min[0]) & (x <= part.max[0])
    inside_y = (y >= part.min[1]) & (y <= part.max[1])
    return np.asarray(inside_y[:, np.newaxis] & inside_x)


def _filled(height: Vector) -> Vector:
    """Return a map whose holes of at most `_HOLE` cells take their lowest neighbour.

    A hole is more often a shadow beside a thing than a part of its top.
    """
    filled = height.copy()
    for _ in range((_HOLE + 1) // 2):
        missing = np.isnan(filled)
        # Erosion takes the least, and inf stands for missing cells.
        known = np.where(missing, np.inf, filled).astype(np.float32)
        lowest = cv2.erode(known, np.ones((3, 3), np.uint8), borderValue=np.inf)
        filled[missing] = np.where(np.isfinite(lowest), lowest, np.nan)[missing]
    return filled


def _at_edge(things: Mask) -> Mask:
    """Return the cells at the map's edge that belong to things."""
    inner = np.zeros_like(things)
    inner[1:-1, 1:-1] = True
    return np.asarray(things & ~inner)


def _connected(things: Mask, seeds: Mask) -> Mask:
    """Return the connected regions of `things` that hold a seed."""
    count, labels = cv2.connectedComponents(things.astype(np.uint8), connectivity=8)
    chosen = np.zeros(count, bool)
    chosen[labels[seeds & things]] = True
    return np.asarray(chosen[labels])


# Points per side of a pixel. At 1.5 m a pixel of a 640x480 image is 2.6 mm wide, wider
# than a cell.
SUBPIXELS = 2


class HeightMapper(LeafSystem):
    """Maps the heights of things on a table from depth images.

    It uses no shapes and no colours. It reduces the noise of each image and merges the
    maps of all cameras. Regions that reach too high become unknown, because they belong
    to the robot (see `height_map`).

    .. pydrake_system::

        name: HeightMapper
        input_ports:
        - CAMERA.depth_image
        - CAMERA.body_pose_in_world
        output_ports:
        - height_map
        - point_cloud

    Every camera has its two input ports, like those of BlobLocalizer. `height_map` is a
    HeightMap. `point_cloud` is a pydrake.perception.PointCloud of everything that the
    cameras see, in world [m]. Both are computed only when they are evaluated.

    Args:
        cameras: Camera name to its model.
        surface: The table, or the part of it that is mapped.
        ignored: Parts of the surface that stay unknown, such as those under furniture.
        thing: See `height_map` [m].
        over_edge: See `height_map`.

    Raises:
        ValueError: If there are no cameras.
    """

    def __init__(
        self,
        cameras: Mapping[str, CameraModel],
        surface: Surface,
        *,
        ignored: Sequence[Surface] = (),
        thing: float = THING,
        over_edge: bool = False,
    ) -> None:
        super().__init__()
        if not cameras:
            raise ValueError("HeightMapper needs at least one camera")
        self._imagers = {name: model.imager("depth") for name, model in cameras.items()}
        self._surface = surface
        self._ignored = tuple(ignored)
        self._thing, self._over_edge = thing, over_edge
        declare_camera_ports(self, cameras, ("depth_image", "body_pose_in_world"))
        empty = HeightMap(np.zeros(2), _RESOLUTION, np.zeros((0, 0)))
        for name, model, calc in (
            ("height_map", empty, self._calc_height_map),
            ("point_cloud", PointCloud(), self._calc_point_cloud),
        ):
            self.DeclareAbstractOutputPort(
                name,
                lambda model=model: AbstractValue.Make(model),
                calc,
                {self.all_input_ports_ticket()},
            )

    def _calc_height_map(self, context: Context, output: AbstractValue) -> None:
        clouds = [
            self._points(context, camera, SUBPIXELS, self._surface)
            for camera in self._imagers
        ]
        output.set_value(
            height_map(
                clouds,
                self._surface,
                ignored=self._ignored,
                thing=self._thing,
                over_edge=self._over_edge,
            )
        )

    def _calc_point_cloud(self, context: Context, output: AbstractValue) -> None:
        points = np.concatenate([self._points(context, c, 1) for c in self._imagers])
        cloud = PointCloud(len(points))
        cloud.mutable_xyzs()[:] = points.T
        output.set_value(cloud)

    def _points(
        self,
        context: Context,
        camera: str,
        subpixels: int,
        within: Surface | None = None,
    ) -> Vector:
        """Return the points that a camera sees, in world, shape (n, 3) [m]."""
        return points_of(
            eval_camera_port(self, context, camera, "depth_image")[..., 0],
            eval_camera_port(self, context, camera, "body_pose_in_world"),
            self._imagers[camera],
            subpixels=subpixels,
            within=within,
        )
