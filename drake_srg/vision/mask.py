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


def window(mask: Mask, margin: int) -> tuple[slice, slice]:
    """Return rows and columns of the window around a mask's pixels, at least one.

    Args:
        mask: Shape (h, w).
        margin: How much larger the window is on each side, within the image [pixels].
    """

    def extent(hits: npt.NDArray[Any]) -> slice:
        found = np.flatnonzero(hits)
        first, last = int(found[0]) - margin, int(found[-1]) + margin
        return slice(max(0, first), min(len(hits), last + 1))

    return extent(np.any(mask, axis=1)), extent(np.any(mask, axis=0))


def has_depth(depth: npt.NDArray[Any]) -> Mask:
    """Return which pixels of a depth image hold a depth: 0 is too near, inf too far."""
    return np.asarray(np.isfinite(depth) & (depth > 0))
