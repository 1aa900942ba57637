"""Convex solids in a canonical form: the same input gives the same bytes."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Iterable, Sequence

import manifold3d
import numpy as np
from scipy.spatial import ConvexHull

Points = np.ndarray


@dc.dataclass(frozen=True)
class Solid:
    """A convex polyhedron: corners, and faces counter-clockwise as seen from outside.

    Coplanar triangles are merged into one face, so the result does not depend on how
    the hull algorithm cuts a flat face.
    """

    vertices: Points  # n x 3, m
    faces: tuple[tuple[int, ...], ...]

    def moved(self, R: Points | None = None, p: Sequence[float] = (0, 0, 0)) -> Solid:
        """Return this solid, rotated by `R` and then translated by `p`."""
        R = np.eye(3) if R is None else np.asarray(R)
        return Solid(self.vertices @ R.T + np.asarray(p), self.faces)

    def triangles(self) -> Points:
        """Return the faces cut into triangle fans, as n x 3 vertex indices."""
        return np.array(
            [
                (face[0], face[i], face[i + 1])
                for face in self.faces
                for i in range(1, len(face) - 1)
            ]
        )


def hull(*parts: Points | Solid) -> Solid:
    """Return the convex hull of points and solids."""
    points = np.vstack([p.vertices if isinstance(p, Solid) else p for p in parts])
    points = _unique(points)
    qhull = ConvexHull(points)
    normals = qhull.equations[:, :3]
    # Join neighbouring triangles that lie in one plane.
    group = list(range(len(normals)))

    def root_of(i: int) -> int:
        while group[i] != i:
            i = group[i]
        return i

    for i, neighbours in enumerate(qhull.neighbors):
        for j in neighbours:
            if normals[i] @ normals[j] > 1 - 1e-9:
                a, b = sorted((root_of(i), root_of(int(j))))
                group[b] = a
    planes: dict[int, list[int]] = {}
    for i in range(len(normals)):
        planes.setdefault(root_of(i), []).append(i)
    faces = []
    for root, members in planes.items():
        corners = sorted({int(k) for i in members for k in qhull.simplices[i]})
        faces.append(_ordered(points, corners, normals[root]))
    used = sorted({k for face in faces for k in face})
    new = {old: k for k, old in enumerate(used)}
    renamed = sorted(_rolled(tuple(new[k] for k in face)) for face in faces)
    return Solid(points[used], tuple(renamed))


def _unique(points: Points) -> Points:
    """Return the points sorted, without duplicates (within 10 nm)."""
    keys = np.round(points, 8) + 0.0
    _, first = np.unique(keys, axis=0, return_index=True)
    return points[first]


def _ordered(points: Points, corners: list[int], normal: Points) -> tuple[int, ...]:
    """Return the corners counter-clockwise about the normal."""
    p = points[corners] - points[corners].mean(axis=0)
    u = p[0] / np.linalg.norm(p[0])
    v = _cross(normal, u)
    order = np.argsort(np.arctan2(p @ v, p @ u), kind="stable")
    return tuple(corners[k] for k in order)


def _rolled(face: tuple[int, ...]) -> tuple[int, ...]:
    """Return the face, starting at its smallest index."""
    k = face.index(min(face))
    return face[k:] + face[:k]


def rot_x(angle: float) -> Points:
    """Return the rotation about x by an angle."""
    c, s = _cos(angle), _sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def rot_y(angle: float) -> Points:
    """Return the rotation about y by an angle."""
    c, s = _cos(angle), _sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def rot_z(angle: float) -> Points:
    """Return the rotation about z by an angle."""
    c, s = _cos(angle), _sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def _cos(angle: float) -> float:
    return float(np.round(np.cos(angle), 12))


def _sin(angle: float) -> float:
    return float(np.round(np.sin(angle), 12))


def disc(
    radius: float,
    center: Sequence[float] = (0, 0),
    count: int = 24,
    start: float = 0.0,
    stop: float = 2 * np.pi,
) -> Points:
    """Return `count` points of a circle, or of an arc including both ends."""
    whole = stop - start >= 2 * np.pi - 1e-9
    angles = np.linspace(start, stop, count, endpoint=not whole)
    return radius * np.column_stack([np.cos(angles), np.sin(angles)]) + center


def hull_2d(*parts: Points) -> Points:
    """Return the corners of the planar convex hull, counter-clockwise."""
    points = np.vstack([np.atleast_2d(p) for p in parts])
    return points[ConvexHull(points).vertices]


def inset(outline: Points, by: float) -> Points:
    """Return a convex counter-clockwise outline shrunk by a distance."""
    edges = np.roll(outline, -1, axis=0) - outline
    inward = np.column_stack([-edges[:, 1], edges[:, 0]])
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    offset = np.einsum("ij,ij->i", inward, outline) + by
    result = []
    for i in range(len(outline)):
        A = np.stack([inward[i - 1], inward[i]])
        result.append(np.linalg.solve(A, [offset[i - 1], offset[i]]))
    return np.array(result)


def prism(outline: Points, z0: float, z1: float, edge: float = 0.0) -> Solid:
    """Return a convex outline extruded along z, with both rims rounded by `edge`."""
    outline = hull_2d(outline)
    if edge == 0:
        return hull(at_height(outline, z0), at_height(outline, z1))
    parts = []
    for angle in np.linspace(0, np.pi / 2, 4):
        ring = inset(outline, edge * (1 - np.sin(angle)))
        lift = edge * (1 - np.cos(angle))
        parts += [at_height(ring, z0 + lift), at_height(ring, z1 - lift)]
    return hull(*parts)


def at_height(outline: Points, z: float) -> Points:
    """Return the planar points at height z."""
    return np.column_stack([outline, np.full(len(outline), z)])


def block(low: Sequence[float], high: Sequence[float], edge: float = 0.0) -> Solid:
    """Return an axis-aligned box with edges and corners rounded by `edge`."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    if edge == 0:
        return hull(low + corners * (high - low))
    # An eighth of a ball at each corner.
    a = np.linspace(0, np.pi / 2, 4)
    ball = {(0.0, 0.0, 1.0)} | {
        (np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v)) for u in a for v in a
    }
    eighth = np.array(sorted(ball)) * edge
    parts = []
    for corner in corners:
        center = low + edge + corner * (high - low - 2 * edge)
        parts.append(center + eighth * (2 * corner - 1))
    return hull(*parts)


