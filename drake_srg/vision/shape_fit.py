"""The pose of a known solid, from the depth pixels of its visible surface.

Several first guesses are aligned coarsely with the view. The guess that leaves the
fewest pixels unexplained is then aligned finely. The fit uses every visible part of the
surface and of the outline, so it also finds the pose of a half-hidden solid.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence
from operator import itemgetter

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.common.geometry import ConvexPieces, Solid
from drake_srg.types import Sphere, Vector
from drake_srg.vision.guesses import (
    WORTH_A_FIT,
    are_rivals,
    guess_poses,
    guess_rivals,
    guess_upright,
)
from drake_srg.vision.images import Mask, robust_deviation
from drake_srg.vision.pose_fit import Alignment, align
from drake_srg.vision.sight import INSIDE, OUTSIDE, Outline, Sight, View, look
from drake_srg.vision.solids import least_turned, signed_distance

# Softness of the outline in the stages of a fit [pixels]. A guess is a few pixels off.
# One label locates an edge with a standard deviation of 0.29 pixels, and all labels
# together are more exact.
_COARSE_SOFTNESS = (3.0, 1.0)
_MIDDLE_SOFTNESS = (0.3,)
_FINE_SOFTNESS = (0.1, 0.03)
# A guess that leaves at most this share of the blob's pixels unexplained is good
# enough: others would hardly be better.
_EXPLAINED = 0.03
# A leaning pose replaces an upright one only if the additional pixels that it explains
# are more than this share of the blob. Nothing stands at a slight lean, but blur or an
# error of 1 % in size looks like a lean of 3 degrees.
_UPRIGHT_MARGIN = 0.1
# With a greater unexplained share, the fit is uncertain: it may be another solid.
_MOST_UNEXPLAINED = 0.1
# With a greater unexplained share, the blob belongs to another thing.
_ANOTHER_OBJECT = 0.35
# Limit of noise [standard deviations]: one in 16,000 normal values exceeds it.
_DEVIATIONS = 4.0
# A solid this far below its surroundings [m] is not in a recess; this far above them,
# it stands on nothing.
_APART = 0.01
# Pixels of a solid's top, and of its surroundings, that are needed to judge its height.
_LEAST_PIXELS = 8
# Number of guesses that are aligned in noisy images, the nearest first, to save time.
_NOISY_GUESSES = 3
# A solid that leans more than this does not stand [rad].
_MOST_STANDING_LEAN = np.deg2rad(15.0)
# Width of the band around a solid that shows where it stands [pixels].
_BESIDE = 5
# A point farther off the surface is not explained [m]. A position with this error is
# `Fit.uncertain`.
_OFF_SURFACE = 1e-3
# Samples of the outline for its quality: every 5 degrees of a circle.
_RING = 72
# Greatest standard deviations of a certain fit: position [m] and axis [rad].
_POSITION_DEVIATION = 1e-3
_AXIS_DEVIATION = np.deg2rad(1.0)
# A fit is certain only if it gets worse when the solid slides this far along its axis
# [pixels].
_SLIDES = np.array([1.75, 2.5])
# Most pixels inside the outline that show the background, as a share of the blob's.
# Noise causes some at the rim.
_MOST_THROUGH = 0.05
# Within this distance of the outline [pixels], a pixel may have the depth of either
# side.
_FRAYED = 1.5
# Beyond this distance, no part of a pixel is on the outline [pixels].
_ON_OUTLINE = np.sqrt(0.5)
# Least share of the visible surface that has the target's colour. With less, the
# surface may belong to another thing.
_LEAST_COLORED = 0.1


@dc.dataclass(frozen=True)
class Fit:
    """The fitted pose of a solid.

    Attributes:
        X_WO: The pose. If several poses look alike, the one with the least rotation.
        quality: Share of the expected outline that is seen, 0 .. 1.
        cut: Whether part of the expected outline lies outside the image.
        hidden: Whether more than a tenth of the outline within the image was not found.
        uncertain: Whether the position may be off by 1 mm or the axis by a degree.
        misfit: Pixels that contradict the solid, as a share of the blob's, plus its
            distance from standing on its surroundings, as a share of its height.
    """

    X_WO: RigidTransform
    quality: float
    cut: bool
    hidden: bool
    uncertain: bool
    misfit: float


def fit_shape(shape: Solid, view: View) -> Fit | None:
    """Return the fit of a solid; None if the view shows too little or another thing."""
    view = _within_reach(shape, view)
    if len(view.seen) < 3:
        return None
    return _Fitter(Match(shape, view)).fit()


def _within_reach(shape: Solid, view: View) -> View:
    """Return a view whose blob lacks the pixels that are too far off to be the solid's.

    The solid's colour bleeds onto things in front of it.
    """
    usable = view.blob & view.valid
    if not usable.any():
        return view
    points = view.points
    off = np.linalg.norm(points - np.median(points[usable], axis=0), axis=-1)
    return dc.replace(view, blob=usable & (off <= np.linalg.norm(shape.bounding_size)))


@dc.dataclass(frozen=True)
class Match:
    """A solid and a view of its blob, which has depth.

    Attributes:
        shape: The solid.
        view: The view.
    """

    shape: Solid
    view: View

    def look(self, X_WO: RigidTransform, margin: int = 0) -> Sight:
        """Return the labelled pixels around the solid; see `sight.look`."""
        return look(self.shape, X_WO, self.view, margin=margin)

    def align(
        self, X_WO: RigidTransform, softnesses: Sequence[float], upright: bool = False
    ) -> Alignment:
        """Return the pose near another one that explains the view best."""
        return align(self.shape, X_WO, self.view, softnesses, upright=upright)

    @property
    def wrong(self) -> float:
        """Distance from the surface beyond which a point is not explained [m]."""
        return max(_OFF_SURFACE, _DEVIATIONS * self.view.noise)

    def around(self, sight: Sight) -> Mask:
        """Return which pixels show the solid's surroundings."""
        return np.asarray((sight.labels == OUTSIDE) & (sight.distance > _FRAYED))

    def unexplained(self, sight: Sight) -> float:
        """Return the number of pixels that contradict a pose, over the blob's number.

        These are pixels of the blob that are off the surface, and pixels within the
        outline that show something behind the solid.
        """
        missed = sight.blob & (np.abs(sight.error) > self.wrong)
        if self.view.noise:  # noise frays edges
            missed &= np.abs(sight.distance) > _FRAYED
        through = ~sight.blob & (sight.labels == OUTSIDE) & (sight.distance < -_FRAYED)
        return float((missed.sum() + through.sum()) / sight.blob.sum())


