"""Where things begin and end between two pads, and how their flanks stand there."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from drake_srg.types import Vector

# A thing this near to a pad touches it [m].
_TOUCHES = 0.004
# The slant of a face is fitted to what the pad sees within `_FACE` of the middle of the
# part that touches, across the pad. Distances beyond `_AWAY` count as that [m].
_FACE, _AWAY = 0.01, 0.02
# Height of the flank over which its lean is measured [m].
_RISE = 0.012
# Most of the flank of a low thing may be below what counts as between the pads. From
# this height above the fingers' ends on [m], and so many standard deviations of the
# table's own heights, it counts, too.
_FOOT, _DEVIATIONS = 0.001, 2.0


def extent(
    mask: npt.NDArray[np.bool_], s: Vector
) -> tuple[Vector, Vector, npt.NDArray[np.bool_]]:
    """Return the first and last offset where a mask (..., S) is set, and if any is."""
    some = np.asarray(mask.any(axis=-1))
    first = mask.argmax(axis=-1)
    last = len(s) - 1 - mask[..., ::-1].argmax(axis=-1)
    return np.where(some, s[first], 0.0), np.where(some, s[last], 0.0), some


def face_of(distance: Vector, t: Vector) -> tuple[Vector, Vector, Vector]:
    """Return how much of pads touches things, where, and how the faces slant.

    Args:
        distance: Of things from pads, shape (n, T) [m]; inf without a thing.
        t: Positions across the pad, shape (T,) [m].

    Returns:
        The shares 0 .. 1, the middles in t [m] and the slopes, shape (n,) each.
    """
    touches = distance < _TOUCHES
    middle = (touches * t).sum(axis=1) / np.maximum(touches.sum(axis=1), 1)
    face = np.abs(t - middle[:, None]) < _FACE
    count = np.maximum(face.sum(axis=1), 1)
    dt = t - ((face * t).sum(axis=1) / count)[:, None]
    away = np.clip(distance, 0.0, _AWAY)
    slope = (face * dt * away).sum(axis=1) / (face * dt * dt).sum(axis=1).clip(1e-9)
    return touches.mean(axis=1), middle, slope


def lean_of(
    strip: npt.NDArray[np.float32],
    tip: Vector,
    top: Vector,
    end: Vector,
    inwards: int,
    step: float,
    noise: float = 0.0,
) -> Vector:
    """Return how far flanks lean inwards: the tangent of the angle to the vertical.

    Pads slip off what leans more than friction allows. Round things lean the less,
    the lower they are held. The flanks of low things count down to where they begin.

    Args:
        strip: Heights along the closing direction, shape (n, S) [m].
        tip: Height of the fingers' ends, shape (n,) [m].
        top: Height of the thing, shape (n,) [m].
        end: Where the thing ends, shape (n,) [m].
        inwards: Direction from there to its inside, 1 or -1.
        step: Between the samples, the middle one of which is at 0 [m].
        noise: Standard deviation of the heights [m].
    """
    rows = np.arange(len(strip))
    rise = np.clip(0.8 * (top - tip), 1e-3, _RISE)
    ends = (strip.shape[1] - 1) // 2 + np.rint(end / step).astype(int)
    run = np.zeros(len(strip))
    steps = np.arange(1, round(_RISE / step) + 1)
    low, foot = np.ones(len(strip), bool), rise < _RISE
    for away in steps:
        inside, outside = (
            strip[rows, np.clip(ends + way * away, 0, strip.shape[1] - 1)]
            for way in (inwards, -inwards)
        )
        low = low & (inside < tip + rise)
        foot = foot & (outside > tip + max(_FOOT, _DEVIATIONS * noise))
        run += step * (low.astype(int) + foot)
    return run / rise
