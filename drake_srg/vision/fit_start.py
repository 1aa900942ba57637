"""Finds the pose from which the fit of a solid starts."""

from __future__ import annotations

import dataclasses as dc
from operator import itemgetter

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.common.convex_pieces import ConvexPieces
from drake_srg.types import Sphere, Vector
from drake_srg.vision.guesses import guess_poses, guess_upright
from drake_srg.vision.match import Match
from drake_srg.vision.piece_guesses import WORTH_A_FIT, are_rivals, guess_rivals
from drake_srg.vision.robust import robust_deviation
from drake_srg.vision.sight import Sight
from drake_srg.vision.solids import signed_distance


@dc.dataclass(frozen=True)
class Start:
    """A coarsely aligned pose.

    Attributes:
        X_WO: The pose.
        upright: Whether the solid's z stays as it is.
        has_rival: Whether a far turned pose leaves hardly more unexplained.
    """

    X_WO: RigidTransform
    upright: bool = False
    has_rival: bool = False


def find_start(match: Match) -> Start:
    """Return the pose that explains most, coarsely.

    Most things stand. Noise hides small leans, so in a noisy image a solid whose
    depth is that of a standing one is taken to stand, unless another pose explains
    far more. A solid that hangs from a hand may have turned in it and is free to
    lean.
    """
    limits, view, shape = match.config.fit, match.view, match.shape
    standing, least = Start(RigidTransform(), upright=True), np.inf
    if view.noise and not isinstance(shape, Sphere):
        guess = guess_upright(shape, view, match.config.guesses)
        X_WO = match.align(guess, limits.coarse_softness, upright=True).X_WO
        sight = match.look(X_WO)
        scatter = robust_deviation(sight.error[sight.blob])
        # Unless its top is in sight, its height could be anything.
        if scatter <= 2 * view.noise and _sees_top(match, X_WO, sight):
            standing = Start(X_WO, upright=not _hangs(match, X_WO))
            least = match.unexplained(sight)
            margin = limits.upright_margin if standing.upright else 0.0
            if least <= max(limits.explained, margin):
                return standing
            least -= margin
    unexplained, start = _best_of_guesses(match)
    return start if unexplained < least else standing


def _best_of_guesses(match: Match) -> tuple[float, Start]:
    """Return what the best guess leaves unexplained, and the guess, aligned."""
    limits, view, shape = match.config.fit, match.view, match.shape
    guesses = guess_poses(shape, view, match.config.guesses)
    if isinstance(shape, ConvexPieces):
        return _best_of_pieces(match, shape, guesses)
    points = view.seen
    guesses.sort(key=lambda guess: _distance(match, guess, points))
    tried = []
    for guess in guesses[: limits.noisy_guesses if view.noise else None]:
        tried.append(_try(match, guess))
        if tried[-1][0] <= limits.explained:
            break
    least, X_WO = min(tried, key=itemgetter(0))
    return least, Start(X_WO)


def _best_of_pieces(
    match: Match, shape: ConvexPieces, guesses: list[RigidTransform]
) -> tuple[float, Start]:
    """Return the best guess of convex pieces, after a look for its rivals."""
    worth = match.config.fit.noisy_guesses if match.view.noise else WORTH_A_FIT
    tried = [_try(match, guess) for guess in guesses[:worth]]
    if min(tried, key=itemgetter(0))[0] > match.config.fit.explained:
        tried += [_try(match, guess) for guess in guesses[worth : 2 * worth]]
    best = min(tried, key=itemgetter(0))[1]
    tried += [_try(match, guess) for guess in guess_rivals(shape, best, match.view)]
    least, best = min(tried, key=itemgetter(0))
    has_rival = any(are_rivals(shape, (least, best), other) for other in tried)
    return least, Start(best, has_rival=has_rival)


def _try(match: Match, guess: RigidTransform) -> tuple[float, RigidTransform]:
    """Return what a guess leaves unexplained once it is aligned, and its pose."""
    X_WO = match.align(guess, match.config.fit.coarse_softness).X_WO
    return match.unexplained(match.look(X_WO)), X_WO


def _distance(match: Match, X_WO: RigidTransform, points: Vector) -> float:
    """Return the mean distance of points to the solid's surface [m]."""
    p_O = (points - X_WO.translation()) @ X_WO.rotation().matrix()
    return float(np.abs(signed_distance(match.shape, p_O)[0]).mean())


def _sees_top(match: Match, X_WO: RigidTransform, sight: Sight) -> bool:
    """Return whether enough pixels show the top of an upright solid."""
    top = X_WO.translation()[2] + 0.5 * match.shape.bounding_size[2]
    tops = sight.blob & (np.abs(sight.points[:, 2] - top) < match.wrong)
    return bool(tops.sum() >= match.config.fit.least_pixels)


def _hangs(match: Match, X_WO: RigidTransform) -> bool:
    """Return whether an upright solid is far above its surroundings.

    What holds it does not count. If nothing is seen around it, it hangs.
    """
    limits = match.config.fit
    sight = match.look(X_WO, margin=limits.beside)
    bottom = X_WO.translation()[2] - 0.5 * match.shape.height
    points = sight.points[match.around(sight)]
    z = np.where(np.isfinite(points).all(axis=1), points[:, 2], -np.inf)
    z = z[z < bottom + limits.apart]
    return len(z) >= limits.least_pixels and bool(np.median(z) < bottom - limits.apart)
