"""Where a known solid is, given the depth pixels of its visible surface.

Each of several first guesses is aligned coarsely with what is seen; the one that leaves
the least unexplained is aligned finely. Whatever part of the surface and the outline
shows takes part, so a solid half hidden still gives its whole pose.
"""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.types import Cylinder, Shape, Sphere, Vector
from drake_srg.vision.guesses import guess_poses, guess_upright
from drake_srg.vision.outline import Outline
from drake_srg.vision.pose_fit import align
from drake_srg.vision.sight import INSIDE, OUTSIDE, Sight, look
from drake_srg.vision.solids import bounding_size, signed_distance
from drake_srg.vision.view import View

# What other values change is measured by experiment localizer_thresholds.

# Softness of the outline [pixels]: a guess is a few off. A label tells where an edge is
# with a standard deviation of 0.29, all of them together tell more.
_COARSE, _MIDDLE, _FINE = (3.0, 1.0), (0.3,), (0.1, 0.03)
_EXPLAINED = 0.03  # of a blob's pixels: another guess will hardly leave fewer
# Likewise; so much more must a pose that leans explain. Nothing stands that leans a
# little, but a size that is 1 % off, and blur, look like 3 degrees.
_UPRIGHT = 0.1
_MOST_UNEXPLAINED = 0.1  # of a blob's pixels; with more it may not be this solid
_ANOTHER = 0.35  # with more it is another thing's blob
_DEVIATIONS = 4.0  # of noise; of 16 000 normal values one is beyond
# m; farther below what is beside it a solid is in no recess, farther above on nothing.
_APART = 0.01
_LEAST_PIXELS = 8  # of a solid's top, and of what is around it, to tell its height
_FEW = 3  # guesses, the nearest ones, where there is noise; each takes time
_STANDS = np.cos(np.deg2rad(15.0))  # as boxes are taken to stand
_BESIDE = 5  # pixels around it that tell where it stands
_WRONG = 1e-3  # m; what Fit calls uncertain
_RING = 72  # samples of the outline, for its quality: every 5 degrees of a circle
_MOST_DEVIATIONS = np.array([1e-3, np.deg2rad(1.0)])  # Fit.uncertain: [m], [rad]
_SLIDES = (1.75, 2.5)  # pixels; along its axis a solid may not move so far unnoticed
# Of the blob's pixels, those that look through the solid; noise makes some at its rim.
_MOST_THROUGH = 0.05
_FRAYED = 1.5  # pixels; nearer to the outline, depth may be that of either side
_ON_OUTLINE = np.sqrt(0.5)  # pixels; farther off it, no part of a pixel is on it
_LEAST_COLORED = 0.1  # of the surface; with less it may be something else's
_UP = np.array([0.0, 0.0, 1.0])


@dc.dataclass(frozen=True)
class Fit:
    """Position of a shape.

    Attributes:
        position: Centre p_WO [m], shape (3,).
        axis: The shape's z axis in W, shape (3,); a cylinder's points upwards.
        quality: Share of the expected outline seen, 0 .. 1.
        cut: Part of the expected outline lies outside the image.
        hidden: More than a tenth of the outline in the image was not found.
        uncertain: The position may be off by 1 mm or the axis by a degree.
        misfit: Pixels that speak against the shape, as a share of the blob's, and how
            far it is from standing on what is around, as a share of its height.
    """

    position: Vector
    axis: Vector
    quality: float
    cut: bool
    hidden: bool
    uncertain: bool
    misfit: float


