"""Colour ranges of targets, and names of colours."""

from __future__ import annotations

import colorsys
import dataclasses as dc
from collections.abc import Sequence
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

from drake_srg.vision.images import Mask

ColorImage = npt.NDArray[np.uint8]
Triple = tuple[float, float, float]

# The channels' greatest values, in the units of `ColorRange`.
_FULL_SCALE = {"hsv": (360.0, 1.0, 1.0), "rgb": (1.0, 1.0, 1.0)}

# Largest change of red and blue over green by a light [natural logarithm].
# Lamps of 3000 to 8000 K differ from daylight by factors of up to 1.3 and 1.5 (black
# bodies in sRGB's primaries).
_LIGHT_CHANGE = np.array([0.26, 0.41])
# Quantile of the image's values that shows how bright the light is. Brighter pixels may
# be lamps and reflections.
_BRIGHT_QUANTILE = 0.9
# Least brightness of a shaded object, as a share of its brightness in full light.
_SHADED = 0.4
_DARK = 8.0  # a camera's reading of black [counts of 255]
_SAMPLES = 9  # of a colour range along each channel
_HUE_TOLERANCE = 12.0  # of an object of given colour [degrees]


@dc.dataclass(frozen=True)
class ColorRange:
    """An inclusive range of colours.

    In "hsv", the channels are hue [degrees, 0 .. 360], saturation and value [0 .. 1]. A
    lower hue above the upper one wraps through red at 0. In "rgb", they are red, green
    and blue [0 .. 1]. HSV suits coloured objects, because shading changes mainly the
    value.

    Raises:
        ValueError: If a bound lies outside its channel or the bounds are swapped.
    """

    lower: Triple
    upper: Triple
    space: Literal["hsv", "rgb"] = "hsv"

    def __post_init__(self) -> None:
        if self.space not in _FULL_SCALE:
            raise ValueError(
                f"ColorRange.space must be 'hsv' or 'rgb', got {self.space!r}"
            )
        for i, top in enumerate(_FULL_SCALE[self.space]):
            low, high = self.lower[i], self.upper[i]
            channel = f"ColorRange channel {self.space[i]!r}"
            if not (0.0 <= low <= top and 0.0 <= high <= top):
                raise ValueError(
                    f"{channel} must be within 0 .. {top:g}, got [{low}, {high}]"
                )
            if low > high and not self._is_hue(i):
                raise ValueError(
                    f"{channel}: lower must not exceed upper (only a hue wraps), "
                    f"got [{low}, {high}]"
                )

    @classmethod
    def around(cls, rgb: Sequence[float]) -> ColorRange:
        """Return the range in which an object of diffuse colour `rgb` appears.

        Shading lowers the value of a coloured object but keeps its hue. A grey object
        has no hue, so only its value identifies it.

        Args:
            rgb: Red, green, blue [0 .. 1]; a fourth entry (alpha) is ignored.
        """
        h, s, v = colorsys.rgb_to_hsv(*(float(x) for x in rgb[:3]))
        if s < 0.05:
            return cls((0.0, 0.0, max(0.0, v - 0.3)), (360.0, 0.1, min(1.0, v + 0.1)))
        return cls(
            ((360.0 * h - _HUE_TOLERANCE) % 360.0, 0.6 * s, 0.1 * v),
            ((360.0 * h + _HUE_TOLERANCE) % 360.0, min(1.0, 1.4 * s + 0.05), 1.0),
        )

    def mask(self, image: ColorImage) -> Mask:
        """Return which pixels lie in the range.

        Args:
            image: RGB or RGBA, shape (height, width, 3 or 4), 0 .. 255.

        Returns:
            Shape (height, width).
        """
        pixels: npt.NDArray[Any] = np.ascontiguousarray(image[..., :3])
        if self.space == "hsv":
            pixels = cv2.cvtColor(pixels, cv2.COLOR_RGB2HSV_FULL)
        scale = 255.0 / np.array(_FULL_SCALE[self.space])
        low = np.floor(np.array(self.lower) * scale)
        high = np.ceil(np.array(self.upper) * scale)
        if low[0] <= high[0]:
            return np.asarray(cv2.inRange(pixels, low, high) > 0)
        to_red = cv2.inRange(pixels, low, np.array([255.0, *high[1:]]))
        from_red = cv2.inRange(pixels, np.array([0.0, *low[1:]]), high)
        return np.asarray((to_red > 0) | (from_red > 0))

    def mask_in_any_light(self, image: ColorImage) -> Mask:
        """Return which pixels may show a colour of the range under any lamp.

        Light, exposure and shading multiply the channels, so the ratio of two channels
        changes by the same factor as that ratio of the light.

        Args:
            image: RGB or RGBA, shape (height, width, 3 or 4), 0 .. 255.

        Returns:
            Shape (height, width).
        """
        samples = np.stack(
            np.meshgrid(*np.linspace(*self._unwrapped(), _SAMPLES).T), axis=-1
        ).reshape(-1, 3)
        if self.space == "hsv":
            samples = np.array(
                [colorsys.hsv_to_rgb(h / 360.0 % 1.0, s, v) for h, s, v in samples]
            )
        bright = np.maximum(samples.max(axis=1, keepdims=True), 1e-3)
        known = _ratios(255.0 * samples / bright)
        # A table of logarithms, because computing one for every pixel takes long.
        red, green, blue = np.moveaxis(image[..., :3], -1, 0)
        logs = _log(np.arange(256))
        log_green = logs[green]
        low, high = known.min(axis=0) - _LIGHT_CHANGE, known.max(axis=0) + _LIGHT_CHANGE
        value = np.maximum(np.maximum(red, green), blue)
        # The brightest parts of the scene show how bright the light is.
        scene = np.quantile(value, _BRIGHT_QUANTILE)
        least = _SHADED * float(bright.min()) * scene
        # Nearly black pixels are left out: their logarithm is noise.
        fits = value > max(2 * _DARK, least)
        for channel, lowest, highest in zip((red, blue), low, high, strict=True):
            ratio = logs[channel] - log_green
            fits &= (ratio >= lowest) & (ratio <= highest)
        return np.asarray(fits)

    def _unwrapped(self) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        """Return the bounds with the lower hue below the upper one."""
        lower, upper = np.array(self.lower), np.array(self.upper)
        if lower[0] > upper[0]:
            upper[0] += 360.0
        return lower, upper

    def _is_hue(self, channel: int) -> bool:
        return self.space == "hsv" and channel == 0


def _ratios(colors: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the logarithms of red and blue over green.

    Args:
        colors: 0 .. 255, shape (..., 3).

    Returns:
        Shape (..., 2).
    """
    logs = _log(colors)
    return np.asarray(logs[..., ::2] - logs[..., 1:2])


def _log(values: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    """Return the logarithms of values plus a camera's reading of black."""
    return np.log(np.asarray(values, np.float32) + np.float32(_DARK))


# Upper end of each hue [degrees]; beyond the last end, the hue is red again.
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
# A colour less saturated or darker than this has no hue (0 .. 1).
_LEAST_SATURATION, _LEAST_VALUE = 0.3, 0.15
# The greatest values of black and of grey (0 .. 1).
_BLACK, _GREY = 0.25, 0.75


def color_names(image: ColorImage) -> npt.NDArray[np.int8]:
    """Return the index in `COLORS` of each pixel; indices below `NUM_HUES` are hues.

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
