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
from drake_srg.vision.guesses import guess_poses
from drake_srg.vision.outline import Outline
from drake_srg.vision.pose_fit import align
from drake_srg.vision.sight import INSIDE, OUTSIDE, Sight, look
from drake_srg.vision.solids import signed_distance
from drake_srg.vision.view import View

# Softness of the outline [pixels]: a guess is a few off. A label tells where an edge is
# with a standard deviation of 0.29, all of them together tell more.
_COARSE, _MIDDLE, _FINE = (3.0, 1.0), (0.3,), (0.1, 0.03)
# Of a blob's pixels: another guess will hardly leave fewer, and it is not this solid.
_EXPLAINED, _MOST_UNEXPLAINED = 0.03, 0.1
_WRONG = 1e-3  # m; a point of the blob farther off the surface speaks against a pose
_RING = 72  # samples of the outline, for its quality
_MOST_DEVIATIONS = np.array([1e-3, np.deg2rad(1.0)])  # of position [m] and axis [rad]
_SLIDE = 2.5  # pixels; along its axis a solid may not move so far unnoticed
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
    """

    position: Vector
    axis: Vector
    quality: float
    cut: bool
    hidden: bool
    uncertain: bool


def fit_shape(shape: Shape, view: View) -> Fit | None:
    """The centre and axis of `shape`, or None where the view shows too little of it."""
    points = view.points()[view.blob & view.valid]
    if len(points) < 3:
        return None
    best, least = RigidTransform(), np.inf
    for guess in _by_distance(shape, guess_poses(shape, view), points):
        X_WO = align(shape, guess, view, _COARSE).X_WO
        if (unexplained := _unexplained(look(shape, X_WO, view, margin=0))) < least:
            best, least = X_WO, unexplained
        if least <= _EXPLAINED:
            break
    middle = align(shape, best, view, _MIDDLE)
    X_WO = align(shape, middle.X_WO, view, _FINE).X_WO
    axis = X_WO.rotation().matrix()[:, 2]
    if isinstance(shape, Sphere):
        axis = _UP
    elif isinstance(shape, Cylinder):
        axis = axis * np.copysign(1.0, axis[2])
    sight = look(shape, X_WO, view, margin=3)
    deviations = np.array([middle.position_deviation, middle.axis_deviation])
    uncertain = (deviations > _MOST_DEVIATIONS).any()
    return Fit(
        X_WO.translation(),
        axis,
        *_seen(sight, Outline.of(shape, X_WO, view), view),
        uncertain=bool(uncertain) or _doubtful(shape, X_WO, view, sight),
    )


def _by_distance(
    shape: Shape, guesses: list[RigidTransform], points: Vector
) -> list[RigidTransform]:
    """The guesses, those to whose surface the points are nearest first."""

    def distance(X_WO: RigidTransform) -> float:
        p_O = (points - X_WO.translation()) @ X_WO.rotation().matrix()
        return float(np.abs(signed_distance(shape, p_O)[0]).mean())

    return sorted(guesses, key=distance)


def _unexplained(sight: Sight) -> float:
    """Pixels that speak against a pose, as a share of those of the blob.

    They are the blob's where not on the surface, and others that look through it.
    """
    missed = sight.blob & (np.abs(sight.error) > _WRONG)
    through = ~sight.blob & (sight.labels == OUTSIDE) & (sight.distance < -1.5)
    return float((missed.sum() + through.sum()) / sight.blob.sum())


def _doubtful(shape: Shape, X_WO: RigidTransform, view: View, sight: Sight) -> bool:
    """Whether a pose leaves much unexplained, or others explain as much.

    Where both ends of a solid are hidden, it may slide along its axis unnoticed.
    """
    unexplained = _unexplained(sight)
    surface = sight.surface & (sight.distance < -1)
    colored = sight.blob.sum() / max(1, surface.sum())
    distance = float(np.linalg.norm(X_WO.translation() - view.origin))
    slide = _SLIDE * distance / view.focal[0]
    slid = (X_WO @ RigidTransform([0.0, 0.0, z]) for z in (-slide, slide))
    return (
        unexplained > _MOST_UNEXPLAINED
        or colored < _LEAST_COLORED
        or any(
            _unexplained(look(shape, X, view, margin=0)) <= unexplained for X in slid
        )
    )


def _seen(sight: Sight, outline: Outline, view: View) -> tuple[float, bool, bool]:
    """Quality, cut, hidden of an outline between two rings of pixels."""
    labels = np.full(view.depth.shape, OUTSIDE, dtype=np.int8)
    labels[tuple(sight.pixels.T[::-1])] = np.where(sight.surface, INSIDE, sight.labels)
    h, w = view.depth.shape
    in_image, found = np.ones(_RING, bool), np.ones(_RING, bool)
    for grow, expected in ((-1.5, INSIDE), (1.5, OUTSIDE)):
        pixels = np.rint(outline.ring(grow, _RING)).astype(int)
        u, v = pixels[:, 0], pixels[:, 1]
        in_image &= (u >= 0) & (v >= 0) & (u < w) & (v < h)
        found &= labels[np.clip(v, 0, h - 1), np.clip(u, 0, w - 1)] == expected
    found &= in_image
    missing = (in_image & ~found).mean()
    return float(found.mean()), bool((~in_image).any()), bool(missing > 0.1)
