"""Image points of a coloured object: the ends of its silhouette's ellipse."""

from __future__ import annotations

import zlib
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from drake_srg.lifetime import LeafSystem
from drake_srg.servoing.sightings import FeatureSighting
from drake_srg.types import Vector
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.color import ColorRange
from drake_srg.vision.mask import Mask, has_depth


def silhouette(mask: Mask, *, min_area: int) -> Mask | None:
    """Return the largest connected region of a mask, shape (h, w).

    Args:
        mask: Pixels of the object's colour, shape (h, w).
        min_area: Smaller regions do not count [pixels].

    Returns:
        None if there is no such region, or if it touches the border of the image.
    """
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    areas = stats[1:, cv2.CC_STAT_AREA]
    if not len(areas) or areas.max() < min_area:
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
    axes. A disc's are on its rim.

    Args:
        region: Shape (h, w).

    Returns:
        Columns and rows, shape (4, 2) [pixels].
    """
    rows, columns = np.nonzero(region)
    middle = np.array([columns.mean(), rows.mean()])
    u, v = 2.0 * columns.std(), 2.0 * rows.std()
    return middle + np.array([[u, 0.0], [-u, 0.0], [0.0, v], [0.0, -v]])


class SilhouetteTracker(LeafSystem):
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
        color: Of the object.
        camera: The camera's model.
        min_area: Smaller regions do not count [pixels].

    Raises:
        ValueError: If colour and depth image do not show the same pixels.
    """

    def __init__(
        self, color: ColorRange, camera: CameraModel, *, min_area: int = 50
    ) -> None:
        super().__init__()
        if not camera.imager("color").same_as(camera.imager("depth")):
            raise ValueError(
                "SilhouetteTracker needs colour and depth images of the same pixels"
            )
        self._color, self._min_area = color, min_area
        info = camera.color
        self._focal = np.array([info.focal_x(), info.focal_y()])
        self._center = np.array([info.center_x(), info.center_y()])
        self._center -= camera.pixel_center
        for name, value in (
            ("color_image", ImageRgba8U()),
            ("depth_image", ImageDepth32F()),
        ):
            self.DeclareAbstractInputPort(
                name=name, model_value=AbstractValue.Make(value)
            )
        self.DeclareAbstractOutputPort(
            name="sighting",
            alloc=lambda: AbstractValue.Make(FeatureSighting()),
            calc=self._calc_sighting,
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

    def _calc_sighting(self, context: Context, output: AbstractValue) -> None:
        color: npt.NDArray[Any] = self.GetInputPort("color_image").Eval(context).data
        depth = self.GetInputPort("depth_image").Eval(context).data[..., 0]
        frame = zlib.crc32(color.tobytes())
        region = silhouette(self._color.mask(color), min_area=self._min_area)
        if region is None or not np.any(region & has_depth(depth)):
            output.set_value(FeatureSighting(frame))
            return
        points = (ellipse_ends(region) - self._center) / self._focal
        z = float(np.median(depth[region & has_depth(depth)]))
        output.set_value(FeatureSighting(frame, points, np.full(4, z)))
