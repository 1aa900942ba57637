"""Geometry helpers: cross products, blends, convex pieces, Drake's shapes and views."""

from __future__ import annotations

import dataclasses as dc
import functools
from typing import TypeAlias

import numpy as np
from pydrake import geometry
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.types import Box, Cylinder, Shape, Sphere, Vector


def cross(a: Vector, b: Vector) -> Vector:
    """Return cross products over the last axis, in a third of the time of np.cross."""
    ax, ay, az = (a[..., i] for i in range(3))
    bx, by, bz = (b[..., i] for i in range(3))
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def minimum_jerk_blend(s: float) -> float:
    """Return the progress of a rest-to-rest motion with minimum jerk, 0 .. 1.

    T. Flash, N. Hogan, J. Neurosci. 5(7), 1985.

    Args:
        s: Time since the start as a share of the duration. The motion rests before 0
            and after 1.
    """
    s = min(max(s, 0.0), 1.0)
    return s**3 * (10.0 + s * (6.0 * s - 15.0))


@dc.dataclass(frozen=True, eq=False, repr=False)
class ConvexPieces:
    """A solid that is the union of convex pieces, such as a model's collision meshes.

    Its origin may be anywhere. After `centered_pieces`, it is the centre of the
    bounding box, as for the simple shapes.

    Attributes:
        pieces: Corners of each piece [m], shape (n, 3) each, n >= 4.
    """

    pieces: tuple[Vector, ...]

    def __repr__(self) -> str:
        size = " x ".join(f"{1e3 * side:.0f}" for side in self.bounding_size)
        return f"solid of {len(self.pieces)} convex pieces, {size} mm"

    @property
    def corners(self) -> Vector:
        """Corners of all pieces [m], shape (n, 3)."""
        return np.concatenate(self.pieces)

    @property
    def height(self) -> float:
        """Extent along the object's z [m]."""
        return float(self.bounding_size[2])

    @property
    def bounding_size(self) -> Vector:
        """Extents along the object's x, y, z [m], shape (3,)."""
        return np.asarray(np.ptp(self.corners, axis=0))

    def half_extent(self, direction: Vector) -> float:
        """Return the distance from the origin to the farthest point along a direction.

        For simple shapes, whose origin is their centre, this is half of the extent.

        Args:
            direction: Unit vector in the object's frame, shape (3,).
        """
        return float(np.max(self.corners @ direction))

    @property
    def middle(self) -> Vector:
        """Middle of the bounding box, shape (3,) [m]."""
        corners = self.corners
        return np.asarray(0.5 * (corners.min(axis=0) + corners.max(axis=0)))

    def rotated(self, R: Vector) -> ConvexPieces:
        """Return the same solid, rotated about its origin by a matrix R, (3, 3)."""
        return ConvexPieces(tuple(piece @ R.T for piece in self.pieces))

    def translated(self, p: Vector) -> ConvexPieces:
        """Return the same solid, moved by p in its frame, shape (3,) [m]."""
        return ConvexPieces(tuple(piece + p for piece in self.pieces))

    @functools.cached_property
    def faces(self) -> tuple[tuple[Vector, Vector], ...]:
        """Outward unit normals (m, 3) and their distances from the origin (m,) [m]."""
        return tuple(_faces(piece) for piece in self.pieces)

    @functools.cached_property
    def balls(self) -> tuple[tuple[Vector, float], ...]:
        """Centre (3,) and radius of a ball around each piece [m]."""
        centers = [piece.mean(axis=0) for piece in self.pieces]
        return tuple(
            (center, float(np.linalg.norm(piece - center, axis=1).max()))
            for piece, center in zip(self.pieces, centers, strict=True)
        )

    @functools.cached_property
    def center_of_mass(self) -> Vector:
        """Approximate centre of mass at uniform density, shape (3,) [m].

        The mean of a piece's corners stands for the piece's centre of mass.
        """
        from pydrake.geometry.optimization import VPolytope

        volumes = [VPolytope(piece.T).CalcVolume() for piece in self.pieces]
        centers = [piece.mean(axis=0) for piece in self.pieces]
        return np.average(centers, axis=0, weights=volumes)

    @functools.cached_property
    def resting(self) -> tuple[Vector, ...]:
        """Directions (3,) that may point down while the solid rests on a plane.

        The solid can rest on a face of its convex hull if its centre of mass, at
        uniform density, is above that face. Of directions within 10 degrees of each
        other, only one is listed.
        """
        return tuple(_resting(self))


Solid: TypeAlias = Shape | ConvexPieces


def _faces(corners: Vector) -> tuple[Vector, Vector]:
    from pydrake.geometry.optimization import HPolyhedron, VPolytope

    hull = HPolyhedron(VPolytope(corners.T))
    A, b = hull.A(), hull.b()
    length = np.linalg.norm(A, axis=1)
    return A / length[:, None], b / length


def _resting(solid: ConvexPieces) -> list[Vector]:
    import cv2

    corners = solid.corners
    center = solid.center_of_mass
    found: list[Vector] = []
    for down, offset in zip(*_faces(corners), strict=True):
        if any(down @ other > np.cos(np.deg2rad(10.0)) for other in found):
            continue
        across = np.linalg.svd(down[None])[2][1:]
        face = corners[corners @ down > offset - 1e-4] @ across.T
        polygon = cv2.convexHull((1e3 * face).astype(np.float32))
        x, y = 1e3 * across @ center
        if cv2.pointPolygonTest(polygon, (float(x), float(y)), False) >= 0:
            found.append(down)
    return found


def centered_pieces(pieces: list[Vector]) -> tuple[ConvexPieces, Vector]:
    """Return convex pieces centred on their bounding box, and its centre.

    Args:
        pieces: Corners of each piece in a frame O [m], shape (n, 3) each.

    Returns:
        The solid, in a frame that is parallel to O with its origin C at the centre, and
        p_OC [m], shape (3,).

    Raises:
        ValueError: If a piece is flat or empty.
    """
    p_OC = ConvexPieces(tuple(pieces)).middle
    for i, piece in enumerate(pieces):
        if len(piece) < 4 or np.linalg.svd(piece - piece.mean(axis=0))[1][2] < 1e-9:
            raise ValueError(f"piece {i} of {len(pieces)} has no volume")
    return ConvexPieces(tuple(piece - p_OC for piece in pieces)), p_OC


def drake_shape(solid: Solid) -> geometry.Shape:
    """Return a shape as Drake's geometry; several pieces become their convex hull."""
    match solid:
        case Cylinder(radius, length):
            return geometry.Cylinder(radius, length)
        case Box(size):
            return geometry.Box(*size)
        case Sphere(radius):
            return geometry.Sphere(radius)
        case ConvexPieces():
            return geometry.Convex(solid.corners.T, "hull")


def look_at(p_WC: Vector, p_WL: Vector) -> RigidTransform:
    """Return the pose of an upright camera (z ahead, y down) that looks at a point.

    Args:
        p_WC: Position of the camera, shape (3,) [m].
        p_WL: The point, not straight above or below the camera, shape (3,) [m].
    """
    z = (p_WL - p_WC) / np.linalg.norm(p_WL - p_WC)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return RigidTransform(RotationMatrix(np.column_stack([x, np.cross(z, x), z])), p_WC)
