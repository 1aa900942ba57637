"""Horizontal surfaces on which things stand."""

from __future__ import annotations

import dataclasses as dc

import numpy as np

from drake_srg.types import Vector
from drake_srg.vision.mask import Mask


@dc.dataclass(frozen=True)
class Surface:
    """A horizontal rectangle on which things stand, in world [m]."""

    min: tuple[float, float]
    max: tuple[float, float]
    height: float

    def contains(self, p_W: Vector, margin: float = 0.0) -> Mask:
        """Return which points lie above or below the rectangle.

        Args:
            p_W: Points in world [m], shape (n, 2 or 3).
            margin: How far beyond the edges counts, too [m].

        Returns:
            Shape (n,).
        """
        inside = np.ones(len(p_W), bool)
        for p, low, high in zip(p_W.T, self.min, self.max, strict=False):
            inside &= (p >= low - margin) & (p <= high + margin)
        return inside
