"""Parts of a path, between which the arm need not rest."""

from __future__ import annotations

import dataclasses as dc
import itertools
from collections.abc import Iterable, Sequence

import numpy as np
from pydrake.trajectories import (
    PathParameterizedTrajectory,
    PiecewisePolynomial,
    Trajectory,
)

from drake_srg.types import Vector

# How far a motion may leave a path at its corners, and where it must stay on it [rad].
ROUNDING, STRAIGHT = 0.2, 1e-3


@dc.dataclass(frozen=True, eq=False)
class PathPart:
    """A part of a path.

    Attributes:
        path: Waypoints, shape (K, N) [rad].
        rounding: How far a motion may leave the path, everywhere or at each waypoint,
            shape (K,) [rad].
    """

    path: Vector
    rounding: float | Vector = ROUNDING


def joined(parts: Sequence[PathPart]) -> PathPart:
    """Return parts of a path as one.

    A motion may leave out the corner where two parts meet, within the nearer half of
    each.

    Args:
        parts: Each begins where the one before ends.
    """
    roundings: list[Vector] = []
    for i, part in enumerate(parts):
        lengths = np.linalg.norm(np.diff(part.path, axis=0), axis=1)
        share = np.append(0.0, np.cumsum(lengths)) / max(np.sum(lengths), 1e-9)
        rounded = ((share < 0.5) & (i > 0)) | ((share > 0.5) & (i < len(parts) - 1))
        roundings.append(np.where(rounded, ROUNDING, part.rounding))
    first, *others = parts
    return PathPart(
        np.vstack([first.path, *(part.path[1:] for part in others)]),
        np.concatenate([roundings[0], *(other[1:] for other in roundings[1:])]),
    )


def cut(
    trajectory: Trajectory, points: Iterable[Vector], period: float
) -> tuple[Trajectory, ...]:
    """Return the parts of a motion, in the order of the points at which it is cut.

    Args:
        trajectory: q(t), shape (N, 1) [rad], from t = 0.
        points: Where it is cut, as near as it gets, shape (N,) [rad] each.
        period: Each part but the last lasts a multiple of this time [s].
    """
    end = trajectory.end_time()
    times = np.arange(0.0, end, period)
    q = trajectory.vector_values(times).T
    at = [0]
    for point in points:
        distances = np.linalg.norm(q[at[-1] + 1 :] - point, axis=1)
        at.append(at[-1] + 1 + int(np.argmin(distances)))
    breaks = [*(period * i for i in at), end]
    return tuple(
        PathParameterizedTrajectory(
            trajectory,
            PiecewisePolynomial.FirstOrderHold([0.0, b - a], np.array([[a, b]])),
        )
        for a, b in itertools.pairwise(breaks)
    )
