"""Names of colours, as people use them for things on a table."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from drake_srg.vision.color import ColorImage

# Where each hue ends [degrees]; what is beyond the last is red again.
_ENDS = {
    "red": 16.0,
    "orange": 42.0,
    "yellow": 72.0,
    "green": 165.0,
    "cyan": 190.0,
    "blue": 255.0,
    "purple": 295.0,
    "pink": 340.0,
}
_NEUTRAL = ("black", "grey", "white")
COLORS: tuple[str, ...] = (*_ENDS, *_NEUTRAL)
NUM_HUES = len(_ENDS)
# What is less saturated or darker than this has no hue (0 .. 1).
_LEAST_SATURATION, _LEAST_VALUE = 0.3, 0.15
# The greatest values of black and of grey (0 .. 1).
_BLACK, _GREY = 0.25, 0.75


def color_names(image: ColorImage) -> npt.NDArray[np.int8]:
    """Return the index in `COLORS` of each pixel; the first `NUM_HUES` have a hue.

    Args:
        image: RGB or RGBA, shape (height, width, 3 or 4), 0 .. 255.

    Returns:
        Shape (height, width).
    """
    rgb = np.ascontiguousarray(image[..., :3]).astype(np.float32) / 255.0
    hue, saturation, value = np.moveaxis(cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV), -1, 0)
    hues = np.searchsorted(list(_ENDS.values()), hue, side="right") % NUM_HUES
    neutral = NUM_HUES + np.searchsorted([_BLACK, _GREY], value)
    dull = (saturation < _LEAST_SATURATION) | (value < _LEAST_VALUE)
    return np.asarray(np.where(dull, neutral, hues), np.int8)


def color_name(rgb: list[float]) -> str:
    """Return the name of one colour, red, green and blue 0 .. 1."""
    pixel = np.rint(255.0 * np.array(rgb[:3])).astype(np.uint8)
    return COLORS[color_names(pixel.reshape(1, 1, 3))[0, 0]]
