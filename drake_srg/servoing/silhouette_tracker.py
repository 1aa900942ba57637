"""Image points of a coloured object: the ends of its silhouette's ellipse."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from drake_srg.servoing.sightings import FeatureSighting
from drake_srg.servoing.silhouette import ellipse_ends
from drake_srg.servoing.tracker import Tracker
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.color import ColorRange
from drake_srg.vision.mask import Mask, has_depth


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
        color: Of the object.
        camera: The camera's model.
        min_area: Smaller regions do not count [pixels].

    Raises:
        ValueError: If colour and depth image do not show the same pixels.
    """

    def __init__(
        self, color: ColorRange, camera: CameraModel, *, min_area: int = 50
    ) -> None:
        super().__init__(color, camera, min_area=min_area, nothing=FeatureSighting())
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
