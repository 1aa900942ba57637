"""Outlines of solids in an image: polygons that move with the solid."""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Callable

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform

from drake_srg.common.convex_pieces import Solid
from drake_srg.common.cross import cross
from drake_srg.types import Vector
from drake_srg.vision.mask import Mask
from drake_srg.vision.solids import outline_points
from drake_srg.vision.view import View

# Corners are clipped here [pixels]: farther ones overflow OpenCV and change nothing.
_FAR = 1e4


@dc.dataclass(frozen=True)
class Outline:
    """The outline of a solid in a view's window: the union of its convex pieces'."""

    pieces: tuple[PieceOutline, ...]

    @classmethod
    def of(cls, shape: Solid, X_WO: RigidTransform, view: View) -> Outline:
        """Return the outline of a solid at a pose."""
        R_WO, p_WO = X_WO.rotation().matrix(), X_WO.translation()
        points = outline_points(shape, R_WO.T @ (view.origin - p_WO))
        return cls(tuple(PieceOutline.of(p_O, X_WO, view) for p_O in points))

    def distance(self, pixels: Vector) -> tuple[Vector, Vector]:
        """Return how far pixels are beyond the nearest side of the nearest piece.

        Args:
            pixels: Columns and rows, shape (n, 2).

        Returns:
            Distance [pixels], negative inside, and depth of the solid at the side [m],
            shape (n,).
        """
        return self._nearest(pixels, PieceOutline.distance)

    def gradient(self, pixels: Vector) -> tuple[Vector, Vector]:
        """Return the same distance, and how it changes.

        Args:
            pixels: Columns and rows, shape (n, 2).

        Returns:
            Distance [pixels], shape (n,), and its Jacobian, as that of the corners,
            shape (n, 6).
        """
        return self._nearest(pixels, PieceOutline.gradient)

    def _nearest(
        self,
        pixels: Vector,
        measure: Callable[[PieceOutline, Vector], tuple[Vector, Vector]],
    ) -> tuple[Vector, Vector]:
        """Return the distance of each pixel's nearest piece, and what goes with it."""
        first, *others = self.pieces
        nearest = measure(first, pixels)
        for piece in others:
            center, radius = piece.circle
            beyond = np.linalg.norm(pixels - center, axis=1) - radius
            near = np.flatnonzero(beyond < nearest[0])
            found = measure(piece, pixels[near])
            nearer = found[0] < nearest[0][near]
            for values, more in zip(nearest, found, strict=True):
                values[near[nearer]] = more[nearer]
        return nearest

    def mask(self, shape: tuple[int, ...]) -> Mask:
        """Return which pixels lie within the outline, to the nearest pixel.

        Args:
            shape: Of the image, (h, w).
        """
        mask = np.zeros(shape, np.uint8)
        for piece in self.pieces:
            cv2.fillConvexPoly(mask, np.rint(piece.corners).astype(np.int32), 1)
        return np.asarray(mask > 0)

    def ring(self, grow: float, count: int) -> Vector:
        """Return points spaced evenly along the outline.

        Args:
            grow: How far to move them outwards [pixels].
            count: How many along each piece. Those inside other pieces are left out.

        Returns:
            Columns and rows, shape (n, 2).
        """
        if len(self.pieces) == 1:
            return self.pieces[0].ring(grow, count)
        points = np.concatenate([piece.ring(0.0, count) for piece in self.pieces])
        moved = np.concatenate([piece.ring(grow, count) for piece in self.pieces])
        # On an outline, single precision may tell a little less than 0.
        return np.asarray(moved[self.distance(points)[0] > -1e-4])


