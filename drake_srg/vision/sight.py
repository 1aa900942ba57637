"""Views of a solid at an assumed pose: its outline, and labelled pixels."""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform

from drake_srg.common.geometry import Solid, cross
from drake_srg.types import Vector
from drake_srg.vision.camera import Imager
from drake_srg.vision.images import Mask, grow, has_depth, robust_deviation, window
from drake_srg.vision.solids import outline_points, signed_distance


@dc.dataclass(frozen=True)
class View:
    """A window of one depth image around a blob, with its geometry in world W.

    Attributes:
        origin: p_WD, the imager's centre [m], shape (3,).
        R_WD: Orientation of the imager, shape (3, 3).
        rays: Directions in W per unit of depth, shape (h, w, 3).
        depth: Along the imager's z [m], shape (h, w); 0 is too near, inf too far.
        valid: Pixels that have depth, shape (h, w).
        points: The visible surface in W [m], shape (h, w, 3); not finite where depth is
            infinite.
        blob: Pixels of the blob, shape (h, w).
        others: Pixels of the same colour outside the blob, shape (h, w).
        project: Maps points in W (n, 3) to (column, row) in the window, (n, 2).
        focal: Focal lengths [pixels], shape (2,).
        noise: Standard deviation of depth at the blob [m].
    """

    origin: Vector
    R_WD: Vector
    rays: Vector
    depth: Vector
    valid: Mask
    points: Vector
    blob: Mask
    others: Mask
    project: Callable[[Vector], Vector]
    focal: Vector
    noise: float = 0.0

    @property
    def seen(self) -> Vector:
        """The points that the blob shows, in W [m], shape (n, 3)."""
        return np.asarray(self.points[self.blob & self.valid])


def view_around(
    shape: Solid,
    blob: Mask,
    colored: Mask,
    depth: npt.NDArray[Any],
    color_imager: Imager,
    depth_imager: Imager,
    X_WB: RigidTransform,
    noise: float = 0.0,
) -> View | None:
    """Return the view of a blob, wide enough for the whole object.

    Args:
        shape: The object's shape. Its size sets the window's margin.
        blob: Pixels of the blob, shape (color height, color width).
        colored: Pixels of the target's colour, same shape.
        depth: Along the depth imager's z [m], shape (depth height, depth width).
        color_imager: The imager of `blob` and `colored`.
        depth_imager: The imager of `depth`.
        X_WB: Pose of the camera body in world.
        noise: Standard deviation of 1 / depth [1/m].

    Returns:
        None if no pixel of the blob has depth.
    """
    h, w = depth.shape
    if not depth_imager.same_as(color_imager):
        # Carry the masks over to the depth image's pixels.
        finite = np.where(np.isfinite(depth), depth, 0.0)
        p_D = depth_imager.rays(slice(0, w), slice(0, h)) * finite[..., None]
        X_CD = color_imager.X_BI.inverse() @ depth_imager.X_BI
        p_C = p_D @ X_CD.rotation().matrix().T + X_CD.translation()
        blob, colored = (color_imager.lookup(p_C, mask) for mask in (blob, colored))
    usable = blob & has_depth(depth)
    if not usable.any():
        return None
    reach = np.linalg.norm(shape.bounding_size) * depth_imager.info.focal_x()
    margin = int(np.ceil(reach / depth[usable].min())) + 3
    noise *= float(np.median(depth[usable])) ** 2
    rows, columns = window(usable, margin)
    blob, colored = blob[rows, columns], colored[rows, columns]
    depth = depth[rows, columns].astype(float)
    X_WD = X_WB @ depth_imager.X_BI
    R_WD, p_WD = X_WD.rotation().matrix(), X_WD.translation()
    rays = depth_imager.rays(columns, rows) @ R_WD.T
    with np.errstate(invalid="ignore"):  # 0 times infinity
        points = p_WD + rays * depth[..., None]
    corner = np.array([columns.start, rows.start])
    return View(
        origin=p_WD,
        R_WD=R_WD,
        rays=rays,
        depth=depth,
        valid=has_depth(depth),
        points=points,
        blob=blob,
        others=colored & ~blob,
        project=lambda p_W: depth_imager.project((p_W - p_WD) @ R_WD) - corner,
        focal=np.array([depth_imager.info.focal_x(), depth_imager.info.focal_y()]),
        noise=noise,
    )


# Corners are clipped to this range [pixels]: farther ones would overflow OpenCV and
# make no difference.
_FAR = 1e4


