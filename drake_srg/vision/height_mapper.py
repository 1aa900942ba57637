"""Maps the heights of things on a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.perception import PointCloud
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageDepth32F

from drake_srg.lifetime import LeafSystem
from drake_srg.types import HeightMap, Vector
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.height_map import THING, height_map, points_of
from drake_srg.vision.surface import Surface

# Points per side of a pixel. At 1.5 m a pixel of a 640x480 image is 2.6 mm wide, wider
# than a cell.
SUBPIXELS = 2


class HeightMapper(LeafSystem):
    """Maps the heights of things on a table from depth images.

    It knows no shapes and no colours. The noise of each image is reduced, the maps of
    all cameras are merged, and regions that reach too high are unknown because they
    belong to the robot (see `height_map`).

    .. pydrake_system::

        name: HeightMapper
        input_ports:
        - CAMERA.depth_image
        - CAMERA.body_pose_in_world
        output_ports:
        - height_map
        - point_cloud

    Every camera has its two input ports, like those of BlobLocalizer. `height_map` is a
    HeightMap, `point_cloud` a pydrake.perception.PointCloud of all that the cameras
    see, in world [m]. Both are computed when they are evaluated.

    Args:
        cameras: Camera name to its model.
        surface: The table, or the part of it that is mapped.
        resolution: Width of a cell [m].
        max_height: Greatest height of a thing above the surface [m].
        ignored: Parts of the surface that stay unknown, such as where furniture stands.
        thing: See `height_map` [m].
        over_edge: See `height_map`.

    Raises:
        ValueError: If there are no cameras, or a number is not positive.
    """

    def __init__(
        self,
        cameras: Mapping[str, CameraModel],
        surface: Surface,
        *,
        resolution: float = 0.002,
        max_height: float = 0.35,
        ignored: Sequence[Surface] = (),
        thing: float = THING,
        over_edge: bool = False,
    ) -> None:
        super().__init__()
        if not cameras:
            raise ValueError("HeightMapper needs at least one camera")
        if not (resolution > 0.0 and max_height > 0.0):
            raise ValueError(
                "HeightMapper needs resolution > 0 and max_height > 0, got "
                f"resolution={resolution}, max_height={max_height}"
            )
        self._imagers = {name: model.imager("depth") for name, model in cameras.items()}
        self._surface = surface
        self._resolution, self._max_height = resolution, max_height
        self._ignored = tuple(ignored)
        self._thing, self._over_edge = thing, over_edge
        for camera in cameras:
            self.DeclareAbstractInputPort(
                f"{camera}.depth_image", AbstractValue.Make(ImageDepth32F())
            )
            self.DeclareAbstractInputPort(
                f"{camera}.body_pose_in_world", AbstractValue.Make(RigidTransform())
            )
        empty = HeightMap(np.zeros(2), resolution, np.zeros((0, 0)))
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
                resolution=self._resolution,
                max_height=self._max_height,
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
        inputs = []
        for name in ("depth_image", "body_pose_in_world"):
            port = self.GetInputPort(f"{camera}.{name}")
            if not port.HasValue(context):
                raise RuntimeError(
                    f"HeightMapper's input port {port.get_name()!r} is not connected"
                )
            inputs.append(port.Eval(context))
        image, X_WB = inputs
        return points_of(
            image.data[..., 0],
            X_WB,
            self._imagers[camera],
            subpixels=subpixels,
            within=within,
        )
