"""The silhouette of a coloured object, and the ends of its ellipse."""

from __future__ import annotations

import cv2
import numpy as np

from drake_srg.types import Vector
from drake_srg.vision.mask import Mask


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
