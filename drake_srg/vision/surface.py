"""Where things stand."""

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
        """Which of the points (n, 2 or 3) are above it, or within a margin [m]."""
        low, high = np.array(self.min) - margin, np.array(self.max) + margin
        inside = (p_W[:, :2] >= low) & (p_W[:, :2] <= high)
        return np.asarray(inside.all(axis=1))
