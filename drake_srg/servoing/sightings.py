"""What a camera in the hand shows, as the servos read it."""

from __future__ import annotations

import dataclasses as dc
from typing import Any

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.types import Vector


@dc.dataclass(frozen=True, eq=False)
class PoseSighting:
    """An object's pose in one image."""

    frame: int = 0  # equal for equal images
    # The object in the colour imager C (z into the scene) [m]; None: it is not seen.
    X_CO: RigidTransform | None = None

    def __deepcopy__(self, memo: dict[int, Any]) -> PoseSighting:
        return self


@dc.dataclass(frozen=True, eq=False)
class FeatureSighting:
    """Image points of an object in one image."""

    frame: int = 0  # equal for equal images
    # Image coordinates at focal length 1, shape (n, 2), and depths [m], shape (n,); n =
    # 0: the object is not in the image, or not all of it.
    points: Vector = dc.field(default_factory=lambda: np.zeros((0, 2)))
    depths: Vector = dc.field(default_factory=lambda: np.zeros(0))

    def __deepcopy__(self, memo: dict[int, Any]) -> FeatureSighting:
        return self
