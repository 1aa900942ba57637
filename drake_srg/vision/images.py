"""Image masks, noise of depth images, and robust statistics."""

from __future__ import annotations

from typing import Any, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from drake_srg.types import Vector

Mask: TypeAlias = npt.NDArray[np.bool_]


def grow(mask: Mask, pixels: int) -> Mask:
    """Return a mask extended by some pixels on all sides, diagonals included."""
    kernel = np.ones((2 * pixels + 1,) * 2, np.uint8)
    return np.asarray(cv2.dilate(mask.astype(np.uint8), kernel) > 0)


def window(mask: Mask, margin: int) -> tuple[slice, slice]:
    """Return rows and columns of the window around a mask's pixels.

    Args:
        mask: Shape (h, w), with at least one pixel.
        margin: Margin of the window on each side, within the image [pixels].
    """

    def extent(hits: npt.NDArray[Any]) -> slice:
        found = np.flatnonzero(hits)
        first, last = int(found[0]) - margin, int(found[-1]) + margin
        return slice(max(0, first), min(len(hits), last + 1))

    return extent(np.any(mask, axis=1)), extent(np.any(mask, axis=0))


def has_depth(depth: npt.NDArray[Any]) -> Mask:
    """Return which pixels of a depth image hold a depth: 0 is too near, inf too far."""
    return np.asarray(np.isfinite(depth) & (depth > 0))


def robust_deviation(residuals: npt.NDArray[Any]) -> float:
    """Return the standard deviation of residuals about 0, from their median.

    Args:
        residuals: Normally distributed, except for fewer than half, the outliers. An
            empty array gives NaN.
    """
    return 1.4826 * _median(np.abs(residuals))


def _median(values: npt.NDArray[Any]) -> float:
    """Return the median of values without NaN, twice as fast as np.median."""
    if values.size == 0:
        return np.nan
    middle = values.size // 2
    parts = np.partition(values, middle)
    if values.size % 2:
        return float(parts[middle])
    return float((parts[:middle].max() + parts[middle]) / 2)


# OpenCV computes in single precision, so scale to units of 0.1 mm.
_SCALE = 1e4


def narrowest_rectangle(points: Vector) -> tuple[Vector, Vector, float]:
    """Return the rectangle of least area that encloses points.

    Args:
        points: Shape (n, 2), n > 0, near the origin [m].

    Returns:
        Its centre (2,) and its sides (2,) [m], and the angle from x to the first
        side [rad].
    """
    middle, sides, degrees = cv2.minAreaRect((_SCALE * points).astype(np.float32))
    return np.array(middle) / _SCALE, np.array(sides) / _SCALE, np.deg2rad(degrees)


Depth = npt.NDArray[np.float32]
_TOO_FAR = 65535  # of Drake's ImageDepth16U


def metres(depth: npt.NDArray[Any]) -> Depth:
    """Return a depth image in metres, shape (height, width).

    Args:
        depth: Floats [m] or whole numbers of 16 bits [mm], with or without a last axis
            of length 1.

    Raises:
        ValueError: If it is of another type.
    """
    depth = depth.reshape(depth.shape[:2])
    if depth.dtype == np.uint16:
        found = depth.astype(np.float32) / 1000.0
        return np.where(depth == _TOO_FAR, np.float32(np.inf), found)
    if not np.issubdtype(depth.dtype, np.floating):
        raise ValueError(
            f"depth image: must be of floats [m] or uint16 [mm], got {depth.dtype}"
        )
    return depth.astype(np.float32, copy=False)


# Images with less noise [1/m] are not cleaned, because that rounds corners. This is
# 0.05 mm at 1.5 m, a twentieth of any relevant error.
_NOISELESS = 2e-5
# A hole is filled if at least this many of its eight neighbours are known.
_KNOWN_NEIGHBOURS = 3
# Distance between the pixels that are compared to measure noise [pixels]. The noise of
# nearer pixels is correlated.
_LAG = 4


def clean(depth: Depth) -> Depth:
    """Return a depth image without the noise of single pixels.

    Args:
        depth: Along the imager's z [m], shape (height, width); 0 or not finite where it
            is unknown.

    Returns:
        The image, filtered by a median of 3 x 3 pixels if it is noisy, otherwise
        unchanged.
    """
    differences = _second_differences(depth)
    # The noise is 0.6 times the median of their absolute values. To count small values
    # instead takes a tenth of the time.
    small = np.count_nonzero(np.abs(differences) < _NOISELESS)
    if 2 * small > differences.size or _noise(differences) < _NOISELESS:
        return depth
    return np.asarray(cv2.medianBlur(_filled(depth), 3), np.float32)


def clean_and_measure(depth: Depth) -> tuple[Depth, float]:
    """Return a depth image without the noise of single pixels, and the rest's size.

    Returns:
        The image, and the standard deviation of 1 / depth [1/m], which is about that of
        depth at 1 m.
    """
    cleaned = clean(depth)
    return cleaned, 0.0 if cleaned is depth else depth_noise(cleaned)


def _filled(depth: Depth) -> Depth:
    """Return a depth image whose single holes hold the median of their neighbours.

    Most holes are at edges. A median filter that treated them as near or far would move
    the edges. If there are two middle values, holes take the nearer and the farther one
    alternately.
    """
    image = np.pad(np.nan_to_num(depth, posinf=np.inf), 1)
    rows, columns = np.nonzero(~(depth > 0))
    around = np.stack(
        [
            image[rows + i, columns + j]
            for i in range(3)
            for j in range(3)
            if (i, j) != (1, 1)
        ]
    )
    around = np.sort(np.where(around > 0, around, np.inf), axis=0)
    known = np.isfinite(around).sum(axis=0)
    rank = np.maximum(known - (rows + columns) % 2, 0) // 2
    median = np.take_along_axis(around, rank[None], axis=0)[0]
    filled = depth.copy()
    filled[rows, columns] = np.where(known >= _KNOWN_NEIGHBOURS, median, 0.0)
    return filled


def depth_noise(depth: Depth) -> float:
    """Return the standard deviation of 1 / depth of an image [1/m].

    On a plane, 1 / depth is linear in the pixels, so second differences are noise.
    Their median tolerates edges as long as most of the image is smooth. For stereo and
    triangulation, the noise of 1 / depth is the same at all depths.
    """
    return _noise(_second_differences(depth))


def _noise(differences: Vector) -> float:
    """Return the standard deviation of 1 / depth from its second differences."""
    if len(differences) == 0:
        return 0.0
    return float(robust_deviation(differences) / np.sqrt(6))


def _second_differences(depth: Depth) -> Vector:
    """Return the known second differences of 1 / depth along rows, shape (K,) [1/m]."""
    inverse = np.divide(
        1.0, depth, out=np.full(depth.shape, np.nan), where=has_depth(depth)
    )
    left, middle, right = (
        inverse[:, i : inverse.shape[1] - 2 * _LAG + i] for i in (0, _LAG, 2 * _LAG)
    )
    differences = left - 2 * middle + right
    return np.asarray(differences[np.isfinite(differences)])
