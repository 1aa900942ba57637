"""Shares and figures of many trials of the five-axis arm, as rows and table lines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from drake_srg.experiments.cycles import Cycle
from drake_srg.experiments.row import Row
from drake_srg.sweeps.statistics import wilson_interval
from drake_srg.types import Vector

LIFTED, PLACED = "grasped and lifted", "placed"


def outcomes(cycles: Sequence[Cycle]) -> dict[str, Any]:
    """Return which trials grasped and lifted the cylinder, and which placed it."""
    return {
        LIFTED: np.array([bool(c.metrics.grasp_lifted) for c in cycles]),
        PLACED: np.array([c.metrics.success for c in cycles]),
    }


def bounds(cycles: Sequence[Cycle], what: str = PLACED) -> tuple[float, float]:
    """Return the 95 % interval (Wilson) of the share of an outcome."""
    done = outcomes(cycles)[what]
    return wilson_interval(int(np.sum(done)), len(done))


def share_rows(case: str, cycles: Sequence[Cycle]) -> list[Row]:
    """State the share of each outcome, and its interval."""
    rows = []
    for what, done in outcomes(cycles).items():
        low, high = bounds(cycles, what)
        for suffix, value in (
            ("share", float(np.mean(done))),
            ("at least", low),
            ("at most", high),
        ):
            rows.append(Row.info(case, f"{what}, {suffix}", value, "", spread=0.05))
    return rows


def quantile_rows(case: str, what: str, values: Vector, unit: str) -> list[Row]:
    """State median and 5 to 95 % quantiles; nothing without values."""
    if not len(values):
        return []
    low, middle, high = np.quantile(values, (0.05, 0.5, 0.95))
    return [
        Row.info(case, f"{what}, median", float(middle), unit),
        Row.info(case, f"{what}, 5 % quantile", float(low), unit),
        Row.info(case, f"{what}, 95 % quantile", float(high), unit),
    ]


def line(cycle: Cycle) -> dict[str, Any]:
    """Return a trial's entries in the table."""
    m = cycle.metrics

    def number(value: float | None) -> float:
        return np.nan if value is None else value

    x, y, _ = m.placement_error_m or (np.nan,) * 3
    return {
        "seed": cycle.seed,
        "lifted": int(bool(m.grasp_lifted)),
        "placed": int(m.success),
        "failure": m.failure or "",
        "placement error x [m]": x,
        "placement error y [m]": y,
        "time to placement [s]": number(m.time_to_placement_s),
        "cycle [s]": number(m.cycle_time_s),
        "smoothness": number(m.smoothness),
    }
