"""Grasps from above of unknown things, from a height map alone."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator

from drake_srg.planning.grasps.segmentation import Segmentation
from drake_srg.planning.grasps.top_grasp_search import YAWS, TopGraspSearch
from drake_srg.types import Vector

# Points that are tried: about this many in all, and at least so many of each thing.
_POINTS, _PER_THING = 150, 16


class HeightMapGrasps(TopGraspSearch):
    """Finds grasps without knowing or telling apart the things on a table.

    It tries points on things, times directions. For its arguments see `TopGraspSearch`.
    """

    def proposals(
        self, segments: Segmentation, rng: Generator
    ) -> tuple[Vector, Vector]:
        """Return points on things and their middles, each with all directions.

        The points are where the hand reaches, which may be only the end of a thing.
        """
        middles = segments.map.middles()
        points = [thing.middle for thing in segments.things]
        parts = [middles[tuple(thing.cells.T)] for thing in segments.things]
        if self._reach is not None:
            parts = [part[self._reach.contains(part)] for part in parts]
        total = sum(map(len, parts))
        for part in parts:
            share = round(_POINTS * len(part) / max(total, 1))
            count = min(max(share, _PER_THING), len(part))
            points += list(part[rng.choice(len(part), count, replace=False)])
        p_W = np.array(points)
        yaws = np.pi * (np.arange(YAWS) / YAWS - 0.5)
        return np.repeat(p_W, len(yaws), axis=0), np.tile(yaws, len(p_W))
