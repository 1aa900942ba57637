"""Compares a solid, at some pose, with a view of it."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.common.convex_pieces import Solid
from drake_srg.vision.config import BlobLocalizerConfig
from drake_srg.vision.mask import Mask
from drake_srg.vision.pose_fit import Alignment, align
from drake_srg.vision.sight import OUTSIDE, Sight, look
from drake_srg.vision.view import View


@dc.dataclass(frozen=True)
class Match:
    """A solid and a view of its blob, which has depth.

    Attributes:
        shape: The solid.
        view: The view.
        config: The thresholds.
    """

    shape: Solid
    view: View
    config: BlobLocalizerConfig

    def look(self, X_WO: RigidTransform, margin: int = 0) -> Sight:
        """Return what the pixels around the solid show; see `sight.look`."""
        return look(self.shape, X_WO, self.view, self.config.sight, margin=margin)

    def align(
        self, X_WO: RigidTransform, softnesses: Sequence[float], upright: bool = False
    ) -> Alignment:
        """Return the pose near another one that explains the view best."""
        return align(
            self.shape, X_WO, self.view, softnesses, self.config, upright=upright
        )

    @property
    def wrong(self) -> float:
        """Distance from the surface beyond which a point is not explained [m]."""
        limits = self.config.fit
        return max(limits.off_surface, limits.deviations * self.view.noise)

    def around(self, sight: Sight) -> Mask:
        """Return which pixels show the solid's surroundings."""
        return np.asarray(
            (sight.labels == OUTSIDE) & (sight.distance > self.config.fit.frayed)
        )

    def unexplained(self, sight: Sight) -> float:
        """Return the pixels that speak against a pose, as a share of the blob's.

        They are the blob's pixels off the surface, and others that look through it.
        """
        frayed = self.config.fit.frayed
        missed = sight.blob & (np.abs(sight.error) > self.wrong)
        if self.view.noise:  # which frays edges
            missed &= np.abs(sight.distance) > frayed
        through = ~sight.blob & (sight.labels == OUTSIDE) & (sight.distance < -frayed)
        return float((missed.sum() + through.sum()) / sight.blob.sum())
