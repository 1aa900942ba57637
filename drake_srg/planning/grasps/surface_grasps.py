"""Grasps from above of things whose surfaces and poses are known."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt
from numpy.random import Generator
from pydrake.math import RigidTransform

from drake_srg.planning.grasps.fingers import Fingers
from drake_srg.planning.grasps.segmentation import Segmentation
from drake_srg.planning.grasps.top_grasps import TABLE_GAP, Reach, TopGraspSearch
from drake_srg.types import Box, Cylinder, HeightMap, Shape, Sphere, Vector


@dc.dataclass(frozen=True, eq=False)
class KnownSurface:
    """Points on the surface of a thing and the outward normals there.

    Attributes:
        points: Shape (n, 3), in the thing's frame or in world [m].
        normals: Unit vectors, shape (n, 3).
    """

    points: Vector
    normals: Vector

    def posed(self, X_WO: RigidTransform) -> KnownSurface:
        """Return the surface in world of a thing at a pose [m]."""
        R_WO = X_WO.rotation().matrix()
        return KnownSurface(
            self.points @ R_WO.T + X_WO.translation(), self.normals @ R_WO.T
        )

    @classmethod
    def of_shape(cls, shape: Shape, count: int, rng: Generator) -> KnownSurface:
        """Return `count` points of a shape.

        Args:
            shape: Centred on its frame; a cylinder's axis is z.
            count: Number of points.
            rng: For random draws.
        """
        match shape:
            case Sphere(radius=radius):
                normals = rng.normal(size=(count, 3))
                normals /= np.linalg.norm(normals, axis=1, keepdims=True)
                return cls(radius * normals, normals)
            case Cylinder(radius=radius, length=length):
                return cls._of_cylinder(radius, length, count, rng)
            case Box(size=size):
                half = 0.5 * np.array(size)
                areas = np.repeat(half[[1, 2, 0]] * half[[2, 0, 1]], 2)
                face = rng.choice(6, count, p=areas / areas.sum())
                axis, sign, rows = face // 2, 1.0 - 2.0 * (face % 2), np.arange(count)
                points = rng.uniform(-1.0, 1.0, (count, 3)) * half
                points[rows, axis] = sign * half[axis]
                normals = np.zeros((count, 3))
                normals[rows, axis] = sign
                return cls(points, normals)

    @classmethod
    def _of_cylinder(
        cls, radius: float, length: float, count: int, rng: Generator
    ) -> KnownSurface:
        on_end = rng.uniform(size=count) < radius / (radius + length)
        angle = rng.uniform(0.0, 2.0 * np.pi, count)
        out = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
        side = np.where(rng.uniform(size=count) < 0.5, -1.0, 1.0)
        up = side[:, None] * [0.0, 0.0, 1.0]
        z = 0.5 * length * np.where(on_end, side, rng.uniform(-1.0, 1.0, count))
        share = np.where(on_end, np.sqrt(rng.uniform(size=count)), 1.0)
        points = radius * share[:, None] * out
        points[:, 2] = z
        return cls(points, np.where(on_end[:, None], up, out))

    @classmethod
    def of_mesh(
        cls,
        vertices: Vector,
        triangles: npt.NDArray[np.integer],
        count: int,
        rng: Generator,
    ) -> KnownSurface:
        """Return `count` points of a mesh.

        Args:
            vertices: Shape (m, 3) [m].
            triangles: Indices of their corners, counterclockwise from outside, (k, 3).
            count: Number of points.
            rng: For random draws.

        Raises:
            ValueError: If no triangle has an area.
        """
        a, b, c = (vertices[triangles[:, i]] for i in range(3))
        normals = np.cross(b - a, c - a)
        areas = np.linalg.norm(normals, axis=1)
        if not areas.sum() > 0.0:
            raise ValueError("a mesh needs a triangle of some area")
        chosen = rng.choice(len(triangles), count, p=areas / areas.sum())
        u, v = rng.uniform(size=(2, count, 1))
        u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
        points = a[chosen] + u * (b - a)[chosen] + v * (c - a)[chosen]
        return cls(points, normals[chosen] / areas[chosen, None])


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