@dc.dataclass(frozen=True)
class PieceOutline:
    """The outline of a convex piece in a view's window.

    Attributes:
        corners: Corners of the convex polygon, in order [pixels], shape (m, 2).
        depth: Depth of the solid at the corners, along the imager's z [m], shape (m,).
        jacobian: Change of the corners with the solid's translation [pixels / m] and
            its rotation about its centre [pixels / rad], both in W, shape (m, 2, 6).
    """

    corners: Vector
    depth: Vector
    jacobian: Vector

    @classmethod
    def of(cls, p_O: Vector, X_WO: RigidTransform, view: View) -> PieceOutline:
        """Return the outline of the convex hull of points (n, 3) at a pose [m]."""
        R_WO, p_WO = X_WO.rotation().matrix(), X_WO.translation()
        p_W = p_O @ R_WO.T + p_WO
        corners = np.clip(view.project(p_W), -_FAR, _FAR)
        # This turns from the image's x towards its y, whatever OpenCV calls it.
        hull = cv2.convexHull(
            corners.astype(np.float32), clockwise=False, returnPoints=False
        )[:, 0]
        p_W, corners = p_W[hull], corners[hull]
        p_D = (p_W - view.origin) @ view.R_WD
        x, y, z = p_D.T
        # The image's x is focal x / z plus a constant, and so is its y.
        (fx, fy), zero = view.focal, np.zeros(len(z))
        by_D = np.stack(
            [
                np.stack([fx / z, zero, -fx * x / z**2], axis=-1),
                np.stack([zero, fy / z, -fy * y / z**2], axis=-1),
            ],
            axis=1,
        )
        by_W = by_D @ view.R_WD.T
        # A turn moves a point by turn x r, and a coordinate g by g . (turn x r).
        by_turn = cross((p_W - p_WO)[:, None], by_W)
        return cls(corners, z, np.concatenate([by_W, by_turn], axis=-1))

    @property
    def circle(self) -> tuple[Vector, float]:
        """Centre (2,) and radius of a circle around the outline [pixels]."""
        center = self.corners.mean(axis=0)
        return center, float(np.linalg.norm(self.corners - center, axis=1).max())

    def distance(self, pixels: Vector) -> tuple[Vector, Vector]:
        """Return how far pixels are beyond the outline's nearest side.

        See `Outline.distance`.
        """
        distance, k, share = self._nearest_side(pixels)
        share = np.clip(share, 0.0, 1.0)
        return distance, self.depth[k] + share * (_next(self.depth) - self.depth)[k]

    def gradient(self, pixels: Vector) -> tuple[Vector, Vector]:
        """Return the same distance, and how it changes; see `Outline.gradient`."""
        distance, k, share = self._nearest_side(pixels)
        _, _, normals = self._sides
        at_start, at_end = (
            np.einsum("mi,mij->mj", normals, jacobian)
            for jacobian in (self.jacobian, _next(self.jacobian))
        )
        moves = at_start[k] + share[:, None] * (at_end - at_start)[k]
        return distance, -moves

    def _nearest_side(
        self, pixels: Vector
    ) -> tuple[Vector, npt.NDArray[np.intp], Vector]:
        """Return each pixel's distance from its nearest side, and where that is.

        Returns:
            Distance [pixels], the side, and the share of the side's length at which the
            pixel is beside it, shape (n,) each.
        """
        sides, lengths, normals = self._sides
        # Single precision tells which side it is in half of the time.
        offsets = (normals * self.corners).sum(axis=1).astype(np.float32)
        rough = pixels.astype(np.float32) @ normals.T.astype(np.float32) - offsets
        k = rough.argmax(axis=1)
        from_corner = pixels - self.corners[k]
        beyond = _dot(from_corner, normals[k])
        return beyond, k, _dot(from_corner, sides[k]) / lengths[k]

    def ring(self, grow: float, count: int) -> Vector:
        """Return points spaced evenly along the outline.

        Args:
            grow: How far to move them outwards [pixels].
            count: How many.

        Returns:
            Columns and rows, shape (count, 2).
        """
        sides, lengths, normals = self._sides
        end = np.cumsum(lengths)
        walk = (np.arange(count) + 0.5) / count * end[-1]
        k = np.minimum(np.searchsorted(end, walk), len(end) - 1)
        back = (walk - end[k] + lengths[k])[:, None]
        return np.asarray(self.corners[k] + back * sides[k] + grow * normals[k])

    @functools.cached_property
    def _sides(self) -> tuple[Vector, Vector, Vector]:
        """Directions (m, 2), lengths (m,) and outward normals (m, 2)."""
        sides = _next(self.corners) - self.corners
        lengths = np.maximum(np.linalg.norm(sides, axis=1), 1e-9)
        sides = sides / lengths[:, None]
        return sides, lengths, np.stack([sides[:, 1], -sides[:, 0]], axis=1)


def _dot(a: Vector, b: Vector) -> Vector:
    """Return the dot products of rows, shape (n, 2) each; sum(axis=1) is slow."""
    return a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1]


def _next(values: Vector) -> Vector:
    """Return the value of each corner's next one, in a fraction of np.roll's time."""
    return np.concatenate([values[1:], values[:1]])
