"""Grasps from above of unknown things, from a height map alone."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from drake_srg.planning.grasps.relief import Relief
from drake_srg.planning.grasps.top_grasp_search import (
    Reach,
    TopGraspConfig,
    TopGraspSearch,
)
from drake_srg.types import Vector

__all__ = ["HeightMapGrasps", "Reach", "TopGraspConfig"]


class HeightMapGrasps(TopGraspSearch):
    """Finds grasps without knowing or telling apart the things on a table.

    It tries points on things, times directions. For its arguments see `TopGraspSearch`.
    """

    def proposals(self, relief: Relief, rng: Generator) -> tuple[Vector, Vector]:
        """Return points on things and their middles, each with all directions.

        The points are where the hand reaches, which may be only the end of a thing.
        """
        config, middles = self._config, relief.map.middles()
        points = [thing.middle for thing in relief.things]
        parts = [middles[tuple(thing.cells.T)] for thing in relief.things]
        if self._reach is not None:
            parts = [part[self._reach.contains(part)] for part in parts]
        total = sum(map(len, parts))
        for part in parts:
            share = round(config.points * len(part) / max(total, 1))
            count = min(max(share, config.points_per_thing), len(part))
            points += list(part[rng.choice(len(part), count, replace=False)])
        p_W = np.array(points)
        yaws = np.pi * (np.arange(config.yaws) / config.yaws - 0.5)
        return np.repeat(p_W, len(yaws), axis=0), np.tile(yaws, len(p_W))
