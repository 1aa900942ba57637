"""How noisy a depth image is, and what is left of that when it is cleaned."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

Depth = npt.NDArray[np.float32]

# An image with less noise is left as it is [1/m]: 0.05 mm at 1.5 m is a twentieth of
# what matters, and cleaning rounds corners.
_NOISELESS = 2e-5
_LEAST_KNOWN = 3  # of the eight neighbours of a hole
_LAG = 4  # pixels; farther than noise is alike


def clean(depth: Depth) -> tuple[Depth, float]:
    """A depth image without what single pixels add to it.

    Args:
        depth: Along the imager's z [m], shape (height, width); 0 or not finite where
            nothing is known.

    Returns:
        The image, by a median of 3 x 3 pixels where it is noisy, and the noise left:
        the standard deviation of 1 / depth [1/m], about that of depth at 1 m.
    """
    if depth_noise(depth) < _NOISELESS:
        return depth, 0.0
    cleaned: Depth = np.asarray(cv2.medianBlur(_filled(depth), 3), np.float32)
    return cleaned, depth_noise(cleaned)


def _filled(depth: Depth) -> Depth:
    """A depth image whose single holes have the median of their neighbours.

    A median that took holes for near or far would move edges, where most of them are.
    Of two middle values the nearer and the farther one are taken in turns.
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
    filled[rows, columns] = np.where(known >= _LEAST_KNOWN, median, 0.0)
    return filled


def depth_noise(depth: Depth) -> float:
    """Standard deviation of the inverse of a depth image [1/m].

    On a plane 1 / depth is linear in the pixels, so that second differences are noise.
    Their median bears edges, as long as most of what is seen is smooth. That of stereo
    and of triangulation is the same everywhere in 1 / depth.
    """
    known = np.isfinite(depth) & (depth > 0)
    inverse = np.divide(1.0, depth, out=np.full(depth.shape, np.nan), where=known)
    left, middle, right = (
        inverse[:, i : inverse.shape[1] - 2 * _LAG + i] for i in (0, _LAG, 2 * _LAG)
    )
    differences = np.abs(left - 2 * middle + right)
    differences = differences[np.isfinite(differences)]
    if len(differences) == 0:
        return 0.0
    return float(1.4826 * np.median(differences) / np.sqrt(6))
