"""Rows on the grasps of a cell of trials, and the criteria for visual servos."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drake_srg.experiments.row import Row
from drake_srg.experiments.servo_trials import Grasped
from drake_srg.sweeps.statistics import wilson_interval
from drake_srg.types import Vector

# The criteria, set before the first run: a servo must grasp in every case, and be
# within the distance at which `servoing.tolerance` lets the fingers close.
LEAST_HELD, MOST_OFF = 0.95, 3e-3
_RESAMPLES = 2000


def held_rows(name: str, made: Sequence[Grasped], *, judged: bool) -> list[Row]:
    """Return the share of cans that were lifted and held, and its interval.

    Args:
        name: Of the rows.
        made: The trials.
        judged: Whether the share must be `LEAST_HELD`.
    """
    low, high = wilson_interval(sum(g.held for g in made), len(made))
    share = float(np.mean([g.held for g in made]))
    if judged:
        first = Row.at_least(name, "held", LEAST_HELD, share, "", spread=0.05)
    else:
        first = Row.info(name, "held", share, "", spread=0.05)
    return [
        first,
        Row.info(name, "held, at least", low, "", spread=0.05),
        Row.info(name, "held, at most", high, "", spread=0.05),
    ]


def error_rows(name: str, made: Sequence[Grasped], *, judged: bool) -> list[Row]:
    """Return the median grasp error and its interval; nothing if no fingers closed.

    Args:
        name: Of the rows.
        made: The trials.
        judged: Whether the median must be `MOST_OFF` at most.
    """
    errors = grasp_errors(made)
    if not len(errors):
        return []
    median, (low, high) = float(np.median(errors)), _interval(errors)
    if judged:
        first = Row.at_most(name, "grasp error", MOST_OFF, median, "m")
    else:
        first = Row.info(name, "grasp error", median, "m")
    return [
        first,
        Row.info(name, "grasp error, at least", low, "m"),
        Row.info(name, "grasp error, at most", high, "m"),
    ]


def grasp_errors(made: Sequence[Grasped]) -> Vector:
    """Return the errors of the grasps in which the fingers closed [m]."""
    return np.array([g.error for g in made if g.error is not None], dtype=float)


def _interval(errors: Vector) -> tuple[float, float]:
    """Return the 95 % interval of the median, by the bootstrap [m]."""
    drawn = np.random.default_rng(0).choice(errors, (_RESAMPLES, len(errors)))
    low, high = np.quantile(np.median(drawn, axis=1), (0.025, 0.975))
    return float(low), float(high)
