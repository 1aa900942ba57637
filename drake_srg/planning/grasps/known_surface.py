"""Surfaces of known things: points with normals, drawn evenly."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
import numpy.typing as npt
from numpy.random import Generator
from pydrake.math import RigidTransform

from drake_srg.types import Box, Cylinder, Shape, Sphere, Vector


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
