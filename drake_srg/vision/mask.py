"""Boolean images."""

from __future__ import annotations

from typing import Any, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

Mask: TypeAlias = npt.NDArray[np.bool_]


def grow(mask: Mask, pixels: int) -> Mask:
    """Return a mask extended by some pixels on all sides, diagonals included."""
    kernel = np.ones((2 * pixels + 1,) * 2, np.uint8)
    return np.asarray(cv2.dilate(mask.astype(np.uint8), kernel) > 0)


def has_depth(depth: npt.NDArray[Any]) -> Mask:
    """Return which pixels of a depth image hold a depth: 0 is too near, inf too far."""
    return np.asarray(np.isfinite(depth) & (depth > 0))
