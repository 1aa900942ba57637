"""Labels pixels around a solid's supposed pose: inside, outside or unknown."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform

from drake_srg.common.convex_pieces import Solid
from drake_srg.types import Vector
from drake_srg.vision.mask import Mask, grow, has_depth
from drake_srg.vision.outline import Outline
from drake_srg.vision.robust import robust_deviation
from drake_srg.vision.solids import signed_distance
from drake_srg.vision.view import View

Labels = npt.NDArray[np.int8]
# Whether a pixel shows the solid. UNKNOWN is hidden, without depth, or in doubt.
OUTSIDE, UNKNOWN, INSIDE = -1, 0, 1

# Distance that a visible point of the solid may always be off its surface [m], and the
# same as a share of its radius. A renderer's depth has no noise, but Drake draws
# circles with 50 sides, up to 0.2 % inside the radius.
_FINEST = 1e-4
_FINEST_SHARE = 3e-3
# Distance that it may be off if the points scatter or the pose is in doubt [m].
_COARSEST = 3e-3
_DEVIATIONS = 4.0  # both are at least this many standard deviations of noise
# A surface is visible where ray times outward normal is less than this. It is not 0
# because depth is too coarse where a surface is seen edge-on.
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
        blob: Which pixels belong to the blob and have depth, shape (n,).
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
        """Which pixels show points on the solid's surface, shape (n,)."""
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

    Colour alone does not show where an object ends: shading may take a pixel out of the
    colour's range, and a pixel on the rim mixes two colours. Depth alone does not show
    it where an object touches another. So a pixel is INSIDE if its point is on the
    surface and its colour is the blob's; without noise, a neighbour of that colour is
    enough. A pixel is UNKNOWN if only one of the two holds, or if its point is in front
    of the solid.

    Args:
        shape: The solid.
        X_WO: Its supposed pose.
        view: Where to look. The blob must have depth.
        margin: How far beyond the outline to look [pixels].
        doubt: How far the pose may be off, and with it the points off the surface [m].
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
    # A surface that faces away is not visible.
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

    # A slanting surface may come nearer by about a pixel's width per pixel.
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
