"""Triangles of Drake's shapes and of Wavefront files."""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    Mesh,
    PolygonSurfaceMesh,
    Shape,
    Sphere,
    VolumeMesh,
)
from pydrake.math import RigidTransform

from drake_srg.types import Vector

Indices = npt.NDArray[np.int64]

_SEGMENTS = 48  # of a circle
_HALF_SPACE = 5.0  # half of the side of the square that represents a half space [m]


@dc.dataclass(frozen=True)
class Triangles:
    """A surface.

    Attributes:
        points: Vertices [m], shape (n, 3).
        normals: Outward unit vectors of the vertices, shape (n, 3).
        faces: Indices of the corners, counter-clockwise from outside, shape (k, 3).
    """

    points: Vector
    normals: Vector
    faces: Indices

    def transformed(self, X: RigidTransform) -> Triangles:
        """Return the surface moved by a pose."""
        R = X.rotation().matrix()
        points = self.points @ R.T + X.translation()
        return Triangles(points, self.normals @ R.T, self.faces)

    def scaled(self, factors: Vector) -> Triangles:
        """Return the surface scaled along x, y, z by factors other than zero, (3,)."""
        normals = self.normals / factors
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        mirrored = np.prod(factors) < 0
        faces = self.faces[:, ::-1] if mirrored else self.faces
        return Triangles(self.points * factors, normals, faces)


def shape_triangles(shape: Shape) -> Triangles | None:
    """Return the surface of a shape in its own frame; None for an unknown shape.

    A Convex, and a mesh in a format other than Wavefront, becomes its convex hull.
    """
    match shape:
        case Mesh() if shape.source().is_path() and shape.extension() == ".obj":
            return read_obj(shape.source().path()).scaled(shape.scale3())
        case Mesh() | Convex():
            return _hull(shape.GetConvexHull())
        case HalfSpace():
            corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)])
            return _flat(_HALF_SPACE * corners[[[0, 1, 2], [0, 2, 3]]])
    return _solid(shape)


def _solid(shape: Shape) -> Triangles | None:
    match shape:
        case Box():
            return _flat(_cube() * 0.5 * shape.size())
        case Cylinder():
            r, z = shape.radius(), 0.5 * shape.length()
            side = _revolved([(r, -z), (r, z)], [(1, 0), (1, 0)])
            bottom = _revolved([(0, -z), (r, -z)], [(0, -1), (0, -1)])
            top = _revolved([(r, z), (0, z)], [(0, 1), (0, 1)])
            return joined([side, bottom, top])
        case Sphere():
            return _ball(0.0).scaled(np.full(3, shape.radius()))
        case Capsule():
            return _ball(0.5 * shape.length() / shape.radius()).scaled(
                np.full(3, shape.radius())
            )
        case Ellipsoid():
            return _ball(0.0).scaled(np.array([shape.a(), shape.b(), shape.c()]))
    return None


def arrow() -> Triangles:
    """Return an arrow from z = -1 to the origin, with a shaft 8 mm thick."""
    shaft, head, neck = 0.004, 0.009, -0.25
    slope = np.array([-neck, head]) / np.hypot(neck, head)
    return joined(
        [
            _revolved([(0, -1), (shaft, -1)], [(0, -1), (0, -1)], 12),
            _revolved([(shaft, -1), (shaft, neck)], [(1, 0), (1, 0)], 12),
            _revolved([(0, neck), (head, neck)], [(0, -1), (0, -1)], 12),
            _revolved([(head, neck), (0, 0)], [slope, slope], 12),
        ]
    )


def surface_faces(mesh: VolumeMesh) -> Indices:
    """Return the outer triangles of a mesh of tetrahedra, shape (k, 3)."""
    outer: dict[frozenset[int], tuple[int, int, int]] = {}
    for tetrahedron in mesh.tetrahedra():
        a, b, c, d = (tetrahedron.vertex(i) for i in range(4))
        for face in ((a, c, b), (a, b, d), (b, c, d), (a, d, c)):
            if outer.pop(key := frozenset(face), None) is None:
                outer[key] = face
    return np.array(list(outer.values()), dtype=np.int64).reshape(-1, 3)


def read_obj(path: Path) -> Triangles:
    """Read a Wavefront file; if it lacks normals, the faces are flat.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If it is not a Wavefront file.
    """
    return _parse_obj(path, path.read_text(encoding="utf-8", errors="replace"))