@dc.dataclass(frozen=True)
class Start:
    """A coarsely aligned pose.

    Attributes:
        X_WO: The pose.
        upright: Whether the solid's z is fixed.
        has_rival: Whether a far turned pose explains the view nearly as well.
    """

    X_WO: RigidTransform
    upright: bool = False
    has_rival: bool = False


def find_start(match: Match) -> Start:
    """Return a coarse pose that explains the view best.

    Most things stand, and noise hides small leans. So in a noisy image, a solid with
    the depth of a standing one counts as upright, unless another pose explains far
    more. A solid that hangs from a hand may lean.
    """
    view, shape = match.view, match.shape
    standing, least = Start(RigidTransform(), upright=True), np.inf
    if view.noise and not isinstance(shape, Sphere):
        guess = guess_upright(shape, view)
        X_WO = match.align(guess, _COARSE_SOFTNESS, upright=True).X_WO
        sight = match.look(X_WO)
        scatter = robust_deviation(sight.error[sight.blob])
        # Unless the top is visible, the solid's height is unknown.
        if scatter <= 2 * view.noise and _sees_top(match, X_WO, sight):
            standing = Start(X_WO, upright=not _hangs(match, X_WO))
            least = match.unexplained(sight)
            margin = _UPRIGHT_MARGIN if standing.upright else 0.0
            if least <= max(_EXPLAINED, margin):
                return standing
            least -= margin
    unexplained, start = _best_of_guesses(match)
    return start if unexplained < least else standing