def revolve(profile: Iterable[tuple[float, float]], count: int = 48) -> Solid:
    """Return the hull of circles about z, given as (radius, height)."""
    parts = []
    for radius, z in profile:
        if radius == 0:
            parts.append(np.array([[0.0, 0.0, z]]))
        else:
            parts.append(at_height(disc(radius, count=count), z))
    return hull(*parts)


def rounded_profile(
    radius: float, z0: float, z1: float, edge: float, steps: int = 3
) -> Points:
    """Return a cylinder's (radius, height) profile with rounded rims."""
    a = np.linspace(0, np.pi / 2, steps + 1)
    r = radius - edge * (1 - np.sin(a))
    h = edge * (1 - np.cos(a))
    return np.vstack([np.column_stack([r, z0 + h]), np.column_stack([r, z1 - h])[::-1]])


def obj_text(solids: Sequence[Solid], crease: float = 50.0, mm: int = 6) -> str:
    """Return Wavefront text: triangles, normals smoothed up to a crease angle [deg].

    A corner's normal is the area-weighted mean over the adjacent faces within the
    crease angle of its own face, so large flats stay flat next to a bevel.
    """
    v_text, n_text, f_text = [], [], []
    normals_seen: dict[tuple[float, ...], int] = {}
    base = 1
    least = np.cos(np.radians(crease))
    for solid in solids:
        V = solid.vertices
        area_normals = np.array([_area_normal(V[list(f)]) for f in solid.faces])
        units = area_normals / np.linalg.norm(area_normals, axis=1, keepdims=True)
        around: list[list[int]] = [[] for _ in V]
        for i, face in enumerate(solid.faces):
            for k in face:
                around[k].append(i)
        v_text += ["v " + " ".join(format_number(x, mm) for x in p) for p in V]
        for i, face in enumerate(solid.faces):
            ids = []
            for k in face:
                near = [j for j in around[k] if j == i or units[i] @ units[j] > least]
                n = area_normals[near].sum(axis=0)
                key = tuple(np.round(n / np.linalg.norm(n), 3) + 0.0)
                if key not in normals_seen:
                    normals_seen[key] = len(normals_seen) + 1
                    n_text.append("vn " + " ".join(format_number(x, 3) for x in key))
                ids.append(f"{base + k}//{normals_seen[key]}")
            for j in range(1, len(face) - 1):
                f_text.append(f"f {ids[0]} {ids[j]} {ids[j + 1]}")
        base += len(V)
    head = "# Generated by tools/build_models.py\n"
    return head + "\n".join(v_text + n_text + f_text) + "\n"


def _area_normal(p: Points) -> Points:
    """Return a polygon's normal; its length is the polygon's area."""
    return 0.5 * _cross(p, np.concatenate([p[1:], p[:1]])).sum(axis=0)


def _cross(a: Points, b: Points) -> Points:
    """Return cross products over the last axis, in a third of the time of np.cross."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]).T


def format_number(x: float, digits: int = 6) -> str:
    """Return the shortest decimal with up to `digits` places, and no negative zero."""
    text = f"{x:.{digits}f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


@dc.dataclass(frozen=True)
class MassProperties:
    """Volume [m^3], centre [m] and second moments about it per unit density [m^5]."""

    volume: float
    center: Points
    inertia: Points


def union_properties(solids: Sequence[Solid]) -> MassProperties:
    """Return the mass properties of the union, at unit density."""
    whole = manifold3d.Manifold.batch_boolean(
        [_manifold(s) for s in solids], manifold3d.OpType.Add
    )
    mesh = whole.to_mesh()
    V = np.asarray(mesh.vert_properties, float)[:, :3] / _SCALE
    T = np.asarray(mesh.tri_verts)
    a, b, c = V[T[:, 0]], V[T[:, 1]], V[T[:, 2]]
    det = np.einsum("ij,ij->i", a, np.cross(b, c))
    volume = det.sum() / 6
    center = (det[:, None] * (a + b + c)).sum(axis=0) / 24 / volume
    # Integral of x x^T over a tetrahedron with a corner at the origin.
    s = a + b + c
    second = np.einsum("i,ij,ik->jk", det, s, s)
    for p in (a, b, c):
        second += np.einsum("i,ij,ik->jk", det, p, p)
    second = second / 120 - volume * np.outer(center, center)
    return MassProperties(volume, center, np.trace(second) * np.eye(3) - second)


_SCALE = 1000.0  # millimetres keep single precision and tolerances comfortable


def _manifold(solid: Solid) -> manifold3d.Manifold:
    mesh = manifold3d.Mesh(
        vert_properties=np.asarray(solid.vertices * _SCALE, np.float32),
        tri_verts=np.asarray(solid.triangles(), np.uint32),
    )
    return manifold3d.Manifold(mesh)