@dc.dataclass(frozen=True)
class Outline:
    """The outline of a solid in a view's window: the union of its pieces' outlines."""

    pieces: tuple[PieceOutline, ...]

    @classmethod
    def of(cls, shape: Solid, X_WO: RigidTransform, view: View) -> Outline:
        """Return the outline of a solid at a pose."""
        R_WO, p_WO = X_WO.rotation().matrix(), X_WO.translation()
        points = outline_points(shape, R_WO.T @ (view.origin - p_WO))
        return cls(tuple(PieceOutline.of(p_O, X_WO, view) for p_O in points))

    def distance(self, pixels: Vector) -> tuple[Vector, Vector]:
        """Return the distances of pixels beyond the nearest side of the nearest piece.

        Args:
            pixels: Columns and rows, shape (n, 2).

        Returns:
            Distance [pixels], negative inside, and depth of the solid at that side [m],
            shape (n,) each.
        """
        return self._nearest(pixels, PieceOutline.distance)

    def gradient(self, pixels: Vector) -> tuple[Vector, Vector]:
        """Return `distance` and its derivatives.

        Args:
            pixels: Columns and rows, shape (n, 2).

        Returns:
            Distance [pixels], shape (n,), and its derivatives by the solid's motion as
            in `PieceOutline.jacobian`, shape (n, 6).
        """
        return self._nearest(pixels, PieceOutline.gradient)

    def _nearest(
        self,
        pixels: Vector,
        measure: Callable[[PieceOutline, Vector], tuple[Vector, Vector]],
    ) -> tuple[Vector, Vector]:
        """Return each pixel's distance from its nearest piece, and related values."""
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
            shape: Shape of the image, (h, w).
        """
        mask = np.zeros(shape, np.uint8)
        for piece in self.pieces:
            cv2.fillConvexPoly(mask, np.rint(piece.corners).astype(np.int32), 1)
        return np.asarray(mask > 0)

    def ring(self, grow: float, count: int) -> Vector:
        """Return points spaced evenly along the outline.

        Args:
            grow: Distance by which to move them outwards [pixels].
            count: Number of points on each piece. Points inside other pieces are left
                out.

        Returns:
            Columns and rows, shape (n, 2).
        """
        if len(self.pieces) == 1:
            return self.pieces[0].ring(grow, count)
        points = np.concatenate([piece.ring(0.0, count) for piece in self.pieces])
        moved = np.concatenate([piece.ring(grow, count) for piece in self.pieces])
        # On an outline, single precision may give a little less than 0.
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
        # OpenCV's `clockwise=False` turns from the image's x towards its y.
        hull = cv2.convexHull(
            corners.astype(np.float32), clockwise=False, returnPoints=False
        )[:, 0]
        p_W, corners = p_W[hull], corners[hull]
        p_D = (p_W - view.origin) @ view.R_WD
        x, y, z = p_D.T
        # The column is focal * x / z plus a constant; the row likewise with y.
        (fx, fy), zero = view.focal, np.zeros(len(z))
        by_D = np.stack(
            [
                np.stack([fx / z, zero, -fx * x / z**2], axis=-1),
                np.stack([zero, fy / z, -fy * y / z**2], axis=-1),
            ],
            axis=1,
        )
        by_W = by_D @ view.R_WD.T
        # A turn moves a point at r by turn x r, and so a pixel with the gradient g by
        # g . (turn x r).
        by_turn = cross((p_W - p_WO)[:, None], by_W)
        return cls(corners, z, np.concatenate([by_W, by_turn], axis=-1))

    @property
    def circle(self) -> tuple[Vector, float]:
        """Centre (2,) and radius of a circle around the outline [pixels]."""
        center = self.corners.mean(axis=0)
        return center, float(np.linalg.norm(self.corners - center, axis=1).max())

    def distance(self, pixels: Vector) -> tuple[Vector, Vector]:
        """Return the distances of pixels beyond the outline's nearest side.

        See `Outline.distance`.
        """
        distance, k, share = self._nearest_side(pixels)
        share = np.clip(share, 0.0, 1.0)
        return distance, self.depth[k] + share * (_next(self.depth) - self.depth)[k]

    def gradient(self, pixels: Vector) -> tuple[Vector, Vector]:
        """Return `distance` and its derivatives; see `Outline.gradient`."""
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
        """Return each pixel's distance beyond its nearest side, and the place there.

        Returns:
            Distance [pixels], index of the side, and the place along the side as a
            share of its length, shape (n,) each.
        """
        sides, lengths, normals = self._sides
        # Single precision is enough to find the side, in half of the time.
        offsets = (normals * self.corners).sum(axis=1).astype(np.float32)
        rough = pixels.astype(np.float32) @ normals.T.astype(np.float32) - offsets
        k = rough.argmax(axis=1)
        from_corner = pixels - self.corners[k]
        beyond = _dot(from_corner, normals[k])
        return beyond, k, _dot(from_corner, sides[k]) / lengths[k]

    def ring(self, grow: float, count: int) -> Vector:
        """Return points spaced evenly along the outline.

        Args:
            grow: Distance by which to move them outwards [pixels].
            count: Number of points.

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
    """Return each corner's successor, in a fraction of np.roll's time."""
    return np.concatenate([values[1:], values[:1]])