def _best_of_guesses(match: Match) -> tuple[float, Start]:
    """Return the unexplained share of the best guess, and its aligned pose."""
    view, shape = match.view, match.shape
    guesses = guess_poses(shape, view)
    if isinstance(shape, ConvexPieces):
        return _best_of_pieces(match, shape, guesses)
    points = view.seen
    guesses.sort(key=lambda guess: _distance(match, guess, points))
    tried = []
    for guess in guesses[: _NOISY_GUESSES if view.noise else None]:
        tried.append(_try(match, guess))
        if tried[-1][0] <= _EXPLAINED:
            break
    least, X_WO = min(tried, key=itemgetter(0))
    return least, Start(X_WO)


def _best_of_pieces(
    match: Match, shape: ConvexPieces, guesses: list[RigidTransform]
) -> tuple[float, Start]:
    """Return the best guess of convex pieces, and whether it has rivals."""
    worth = _NOISY_GUESSES if match.view.noise else WORTH_A_FIT
    tried = [_try(match, guess) for guess in guesses[:worth]]
    if min(tried, key=itemgetter(0))[0] > _EXPLAINED:
        tried += [_try(match, guess) for guess in guesses[worth : 2 * worth]]
    best = min(tried, key=itemgetter(0))[1]
    tried += [_try(match, guess) for guess in guess_rivals(shape, best, match.view)]
    least, best = min(tried, key=itemgetter(0))
    has_rival = any(are_rivals(shape, (least, best), other) for other in tried)
    return least, Start(best, has_rival=has_rival)


def _try(match: Match, guess: RigidTransform) -> tuple[float, RigidTransform]:
    """Return the unexplained share of an aligned guess, and its pose."""
    X_WO = match.align(guess, _COARSE_SOFTNESS).X_WO
    return match.unexplained(match.look(X_WO)), X_WO


def _distance(match: Match, X_WO: RigidTransform, points: Vector) -> float:
    """Return the mean distance of points to the solid's surface [m]."""
    p_O = (points - X_WO.translation()) @ X_WO.rotation().matrix()
    return float(np.abs(signed_distance(match.shape, p_O)[0]).mean())


def _sees_top(match: Match, X_WO: RigidTransform, sight: Sight) -> bool:
    """Return whether enough pixels show the top of an upright solid."""
    top = X_WO.translation()[2] + 0.5 * match.shape.bounding_size[2]
    tops = sight.blob & (np.abs(sight.points[:, 2] - top) < match.wrong)
    return bool(tops.sum() >= _LEAST_PIXELS)


def _hangs(match: Match, X_WO: RigidTransform) -> bool:
    """Return whether an upright solid is far above its surroundings.

    Higher surroundings, such as a gripper that holds it, do not count. If there is
    nothing around it, the solid hangs.
    """
    sight = match.look(X_WO, margin=_BESIDE)
    bottom = X_WO.translation()[2] - 0.5 * match.shape.height
    points = sight.points[match.around(sight)]
    z = np.where(np.isfinite(points).all(axis=1), points[:, 2], -np.inf)
    z = z[z < bottom + _APART]
    return len(z) >= _LEAST_PIXELS and bool(np.median(z) < bottom - _APART)


