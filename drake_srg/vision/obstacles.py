"""Finds what stands on tables and is none of the known objects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import cv2
import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageDepth32F

from drake_srg.lifetime import LeafSystem
from drake_srg.types import Blob, Box, Cylinder, Obstacle, Shape, Vector
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.mask import Mask
from drake_srg.vision.solids import signed_distance
from drake_srg.vision.surface import Surface

# What other values change is measured by experiment localizer_thresholds.
_DEVIATIONS = 5.0  # of noise; of three million normal values one is beyond
_LEAST_PIXELS = 8  # of an obstacle; what noise makes is a few
# m; what is as near to a surface is mostly the surface, and tells how well its height
# is seen.
_NEAR = 0.03
# Quantile of heights that is the top: the highest of many noisy points is a millimetre
# higher yet.
_TOP = 0.98
# m; what is nearer to a known object belongs to it, which may be 3 mm off where it is
# seen, as its rim may.
_KNOWN = 0.006


class ObstacleFinder(LeafSystem):
    """Upright boxes around what stands on surfaces, by its depth alone.

    Points well above a surface are grouped by their gaps as seen from above. What
    belongs to the best blob of a known object is left out, and so is what does not
    stand there: a group that reaches up to `max_height` or over the surface's edge
    belongs to the robot or to what hangs over the scene. How much is "well above"
    follows from how noisy the surfaces' own depth is.

    .. pydrake_system::

        name: ObstacleFinder
        input_ports:
        - CAMERA.depth_image
        - CAMERA.body_pose_in_world
        - blobs (optional)
        output_ports:
        - obstacles

    Every camera has its two input ports, as those of BlobLocalizer, whose output is the
    input `blobs`. The output `obstacles` is a list[Obstacle]; each stands on its
    surface, and the boxes are a pixel or less wider than what is seen.

    Args:
        cameras: Camera name to its model.
        surfaces: Where to look. What the robot stands on should not be among them.
        known: Shapes of the known objects, by the names in their blobs.
        max_height: Of what is looked for, above its surface [m].
        min_height: Likewise; a marker on a table is nothing in the way [m].

    Raises:
        ValueError: If there are no cameras or surfaces, or the heights are not
            0 < min_height < max_height.
    """

    def __init__(
        self,
        cameras: Mapping[str, CameraModel],
        surfaces: Sequence[Surface],
        known: Mapping[str, Shape],
        *,
        max_height: float = 0.3,
        min_height: float = 0.008,
    ):
        super().__init__()
        if not cameras or not surfaces:
            raise ValueError("ObstacleFinder needs at least one camera and one surface")
        if not 0.0 < min_height < max_height:
            raise ValueError(
                f"ObstacleFinder has min_height={min_height}, max_height={max_height}; "
                "allowed is 0 < min_height < max_height"
            )
        self._imagers = {name: model.imager("depth") for name, model in cameras.items()}
        self._rays = {
            name: imager.rays(
                slice(0, imager.info.width()), slice(0, imager.info.height())
            ).astype(np.float32)
            for name, imager in self._imagers.items()
        }
        self._surfaces = tuple(surfaces)
        self._known = {name: _all_around(shape) for name, shape in known.items()}
        self._max_height, self._min_height = max_height, min_height
        for camera in cameras:
            for port, model in (
                ("depth_image", ImageDepth32F()),
                ("body_pose_in_world", RigidTransform()),
            ):
                self.DeclareAbstractInputPort(
                    f"{camera}.{port}", AbstractValue.Make(model)
                )
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
        points = points[~self._is_known(context, points, _KNOWN + 2 * pixel)]
        output.set_value(
            [
                _box_around(group, surface.height, 0.5 * pixel)
                for group in _groups(points, 2 * pixel)
                if (surface := self._carrier(group)) is not None
            ]
        )

    def _points(self, context: Context, camera: str) -> tuple[Vector, float]:
        """Points well above surfaces, in W [m], and how wide a pixel is there [m]."""
        imager = self._imagers[camera]
        depth = self.GetInputPort(f"{camera}.depth_image").Eval(context).data[..., 0]
        X_WB = self.GetInputPort(f"{camera}.body_pose_in_world").Eval(context)
        X_WD = X_WB @ imager.X_BI
        R_WD, p_WD = X_WD.rotation().matrix(), X_WD.translation()
        # Takes away single pixels, holes among them.
        depth = cv2.medianBlur(np.nan_to_num(depth, posinf=0.0), 3)
        # What is beside or below all surfaces need not be looked at closer.
        z = p_WD[2] + depth * cv2.transform(self._rays[camera], R_WD[2:])
        lowest = min(surface.height for surface in self._surfaces)
        near = (depth > 0) & (z > lowest - _NEAR)
        p_D = self._rays[camera][near] * depth[near][:, None]
        p_W = cv2.transform(p_D[:, None], R_WD)[:, 0] + p_WD
        height, on_surface = p_W[:, 2] - lowest, np.zeros(len(p_W), bool)
        for surface in self._surfaces:
            above = surface.contains(p_W)
            height[above] = p_W[above, 2] - surface.height
            on_surface |= above
        flat = height[on_surface & (np.abs(height) < _NEAR)]
        offset = float(np.median(flat)) if len(flat) else 0.0
        noise = 1.4826 * float(np.median(np.abs(flat - offset))) if len(flat) else 0.0
        least = offset + max(self._min_height, _DEVIATIONS * noise)
        stands = (height > least) & (height < self._max_height)
        if not stands.any():
            return np.zeros((0, 3)), 0.0
        return p_W[stands], float(p_D[stands, 2].max()) / imager.info.focal_x()

    def _is_known(self, context: Context, points: Vector, margin: float) -> Mask:
        """Which points belong to the most trustworthy blob of a known object."""
        known = np.zeros(len(points), bool)
        port = self.GetInputPort("blobs")
        blobs: list[Blob] = port.Eval(context) if port.HasValue(context) else []
        for name, shape in self._known.items():
            own = [blob for blob in blobs if blob.object_name == name]
            if own:
                blob = max(own, key=lambda blob: blob.trust)
                R_WO = RotationMatrix.MakeFromOneVector(blob.axis, 2)
                p_O = (points - blob.position) @ R_WO.matrix()
                known |= signed_distance(shape, p_O)[0] < margin
        return known

    def _carrier(self, group: Vector) -> Surface | None:
        """The surface on which a group of points stands, None where on none."""
        for surface in self._surfaces:
            top = group[:, 2].max() - surface.height
            if surface.contains(group, _NEAR).all() and top < self._max_height - _NEAR:
                return surface
        return None


def _all_around(shape: Shape) -> Shape:
    """A shape, or the cylinder around a box, whose turn a blob does not tell."""
    if not isinstance(shape, Box):
        return shape
    radius = 0.5 * float(np.linalg.norm(shape.size[:2]))
    return Cylinder(radius, shape.height)


def _groups(points: Vector, gap: float) -> Iterator[Vector]:
    """Points (n, 3) that are less than about `gap` from others, seen from above."""
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
    """The narrowest upright box around points (n, 3), from `height` up."""
    scale = 1e4  # OpenCV works in single precision; 0.1 mm units suit it
    middle = group[:, :2].mean(axis=0)
    center, sides, degrees = cv2.minAreaRect(
        (scale * (group[:, :2] - middle)).astype(np.float32)
    )
    x, y = middle + np.array(center) / scale
    length, width = np.array(sides) / scale + 2 * margin
    tall = float(np.quantile(group[:, 2], _TOP)) - height
    return Obstacle(
        Box([float(length), float(width), tall]),
        RigidTransform(
            RotationMatrix.MakeZRotation(np.deg2rad(degrees)), [x, y, height + tall / 2]
        ),
    )
