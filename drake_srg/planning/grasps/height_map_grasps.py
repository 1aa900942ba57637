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
    """Finds pinches without knowing or telling apart the things on a table.

    It tries points on things, times directions. For its arguments see `TopGraspSearch`.
    """

    def proposals(self, relief: Relief, rng: Generator) -> tuple[Vector, Vector]:
        """Return points on things and their middles, each with all directions."""
        config, things = self._config, relief.things
        total = sum(len(thing.cells) for thing in things)
        points = [thing.middle for thing in things]
        middles = relief.map.middles()
        for thing in things:
            share = round(config.points * len(thing.cells) / total)
            count = min(max(share, config.points_per_thing), len(thing.cells))
            cells = thing.cells[rng.choice(len(thing.cells), count, replace=False)]
            points += list(middles[cells[:, 0], cells[:, 1]])
        p_W = np.array(points)
        yaws = np.pi * (np.arange(config.yaws) / config.yaws - 0.5)
        return np.repeat(p_W, len(yaws), axis=0), np.tile(yaws, len(p_W))
