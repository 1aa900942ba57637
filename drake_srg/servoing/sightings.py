"""What a camera in the hand shows, as the servos read it."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.common.shared import Shared
from drake_srg.types import Vector


@dc.dataclass(frozen=True, eq=False)
class Taken:
    """When an image was taken, and where the arm was then."""

    time: float = -np.inf  # by the servo's clock [s]
    q: Vector = dc.field(default_factory=lambda: np.zeros(0))  # shape (N,) [rad]


@dc.dataclass(frozen=True, eq=False)
class Sighting(Shared):
    """What one image shows; base class."""

    frame: int = 0  # equal for equal images
    # When the image was taken, by the clock of camera and arm [s]; NaN: now.
    stamp: float = dc.field(default=np.nan, kw_only=True)
    # The same by the servo's clock, and where the arm was; None: now.
    taken: Taken | None = dc.field(default=None, kw_only=True)


@dc.dataclass(frozen=True, eq=False)
class PoseSighting(Sighting):
    """An object's pose in one image."""

    # The object in the colour imager C (z into the scene) [m]; None: it is not seen.
    X_CO: RigidTransform | None = None


@dc.dataclass(frozen=True, eq=False)
class FeatureSighting(Sighting):
    """Image points of an object in one image."""

    # Image coordinates at focal length 1, shape (n, 2), and depths [m], shape (n,); n =
    # 0: the object is not in the image, or not all of it.
    points: Vector = dc.field(default_factory=lambda: np.zeros((0, 2)))
    depths: Vector = dc.field(default_factory=lambda: np.zeros(0))