def fit_shape(shape: Shape, view: View) -> Fit | None:
    """The centre and axis of `shape`, or None where the view shows too little of it."""
    view = _within_reach(shape, view)
    points = view.points()[view.blob & view.valid]
    if len(points) < 3:
        return None
    start, upright = _start(shape, view, points)
    middle = align(shape, start, view, _MIDDLE, upright=upright)
    X_WO = align(shape, middle.X_WO, view, _FINE, upright=upright).X_WO
    axis = X_WO.rotation().matrix()[:, 2]
    if isinstance(shape, Sphere):
        axis = _UP
    elif isinstance(shape, Cylinder):
        axis = axis * np.copysign(1.0, axis[2])
    sight = look(shape, X_WO, view, margin=_BESIDE)
    lift = _lift(shape, X_WO, sight)
    if _unexplained(sight, view) > _ANOTHER or lift < -_APART:
        return None
    deviations = np.array([middle.position_deviation, middle.axis_deviation])
    uncertain = (deviations > _MOST_DEVIATIONS).any()
    return Fit(
        X_WO.translation(),
        axis,
        *_seen(sight, Outline.of(shape, X_WO, view), view),
        uncertain=bool(uncertain) or _doubtful(shape, X_WO, view, sight),
        misfit=_unexplained(sight, view) + _through(sight) + abs(lift) / shape.height,
    )


def _within_reach(shape: Shape, view: View) -> View:
    """A view whose blob is without pixels that are too far off to be of one solid.

    Where something hides a part of it, its colour runs over onto that.
    """
    usable = view.blob & view.valid
    if not usable.any():
        return view
    points = view.points()
    off = np.linalg.norm(points - np.median(points[usable], axis=0), axis=-1)
    return dc.replace(view, blob=usable & (off <= np.linalg.norm(bounding_size(shape))))


def _start(shape: Shape, view: View, points: Vector) -> tuple[RigidTransform, bool]:
    """The pose that explains most, coarsely, and whether it is held upright.

    Most things stand. Where there is noise, it hides small leans; a solid whose depth
    is that of one that stands is then taken to stand, unless something else explains
    far more. What hangs from a hand may have turned in it, and is free to lean.
    """
    best, least, upright = RigidTransform(), np.inf, False
    if view.noise and not isinstance(shape, Sphere):
        guess = guess_upright(shape, view)
        best = align(shape, guess, view, _COARSE, upright=True).X_WO
        sight = look(shape, best, view, margin=0)
        scatter = 1.4826 * float(np.median(np.abs(sight.error[sight.blob])))
        # Without its top in sight, its height is anybody's guess.
        top = best.translation()[2] + 0.5 * bounding_size(shape)[2]
        tops = sight.blob & (
            np.abs(sight.points[:, 2] - top) < max(_WRONG, _DEVIATIONS * view.noise)
        )
        upright = scatter <= 2 * view.noise and tops.sum() >= _LEAST_PIXELS
        if upright:
            least = _unexplained(sight, view)
            upright = not _hangs(shape, best, view)
            if least <= _EXPLAINED:
                return best, upright
            least -= _UPRIGHT * upright
    guesses = _by_distance(shape, guess_poses(shape, view), points)
    for guess in guesses[: _FEW if view.noise else None]:
        X_WO = align(shape, guess, view, _COARSE).X_WO
        unexplained = _unexplained(look(shape, X_WO, view, margin=0), view)
        if unexplained < least:
            best, least, upright = X_WO, unexplained, False
        if least <= _EXPLAINED:
            break
    return best, upright


def _hangs(shape: Shape, X_WO: RigidTransform, view: View) -> bool:
    """Whether an upright solid is far above all around it that is not what holds it.

    Where nothing is seen around it, that is far below.
    """
    sight = look(shape, X_WO, view, margin=_BESIDE)
    bottom = X_WO.translation()[2] - 0.5 * shape.height
    around = (sight.labels == OUTSIDE) & (sight.distance > _FRAYED)
    points = sight.points[around]
    z = np.where(np.isfinite(points).all(axis=1), points[:, 2], -np.inf)
    z = z[z < bottom + _APART]
    return len(z) >= _LEAST_PIXELS and bool(np.median(z) < bottom - _APART)


def _by_distance(
    shape: Shape, guesses: list[RigidTransform], points: Vector
) -> list[RigidTransform]:
    """The guesses, those to whose surface the points are nearest first."""

    def distance(X_WO: RigidTransform) -> float:
        p_O = (points - X_WO.translation()) @ X_WO.rotation().matrix()
        return float(np.abs(signed_distance(shape, p_O)[0]).mean())

    return sorted(guesses, key=distance)


