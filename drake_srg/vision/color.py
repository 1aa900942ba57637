"""Which colours belong to a target."""

from __future__ import annotations

import colorsys
import dataclasses as dc
from collections.abc import Sequence
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

from drake_srg.vision.mask import Mask

ColorImage = npt.NDArray[np.uint8]
Triple = tuple[float, float, float]

# What "full scale" of a channel is in the units of `ColorRange`.
_FULL_SCALE = {"hsv": (360.0, 1.0, 1.0), "rgb": (1.0, 1.0, 1.0)}

# Lamps of 3000 to 8000 K differ from daylight by up to 1.3 in red over green, 1.5 in
# blue over green (black bodies in sRGB's primaries); logarithms.
_LIGHTS = np.array([0.26, 0.41])
_BRIGHT = 0.9  # quantile of an image; more may be lamps and reflections
_SHADED = 0.4  # of what is bright, at least, for an object as bright
_DARK = 8.0  # counts; less is what a camera makes of black
_SAMPLES = 9  # of a range, a channel


@dc.dataclass(frozen=True)
class ColorRange:
    """An inclusive range of colours.

    In "hsv" the channels are hue [degrees, 0 .. 360], saturation and value
    [0 .. 1]; a lower hue above the upper one wraps through red at 0. In "rgb" they
    are red, green and blue [0 .. 1]. HSV suits coloured objects, because shading
    changes the value and little else.

    Raises:
        ValueError: If a bound lies outside its channel or the bounds are swapped.
    """

    lower: Triple
    upper: Triple
    space: Literal["hsv", "rgb"] = "hsv"

    def __post_init__(self) -> None:
        if self.space not in _FULL_SCALE:
            raise ValueError(
                f"ColorRange.space is {self.space!r}; allowed are 'hsv' and 'rgb'"
            )
        for i, top in enumerate(_FULL_SCALE[self.space]):
            low, high = self.lower[i], self.upper[i]
            channel = f"ColorRange channel {self.space[i]!r}"
            if not (0.0 <= low <= top and 0.0 <= high <= top):
                raise ValueError(
                    f"{channel} is [{low}, {high}]; allowed are 0 .. {top:g}"
                )
            if low > high and not self._hue(i):
                raise ValueError(
                    f"{channel} is [{low}, {high}]; lower must not exceed upper "
                    "(only a hue wraps)"
                )

    @classmethod
    def around(cls, rgb: Sequence[float], hue_tolerance: float = 12.0) -> ColorRange:
        """The range an object of diffuse colour `rgb` is seen in, shaded or not.

        A coloured object keeps its hue, and shading lowers its value; a grey one has
        no hue, so it is told by its value.

        Args:
            rgb: Red, green, blue [0 .. 1]; a fourth entry (alpha) is ignored.
            hue_tolerance: Accepted deviation of the hue [degrees].
        """
        h, s, v = colorsys.rgb_to_hsv(*(float(x) for x in rgb[:3]))
        if s < 0.05:
            return cls((0.0, 0.0, max(0.0, v - 0.3)), (360.0, 0.1, min(1.0, v + 0.1)))
        return cls(
            ((360.0 * h - hue_tolerance) % 360.0, 0.6 * s, 0.1 * v),
            ((360.0 * h + hue_tolerance) % 360.0, min(1.0, 1.4 * s + 0.05), 1.0),
        )

    def mask(self, image: ColorImage) -> Mask:
        """Which pixels lie in the range.

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
        """Which pixels may show a colour of the range, whatever lamp it is seen by.

        Light, exposure and shading multiply the channels, so that the ratio of two of
        them changes by as much as the light's own does.

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
        known, seen = _ratios(255.0 * samples / bright), _ratios(image[..., :3])
        low, high = known.min(axis=0) - _LIGHTS, known.max(axis=0) + _LIGHTS
        value = image[..., :3].max(axis=-1)
        # What is bright in the scene tells how bright the light is.
        least = _SHADED * float(bright.min()) * np.quantile(value, _BRIGHT)
        # The logarithm of what is nearly black is noise.
        light = value > max(2 * _DARK, least)
        return np.asarray(((seen >= low) & (seen <= high)).all(axis=-1) & light)

    def _unwrapped(self) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        """The bounds, the lower hue below the upper one."""
        lower, upper = np.array(self.lower), np.array(self.upper)
        if lower[0] > upper[0]:
            upper[0] += 360.0
        return lower, upper

    def _hue(self, channel: int) -> bool:
        return self.space == "hsv" and channel == 0


def _ratios(colors: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Logarithms of red and of blue over green, shape (..., 2), of colours 0 .. 255."""
    logs = np.log(np.asarray(colors, np.float32) + np.float32(_DARK))
    return np.asarray(logs[..., ::2] - logs[..., 1:2])