Labels = npt.NDArray[np.int8]
# Whether a pixel shows the solid. UNKNOWN: it is hidden, has no depth, or is in doubt.
OUTSIDE, UNKNOWN, INSIDE = -1, 0, 1

# Least tolerance of a visible point's distance from the solid's surface [m], and the
# same as a share of the solid's radius. A renderer's depth is exact, but Drake draws
# circles with 50 sides, up to 0.2 % inside the radius.
_FINEST = 1e-4
_FINEST_SHARE = 3e-3
# Greatest tolerance, if the points scatter or the pose is in doubt [m].
_COARSEST = 3e-3
_DEVIATIONS = 4.0  # both limits are at least this many standard deviations of noise
# A surface counts as visible if ray times outward normal is less than this. The limit
# is not 0, because of errors on surfaces seen edge-on, where depth is coarse.
_EDGE_ON = 0.3


@dc.dataclass(frozen=True)
class Sight:
    """The pixels of a blob and those near a solid's outline.

    Attributes:
        pixels: Columns and rows, shape (n, 2).
        points: Visible points in W [m], shape (n, 3); infinite where nothing is seen.
        distance: Signed distance of the pixels to the outline [pixels], shape (n,);
            negative inside.
        labels: OUTSIDE, UNKNOWN or INSIDE, shape (n,).
        blob: Whether each pixel belongs to the blob and has depth, shape (n,).
        error: Signed distance of the points to the solid's surface [m], shape (n,);
            infinite where the surface is not visible.
        thickness: Greatest distance at which a point counts as on the surface [m].
    """

    pixels: npt.NDArray[np.intp]
    points: Vector
    distance: Vector
    labels: Labels
    blob: Mask
    error: Vector
    thickness: float

    @property
    def surface(self) -> Mask:
        """Return which pixels show points on the solid's surface, shape (n,)."""
        return np.asarray(np.abs(self.error) <= self.thickness)


def look(
    shape: Solid,
    X_WO: RigidTransform,
    view: View,
    *,
    margin: int,
    doubt: float = 0.0,
) -> Sight:
    """Label the pixels of the blob and those within the outline or near it.

    Colour alone does not show where an object ends: shading may move a pixel out of the
    colour's range, and a pixel on the rim mixes two colours. Depth alone does not show
    where one object touches another. So a pixel is INSIDE if its point is on the
    surface and it belongs to the blob. Without noise, a neighbour in the blob is
    enough. A pixel is UNKNOWN if only one of the two conditions holds, or if its point
    is in front of the solid.

    Args:
        shape: The solid.
        X_WO: Its assumed pose.
        view: The view. Its blob must have depth.
        margin: Greatest distance beyond the outline [pixels].
        doubt: Possible error of the pose, and thus of the points' distance to the
            surface [m].
    """
    outline = Outline.of(shape, X_WO, view)
    region = grow(outline.mask(view.depth.shape), margin)
    rows, columns = np.nonzero(region | view.blob)
    pixels = np.stack([columns, rows], axis=1)
    distance, contour_depth = outline.distance(pixels.astype(float))

    depth, blob = view.depth[rows, columns], view.blob[rows, columns]
    valid = has_depth(depth)
    finite = np.where(valid, depth, 0.0)
    rays = view.rays[rows, columns]
    points = view.origin + rays * finite[:, None]
    R_WO = X_WO.rotation().matrix()
    error, normals = signed_distance(shape, (points - X_WO.translation()) @ R_WO)
    # A surface that faces away from the camera is not visible.
    slant = ((rays @ R_WO) * normals) @ np.ones(3)  # sum(axis=1) is slow
    facing = slant < _EDGE_ON
    error = np.where(valid & facing, error, np.inf)
    points[~valid] = np.inf
    spread = 4 * robust_deviation(error[blob & valid])
    sides = _FINEST_SHARE * 0.5 * float(shape.bounding_size[0])
    noise = _DEVIATIONS * view.noise
    coarsest = max(_COARSEST, noise)
    finest = min(coarsest, max(_FINEST, sides, doubt, noise))
    thickness = min(coarsest, max(finest, spread))

    # On a slanting surface, depth may change by about a pixel's width per pixel.
    slack = thickness + 2 * contour_depth / view.focal[0]
    hidden = np.isnan(depth) | (depth <= 0) | (depth < contour_depth - slack)
    on_surface = np.abs(error) <= thickness
    doubtful = on_surface | (blob & (np.abs(error) <= coarsest))
    labels = np.full(len(pixels), OUTSIDE, dtype=np.int8)
    labels[hidden | doubtful | view.others[rows, columns]] = UNKNOWN
    labels[on_surface & blob] = INSIDE
    if not view.noise:
        labels[(np.abs(error) <= finest) & grow(view.blob, 1)[rows, columns]] = INSIDE
    else:
        labels[blob & ~on_surface] = UNKNOWN
    return Sight(pixels, points, distance, labels, blob & valid, error, thickness)