def _unexplained(sight: Sight, view: View) -> float:
    """Pixels that speak against a pose, as a share of those of the blob.

    They are the blob's where not on the surface, and others that look through it.
    """
    wrong = max(_WRONG, _DEVIATIONS * view.noise)
    missed = sight.blob & (np.abs(sight.error) > wrong)
    if view.noise:  # which frays edges
        missed &= np.abs(sight.distance) > _FRAYED
    through = ~sight.blob & (sight.labels == OUTSIDE) & (sight.distance < -_FRAYED)
    return float((missed.sum() + through.sum()) / sight.blob.sum())


def _through(sight: Sight) -> float:
    """Pixels inside the outline that look past the solid, as a share of the blob's.

    One on the outline may be either.
    """
    through = (sight.labels == OUTSIDE) & (sight.distance < -_ON_OUTLINE)
    return float(through.sum() / sight.blob.sum())


def _doubtful(shape: Shape, X_WO: RigidTransform, view: View, sight: Sight) -> bool:
    """Whether a pose leaves much unexplained, or others explain as much.

    Where both ends of a solid are hidden, it may slide along its axis unnoticed.
    """
    unexplained = _unexplained(sight, view)
    surface = sight.surface & (sight.distance < -1)
    colored = sight.blob.sum() / max(1, surface.sum())
    distance = float(np.linalg.norm(X_WO.translation() - view.origin))
    slides = np.maximum(
        np.array(_SLIDES) * distance / view.focal[0], 1.5 * _DEVIATIONS * view.noise
    )
    slid = (X_WO @ RigidTransform([0.0, 0.0, z]) for z in (*slides, *-slides))
    return (
        unexplained > _MOST_UNEXPLAINED
        or _through(sight) > _MOST_THROUGH
        or colored < _LEAST_COLORED
        or any(
            _unexplained(look(shape, X, view, margin=0), view) <= unexplained
            for X in slid
        )
    )


def _lift(shape: Shape, X_WO: RigidTransform, sight: Sight) -> float:
    """How far the lower end of a solid that stands is above what is around it [m].

    Often only the top of an upright solid is seen: a lower thing, taken for it, would
    reach into the table, and a higher one hover. 0 where that is not to be seen.
    """
    around = (sight.labels == OUTSIDE) & (sight.distance > _FRAYED)
    around &= np.isfinite(sight.points).all(axis=1)
    upright = abs(X_WO.rotation().matrix()[2, 2])
    if isinstance(shape, Sphere) or upright < _STANDS or around.sum() < _LEAST_PIXELS:
        return 0.0
    bottom = X_WO.translation()[2] - 0.5 * shape.height
    return float(bottom - np.median(sight.points[around, 2]))


def _seen(sight: Sight, outline: Outline, view: View) -> tuple[float, bool, bool]:
    """Quality, cut, hidden of an outline between two rings of pixels."""
    labels = np.full(view.depth.shape, OUTSIDE, dtype=np.int8)
    labels[tuple(sight.pixels.T[::-1])] = np.where(sight.surface, INSIDE, sight.labels)
    h, w = view.depth.shape
    in_image, found = np.ones(_RING, bool), np.ones(_RING, bool)
    # Where nothing is in doubt: depth's median of 3 x 3 reaches a pixel on.
    beside = _FRAYED + bool(view.noise)
    for grow, expected in ((-beside, INSIDE), (beside, OUTSIDE)):
        pixels = np.rint(outline.ring(grow, _RING)).astype(int)
        u, v = pixels[:, 0], pixels[:, 1]
        in_image &= (u >= 0) & (v >= 0) & (u < w) & (v < h)
        found &= labels[np.clip(v, 0, h - 1), np.clip(u, 0, w - 1)] == expected
    found &= in_image
    missing = (in_image & ~found).mean()
    return float(found.mean()), bool((~in_image).any()), bool(missing > 0.1)
