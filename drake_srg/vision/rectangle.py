"""The narrowest rectangle around points of a plane."""

from __future__ import annotations

import cv2
import numpy as np

from drake_srg.types import Vector

# OpenCV computes in single precision, which suits units of 0.1 mm.
_SCALE = 1e4


def narrowest_rectangle(points: Vector) -> tuple[Vector, Vector, float]:
    """Return the rectangle of least area that holds points.

    Args:
        points: Shape (n, 2), n > 0, near the origin [m].

    Returns:
        Its centre (2,) and its sides (2,) [m], and the angle from x to the first
        side [rad].
    """
    middle, sides, degrees = cv2.minAreaRect((_SCALE * points).astype(np.float32))
    return np.array(middle) / _SCALE, np.array(sides) / _SCALE, np.deg2rad(degrees)
