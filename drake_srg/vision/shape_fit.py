"""Finds the pose of a known solid from the depth pixels of its visible surface.

Each of several first guesses is aligned coarsely with the view. The one that leaves the
least unexplained is aligned finely. Every visible part of the surface and the outline
takes part, so a solid that is half hidden still gives its whole pose.
"""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.common.convex_pieces import Solid
from drake_srg.types import Sphere
from drake_srg.vision.config import BlobLocalizerConfig
from drake_srg.vision.fit_start import find_start
from drake_srg.vision.match import Match
from drake_srg.vision.outline import Outline
from drake_srg.vision.sight import INSIDE, OUTSIDE, Sight
from drake_srg.vision.symmetry import least_turned
from drake_srg.vision.view import View


@dc.dataclass(frozen=True)
class Fit:
    """The fitted pose of a solid.

    Attributes:
        X_WO: The pose; of those that look alike, the one that is turned least.
        quality: Share of the expected outline that is seen, 0 .. 1.
        cut: Whether a part of the expected outline lies outside the image.
        hidden: Whether more than a tenth of the outline in the image was not found.
        uncertain: Whether the position may be off by 1 mm or the axis by a degree.
        misfit: Pixels that speak against the solid, as a share of the blob's, plus how
            far it is from standing on its surroundings, as a share of its height.
    """

    X_WO: RigidTransform
    quality: float
    cut: bool
    hidden: bool
    uncertain: bool
    misfit: float


def fit_shape(shape: Solid, view: View, config: BlobLocalizerConfig) -> Fit | None:
    """Return the fit of a solid, None if the view shows too little or something else.

    Args:
        shape: The solid.
        view: The view of its blob.
        config: The thresholds.
    """
    view = _within_reach(shape, view)
    if len(view.seen) < 3:
        return None
    return _Fitter(Match(shape, view, config)).fit()


def _within_reach(shape: Solid, view: View) -> View:
    """Return a view whose blob holds no pixels that are too far off for one solid.

    Where something hides a part of the solid, the solid's colour bleeds onto it.
    """
    usable = view.blob & view.valid
    if not usable.any():
        return view
    points = view.points
    off = np.linalg.norm(points - np.median(points[usable], axis=0), axis=-1)
    return dc.replace(view, blob=usable & (off <= np.linalg.norm(shape.bounding_size)))


class _Fitter:
    """Fits a solid to a view of its blob, which has depth."""

    def __init__(self, match: Match) -> None:
        self._match = match
        self._shape, self._view = match.shape, match.view
        self._limits = match.config.fit

    def fit(self) -> Fit | None:
        """Return the fit, None if the blob belongs to something else."""
        limits, match = self._limits, self._match
        start = find_start(match)
        upright = start.upright
        middle = match.align(start.X_WO, limits.middle_softness, upright=upright)
        X_WO = match.align(middle.X_WO, limits.fine_softness, upright=upright).X_WO
        sight = match.look(X_WO, margin=limits.beside)
        lift = self._lift(X_WO, sight)
        unexplained = match.unexplained(sight)
        if unexplained > limits.another_object or lift < -limits.apart:
            return None
        unsure = (
            start.has_rival
            or middle.position_deviation > limits.position_deviation
            or middle.axis_deviation > limits.axis_deviation
        )
        quality, cut, hidden = self._seen(sight, X_WO)
        return Fit(
            least_turned(match.shape, X_WO),
            quality,
            cut,
            hidden,
            uncertain=unsure or not quality or self._doubtful(X_WO, sight),
            misfit=unexplained + self._through(sight) + abs(lift) / match.shape.height,
        )

    def _through(self, sight: Sight) -> float:
        """Return the pixels that look past the solid, as a share of the blob's.

        They are inside the outline. A pixel on the outline may be either.
        """
        inside = sight.distance < -self._limits.on_outline
        return float(((sight.labels == OUTSIDE) & inside).sum() / sight.blob.sum())

    def _doubtful(self, X_WO: RigidTransform, sight: Sight) -> bool:
        """Return whether a pose leaves much unexplained, or others explain as much.

        If both ends of a solid are hidden, it may slide along its axis unnoticed.
        """
        limits, view, match = self._limits, self._view, self._match
        unexplained = match.unexplained(sight)
        surface = sight.surface & (sight.distance < -1)
        colored = sight.blob.sum() / max(1, surface.sum())
        distance = float(np.linalg.norm(X_WO.translation() - view.origin))
        slides = np.maximum(
            np.array(limits.slides) * distance / view.focal[0],
            1.5 * limits.deviations * view.noise,
        )
        slid = (X_WO @ RigidTransform([0.0, 0.0, z]) for z in (*slides, *-slides))
        return (
            unexplained > limits.most_unexplained
            or self._through(sight) > limits.most_through
            or bool(colored < limits.least_colored)
            or any(
                self._match.unexplained(self._match.look(X)) <= unexplained
                for X in slid
            )
        )

    def _lift(self, X_WO: RigidTransform, sight: Sight) -> float:
        """Return how far a standing solid's lower end is above its surroundings [m].

        Often only the top of an upright solid is seen. A lower thing that is taken for
        it would reach into the table, and a higher one would hover. It is 0 if the
        solid does not stand or its surroundings are not seen.
        """
        limits = self._limits
        around = self._match.around(sight) & np.isfinite(sight.points).all(axis=1)
        upright = abs(X_WO.rotation().matrix()[2, 2])
        if (
            isinstance(self._shape, Sphere)
            or upright < np.cos(limits.most_standing_lean)
            or around.sum() < limits.least_pixels
        ):
            return 0.0
        bottom = X_WO.translation()[2] - 0.5 * self._shape.height
        return float(bottom - np.median(sight.points[around, 2]))

    def _seen(self, sight: Sight, X_WO: RigidTransform) -> tuple[float, bool, bool]:
        """Return `quality`, `cut` and `hidden` of a fit, from two rings of pixels."""
        view, outline = self._view, Outline.of(self._shape, X_WO, self._view)
        labels = np.full(view.depth.shape, OUTSIDE, dtype=np.int8)
        known = np.where(sight.surface, INSIDE, sight.labels)
        labels[tuple(sight.pixels.T[::-1])] = known
        h, w = view.depth.shape
        in_image = found = np.array(True)
        # Where pixels are not in doubt: the median of 3 x 3 reaches one pixel farther.
        beside = self._limits.frayed + bool(view.noise)
        for grow, expected in ((-beside, INSIDE), (beside, OUTSIDE)):
            pixels = np.rint(outline.ring(grow, self._limits.ring)).astype(int)
            u, v = pixels[:, 0], pixels[:, 1]
            in_image = in_image & (u >= 0) & (v >= 0) & (u < w) & (v < h)
            label = labels[np.clip(v, 0, h - 1), np.clip(u, 0, w - 1)]
            found = found & (label == expected)
        found &= in_image
        missing = (in_image & ~found).mean()
        return float(found.mean()), bool((~in_image).any()), bool(missing > 0.1)
