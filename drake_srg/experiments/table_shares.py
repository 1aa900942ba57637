"""Shares of the objects on cleared tables that ended where they belong."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from drake_srg.planning.grasps.top_grasps import Reach
from drake_srg.simulation.metrics import Metrics
from drake_srg.sweeps.statistics import wilson_interval

# Things that are wider on every side, as they lie, do not fit the hand [m].
WIDEST = 0.13


@dc.dataclass(frozen=True)
class Share:
    """Successes among trials."""

    count: int
    total: int

    @property
    def value(self) -> float:
        """Their share; 0 without trials."""
        return self.count / max(self.total, 1)

    @property
    def bounds(self) -> tuple[float, float]:
        """The 95 % interval (Wilson)."""
        return wilson_interval(self.count, self.total)


def shares(
    runs: Sequence[Metrics], place: str, reach: Reach | None = None
) -> dict[str, Share]:
    """Return the shares of objects that are in place, and of picks that held.

    Picks are judged by ground truth, and by the planner's word: it counts a load once
    it has seen it come.

    Args:
        runs: The metrics of the trials.
        place: Where the objects belong.
        reach: Where the hand can be; None for everywhere.
    """
    total = {
        key: sum(getattr(m, key) or 0 for m in runs)
        for key in (
            *("objects_total", "objects_cleared"),
            *("picks", "picks_held", "picks_delivered"),
        )
    }
    fit = [
        bool(thing["cleared"])
        for m in runs
        for thing in (m.objects or {}).values()
        if _fits(thing) and lay_in(reach, thing) and not _under_what_stays(thing, m)
    ]
    return {
        f"objects {place}": Share(total["objects_cleared"], total["objects_total"]),
        f"objects in reach that fit the hand {place}": Share(sum(fit), len(fit)),
        "picks that delivered": Share(total["picks_delivered"], total["picks"]),
        "picks held": Share(total["picks_held"], total["picks"]),
    }


def _fits(thing: Mapping[str, Any]) -> bool:
    """Return whether an object was narrow enough for the hand, as it lay."""
    return float(thing["width_m"]) <= WIDEST


def _under_what_stays(thing: Mapping[str, Any], metrics: Metrics) -> bool:
    """Return whether an object lies under one that does not fit the hand."""
    above = (metrics.objects or {}).get(str(thing["under"]))
    return above is not None and not _fits(above)


def lay_in(reach: Reach | None, thing: Mapping[str, Any]) -> bool:
    """Return whether an object lay where the hand can be, before the first pick.

    What became of it does not count: what was scattered later is lost.

    Args:
        reach: Where the hand can be; None for everywhere.
        thing: An entry of `Metrics.objects`.
    """
    return reach is None or bool(reach.contains(np.array([thing["lay_at_m"]])).all())


def false_claims(metrics: Metrics) -> int:
    """Return how many objects more the planner claims than are in place."""
    return max((metrics.picks_held or 0) - (metrics.objects_cleared or 0), 0)