# A recorded run reads every mesh twice: for its rosbag and for its replay.
@functools.lru_cache(maxsize=256)
def _parse_obj(path: Path, text: str) -> Triangles:
    points: list[list[float]] = []
    normals: list[list[float]] = []
    corners: dict[tuple[int, int], int] = {}
    faces: list[tuple[int, int, int]] = []
    smooth = True

    for line in text.splitlines():
        word, *values = line.split() or [""]
        if word in ("v", "vn"):
            rows = points if word == "v" else normals
            rows.append([float(x) for x in values[:3]])
        elif word == "f":
            polygon = []
            for value in values:
                point, *_, normal = [*value.split("/"), ""][:3]
                smooth &= bool(normal)
                key = (_index(point, points), _index(normal, normals))
                polygon.append(corners.setdefault(key, len(corners)))
            for k in range(1, len(polygon) - 1):
                faces.append((polygon[0], polygon[k], polygon[k + 1]))
    keys = np.array(list(corners)).reshape(-1, 2)
    if (
        not faces
        or not 0 <= keys[:, 0].min() <= keys[:, 0].max() < len(points)
        or keys[:, 1].max() >= len(normals)
    ):
        raise ValueError(f"{path}: has no faces between its points")
    vertices, triangles = np.array(points)[keys[:, 0]], np.array(faces)
    if not smooth:
        return _flat(vertices[triangles])
    units = np.array(normals)[keys[:, 1]]
    units /= np.linalg.norm(units, axis=1, keepdims=True)
    return Triangles(vertices, units, triangles)


def _index(text: str, rows: Sequence[object]) -> int:
    """Return an index of a Wavefront file, counted from 0; -1: none.

    The file counts from 1, or, with negative numbers, back from the latest row.
    """
    index = int(text or 0)
    return index - 1 if index >= 0 else len(rows) + index


def joined(parts: Sequence[Triangles]) -> Triangles:
    """Return several surfaces as one."""
    starts = np.cumsum([0, *(len(part.points) for part in parts)])
    return Triangles(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate(
            [p.faces + start for p, start in zip(parts, starts, strict=False)]
        ),
    )


def _flat(corners: Vector) -> Triangles:
    """Return triangles, shape (k, 3, 3), as a surface with flat faces."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    across = np.cross(b - a, c - a)
    size = np.linalg.norm(across, axis=1, keepdims=True)
    normals = np.divide(
        across, size, out=np.tile([0.0, 0, 1], (len(a), 1)), where=size > 0
    )
    faces = np.arange(3 * len(corners)).reshape(-1, 3)
    return Triangles(corners.reshape(-1, 3), np.repeat(normals, 3, axis=0), faces)


def _cube() -> Vector:
    """Return the triangles of the cube from -1 to 1, shape (12, 3, 3)."""
    sides = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            square = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)][:: int(sign)])
            side = np.insert(square.astype(float), 0, sign, axis=1)
            sides += list(np.roll(side, axis, axis=1)[[[0, 1, 2], [0, 2, 3]]])
    return np.array(sides)


def _revolved(
    profile: Sequence[tuple[float, float]],
    normals: Sequence[tuple[float, float]] | Sequence[Vector],
    segments: int = _SEGMENTS,
) -> Triangles:
    """Return a profile of points (radius, z), from bottom to top, revolved about z."""
    angle = np.linspace(0, 2 * np.pi, segments + 1)
    around = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rows = [
        np.insert(radius * around, 2, z, axis=1)
        for radius, z in np.vstack([profile, normals]).astype(float)
    ]
    faces = []
    for row in range(len(profile) - 1):
        for i in range(segments):
            a, b = row * (segments + 1) + i, row * (segments + 1) + i + 1
            c, d = b + segments + 1, a + segments + 1
            # At a point on the axis, one of the two triangles would be empty.
            faces += [(a, b, c)] if profile[row][0] else []
            faces += [(a, c, d)] if profile[row + 1][0] else []
    n = len(profile)
    return Triangles(
        np.concatenate(rows[:n]), np.concatenate(rows[n:]), np.array(faces)
    )


def _ball(half_length: float) -> Triangles:
    """Return the unit ball, with each half moved outwards along z by a half length."""
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _SEGMENTS // 2 + 1)
    angle = np.insert(angle, len(angle) // 2, 0.0)  # the equator twice
    radius = np.abs(np.cos(angle))
    radius[[0, -1]] = 0.0
    lift = np.repeat([-half_length, half_length], len(angle) // 2)
    normals = np.stack([radius, np.sin(angle)], axis=1)
    profile = [(float(r), float(z)) for r, z in normals + np.outer(lift, [0, 1])]
    return _revolved(profile, list(normals))


def _hull(hull: PolygonSurfaceMesh) -> Triangles:
    """Return a convex hull with flat faces."""
    points = np.array([hull.vertex(i) for i in range(hull.num_vertices())])
    corners = []
    for i in range(hull.num_faces()):
        polygon = hull.element(i)
        index = [polygon.vertex(k) for k in range(polygon.num_vertices())]
        corners += [
            points[[index[0], *index[k : k + 2]]] for k in range(1, len(index) - 1)
        ]
    return _flat(np.array(corners))