class _Fitter:
    """Fits a solid to a view of its blob, which has depth."""

    def __init__(self, match: Match) -> None:
        self._match = match
        self._shape, self._view = match.shape, match.view

    def fit(self) -> Fit | None:
        """Return the fit, None if the blob belongs to something else."""
        match = self._match
        start = find_start(match)
        upright = start.upright
        middle = match.align(start.X_WO, _MIDDLE_SOFTNESS, upright=upright)
        X_WO = match.align(middle.X_WO, _FINE_SOFTNESS, upright=upright).X_WO
        sight = match.look(X_WO, margin=_BESIDE)
        lift = self._lift(X_WO, sight)
        unexplained = match.unexplained(sight)
        if unexplained > _ANOTHER_OBJECT or lift < -_APART:
            return None
        unsure = (
            start.has_rival
            or middle.position_deviation > _POSITION_DEVIATION
            or middle.axis_deviation > _AXIS_DEVIATION
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
        """Return the number of pixels that show the background, over the blob's number.

        Only pixels fully inside the outline count; one on it may show either side.
        """
        inside = sight.distance < -_ON_OUTLINE
        return float(((sight.labels == OUTSIDE) & inside).sum() / sight.blob.sum())

    def _doubtful(self, X_WO: RigidTransform, sight: Sight) -> bool:
        """Return whether a pose leaves much unexplained, or is ambiguous.

        A solid with both ends hidden fits as well after a slide along its axis.
        """
        view, match = self._view, self._match
        unexplained = match.unexplained(sight)
        surface = sight.surface & (sight.distance < -1)
        colored = sight.blob.sum() / max(1, surface.sum())
        distance = float(np.linalg.norm(X_WO.translation() - view.origin))
        slides = np.maximum(
            _SLIDES * distance / view.focal[0],
            1.5 * _DEVIATIONS * view.noise,
        )
        slid = (X_WO @ RigidTransform([0.0, 0.0, z]) for z in (*slides, *-slides))
        return (
            unexplained > _MOST_UNEXPLAINED
            or self._through(sight) > _MOST_THROUGH
            or bool(colored < _LEAST_COLORED)
            or any(
                self._match.unexplained(self._match.look(X)) <= unexplained
                for X in slid
            )
        )

    def _lift(self, X_WO: RigidTransform, sight: Sight) -> float:
        """Return how far a standing solid's lower end is above its surroundings [m].

        Often, only the top of an upright thing is visible. If that thing is lower than
        the solid, the solid would reach into the table; if it is higher, the solid
        would hover. The result is 0 if the solid does not stand or its surroundings are
        not visible.
        """
        around = self._match.around(sight) & np.isfinite(sight.points).all(axis=1)
        upright = abs(X_WO.rotation().matrix()[2, 2])
        if (
            isinstance(self._shape, Sphere)
            or upright < np.cos(_MOST_STANDING_LEAN)
            or around.sum() < _LEAST_PIXELS
        ):
            return 0.0
        bottom = X_WO.translation()[2] - 0.5 * self._shape.height
        return float(bottom - np.median(sight.points[around, 2]))

    def _seen(self, sight: Sight, X_WO: RigidTransform) -> tuple[float, bool, bool]:
        """Return `quality`, `cut` and `hidden` of a fit.

        They come from two rings of pixels, inside and outside the outline.
        """
        view, outline = self._view, Outline.of(self._shape, X_WO, self._view)
        labels = np.full(view.depth.shape, OUTSIDE, dtype=np.int8)
        known = np.where(sight.surface, INSIDE, sight.labels)
        labels[tuple(sight.pixels.T[::-1])] = known
        h, w = view.depth.shape
        in_image = found = np.array(True)
        # Nearer pixels may show either side: the 3 x 3 median adds one pixel.
        beside = _FRAYED + bool(view.noise)
        for grow, expected in ((-beside, INSIDE), (beside, OUTSIDE)):
            pixels = np.rint(outline.ring(grow, _RING)).astype(int)
            u, v = pixels[:, 0], pixels[:, 1]
            in_image = in_image & (u >= 0) & (v >= 0) & (u < w) & (v < h)
            label = labels[np.clip(v, 0, h - 1), np.clip(u, 0, w - 1)]
            found = found & (label == expected)
        found &= in_image
        missing = (in_image & ~found).mean()
        return float(found.mean()), bool((~in_image).any()), bool(missing > 0.1)
