"""Grasps from above of things whose surfaces and poses are known."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.random import Generator

from drake_srg.planning.grasps.fingers import Fingers
from drake_srg.planning.grasps.known_surface import KnownSurface
from drake_srg.planning.grasps.segmentation import Segmentation
from drake_srg.planning.grasps.top_grasp_search import (
    TABLE_GAP,
    Reach,
    TopGraspSearch,
)
from drake_srg.types import HeightMap, Vector

# Points of a surface that are paired, and pairs that are proposed, per thing.
_POINTS, _PAIRS = 400, 250
# Two points face each other if the line between them leaves both surfaces within this
# angle of their normals [rad], and if they are at about the same height [m].
_CONE, _LEVEL = np.deg2rad(25.0), 0.012


class SurfaceGrasps(TopGraspSearch):
    """Finds grasps by pairing points of known surfaces that face each other.

    The nearer a pair's line passes to the middle of the thing, the less the weight
    turns it in the hand. What the cameras see of the table, other things included, is
    completed by the known surfaces, so that shadows and noise of the known things do
    not matter.

    Args:
        fingers: The hand's.
        table: World z of the table [m].
        surfaces: Of the known things, in world (`KnownSurface.posed`), with so many
            points that every cell of the height map has one: 20,000 do for most.
        reach: Where the hand can be; None for everywhere.
        table_gap: Height above the table that the ends of closing fingers keep [m].
    """

    def __init__(
        self,
        fingers: Fingers,
        table: float,
        surfaces: Sequence[KnownSurface],
        *,
        reach: Reach | None = None,
        table_gap: float = TABLE_GAP,
    ) -> None:
        super().__init__(fingers, table, reach=reach, table_gap=table_gap)
        self._surfaces = tuple(surfaces)

    def segment(self, height_map: HeightMap) -> Segmentation:
        """Return what a map shows, completed by the known surfaces."""
        height = height_map.height.copy()
        known = np.full(height.shape, -np.inf, np.float32)
        for surface in self._surfaces:
            cells = height_map.cells(surface.points)
            inside = ((cells >= 0) & (cells < height.shape)).all(axis=1)
            iy, ix = cells[inside].T
            np.maximum.at(known, (iy, ix), surface.points[inside, 2])
        # A cell without a point among cells with points is on the thing, too.
        kernel = np.ones((3, 3), np.uint8)
        known = np.asarray(cv2.morphologyEx(known, cv2.MORPH_CLOSE, kernel))
        seen = np.isfinite(known)
        height[seen] = known[seen]
        return super().segment(dc.replace(height_map, height=height))

    def proposals(
        self, segments: Segmentation, rng: Generator
    ) -> tuple[Vector, Vector]:
        """Return the middles and directions of pairs that face each other."""
        pairs = [_pairs(surface, rng) for surface in self._surfaces]
        p_W = np.concatenate([np.zeros((0, 2)), *(p for p, _ in pairs)])
        yaw = np.concatenate([np.zeros(0), *(yaw for _, yaw in pairs)])
        # Of the segmentation of one thing only, its own.
        own = segments.lookup(p_W) > segments.least
        return p_W[own], yaw[own]


def _pairs(surface: KnownSurface, rng: Generator) -> tuple[Vector, Vector]:
    """Return middles (n, 2) [m] and directions (n,) [rad] of facing points."""
    count = min(_POINTS, len(surface.points))
    chosen = rng.choice(len(surface.points), count, replace=False)
    p, n = surface.points[chosen], surface.normals[chosen]
    i, j = np.triu_indices(count, 1)
    level = np.abs(p[i, 2] - p[j, 2]) < _LEVEL
    i, j = i[level], j[level]
    apart = p[j] - p[i]
    distance = np.linalg.norm(apart, axis=1).clip(1e-6)
    direction = apart / distance[:, None]
    facing = -np.sum(n[i] * direction, axis=1) > np.cos(_CONE)
    facing &= np.sum(n[j] * direction, axis=1) > np.cos(_CONE)
    i, j, direction = i[facing], j[facing], direction[facing]
    middle = 0.5 * (p[i] + p[j])[:, :2]
    lever = surface.points.mean(axis=0)[:2] - middle
    across = np.stack([-direction[:, 1], direction[:, 0]], axis=1)
    order = np.argsort(np.abs(np.sum(lever * across, axis=1)), kind="stable")[:_PAIRS]
    return middle[order], np.arctan2(direction[order, 1], direction[order, 0])
