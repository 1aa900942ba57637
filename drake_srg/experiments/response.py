"""Measures of step and tracking responses."""

from __future__ import annotations

import numpy as np

from drake_srg.types import Vector


def rise_time(time: Vector, q: Vector, start: float, end: float) -> float:
    """Return the time from 10 % to 90 % of a step [s]; NaN if 90 % is not reached.

    Args:
        time: Of the samples, shape (K,) [s].
        q: Response, shape (K,).
        start: Reference before the step.
        end: Reference after it.
    """
    share = (q - start) / (end - start)
    crossings = []
    for level in (0.1, 0.9):
        above = np.flatnonzero(share >= level)
        if not len(above):
            return np.nan
        k = above[0]
        if k == 0:
            crossings.append(time[0])
        else:  # between two samples
            part = (level - share[k - 1]) / (share[k] - share[k - 1])
            crossings.append(time[k - 1] + part * (time[k] - time[k - 1]))
    return float(crossings[1] - crossings[0])


def overshoot(q: Vector, start: float, end: float) -> float:
    """Return how far q exceeds the end of a step, as a share of the step."""
    return float(max(0.0, np.max((q - end) / (end - start))))


def settling_time(time: Vector, error: Vector, band: float) -> float:
    """Return when `|error|` enters the band for good [s]; NaN if it ends outside."""
    outside = np.flatnonzero(np.abs(error) > band)
    if not len(outside):
        return float(time[0])
    if outside[-1] == len(time) - 1:
        return np.nan
    return float(time[outside[-1] + 1])


def rms(values: Vector) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
