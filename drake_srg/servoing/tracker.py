"""What trackers of a coloured object in one camera's images share."""

from __future__ import annotations

import zlib
from typing import Any

import numpy.typing as npt
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from drake_srg.lifetime import LeafSystem
from drake_srg.servoing.sightings import Sighting
from drake_srg.servoing.silhouette import silhouette
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.color import ColorRange
from drake_srg.vision.mask import Mask


class Tracker(LeafSystem):
    """Base of the trackers; it declares their ports and finds the object's pixels.

    Args:
        color: Of the object.
        camera: The camera's model.
        min_area: Smaller regions do not count [pixels].
        nothing: A sighting of nothing, of the type of the port `sighting`.

    Raises:
        ValueError: If colour and depth image do not show the same pixels.
    """

    def __init__(
        self,
        color: ColorRange,
        camera: CameraModel,
        *,
        min_area: int,
        nothing: Sighting,
    ) -> None:
        super().__init__()
        if not camera.imager("color").same_as(camera.imager("depth")):
            name = type(self).__name__
            raise ValueError(f"{name} needs colour and depth images of the same pixels")
        self._color, self._min_area = color, min_area
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
        region = silhouette(self._color.mask(color), min_area=self._min_area)
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
