"""What the pixels around a solid's supposed pose say about it."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform

from drake_srg.types import Shape, Vector
from drake_srg.vision.mask import Mask, grown
from drake_srg.vision.outline import Outline
from drake_srg.vision.solids import bounding_size, signed_distance
from drake_srg.vision.view import View

Labels = npt.NDArray[np.int8]
# Whether a pixel shows the solid; UNKNOWN is hidden, without depth, or in doubt.
OUTSIDE, UNKNOWN, INSIDE = -1, 0, 1

# What other values change is measured by experiment localizer_thresholds.

# Least and most that a visible point of the solid may be off its surface. A renderer's
# depth has no noise, but Drake draws circles with 50 sides, 0.2 % inside the radius.
_FINEST, _FINEST_SHARE, _COARSEST = 1e-4, 3e-3, 3e-3  # m, of the radius, m
_DEVIATIONS = 4.0  # of a camera's noise, instead, where that is more
_BEHIND = 0.3  # cosine; numbers are too coarse where a surface is seen edge-on


@dc.dataclass(frozen=True)
class Sight:
    """The pixels of a blob and those near a solid's outline.

    Attributes:
        pixels: Columns and rows, shape (n, 2).
        points: What is seen there, in W [m], shape (n, 3); infinite where nothing is.
        distance: Signed distance of the pixels to the outline [pixels], shape (n,).
        labels: Shape (n,).
        blob: Pixels of the blob that see something, shape (n,).
        error: Signed distance of the points to the solid [m], shape (n,).
        thickness: Most that a point on the surface is off it [m].
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
        """Pixels whose points lie on the solid's surface, shape (n,)."""
        return np.asarray(np.abs(self.error) <= self.thickness)


def look(
    shape: Shape, X_WO: RigidTransform, view: View, *, margin: int, doubt: float = 0.0
) -> Sight:
    """Look at the blob and at what is within the outline, or near it.

    Colour alone does not say where an object ends: shading may take a pixel out of the
    colour's range, and a pixel on the rim mixes two colours. Depth alone does not say
    either, where an object touches another. So a pixel is INSIDE where its point is on
    the surface and its colour is the blob's, or its neighbour's is and noise is not
    what puts it there. Where only one of the two holds, or the point is in front of the
    solid, it is UNKNOWN.

    Args:
        shape: The solid.
        X_WO: Its supposed pose.
        view: Where to look; the blob must have depth.
        margin: How far off the outline to look [pixels].
        doubt: How far the pose may be off [m]; points may be as far off the surface.
    """
    outline = Outline.of(shape, X_WO, view)
    region = grown(outline.mask(view.depth.shape), margin)
    rows, columns = np.nonzero(region | view.blob)
    pixels = np.stack([columns, rows], axis=1)
    distance, _, contour_depth = outline.distance(pixels.astype(float))

    depth, blob = view.depth[rows, columns], view.blob[rows, columns]
    valid = np.isfinite(depth) & (depth > 0)
    finite = np.where(valid, depth, 0.0)
    points = view.origin + view.rays[rows, columns] * finite[:, None]
    R_WO = X_WO.rotation().matrix()
    error, normals = signed_distance(shape, (points - X_WO.translation()) @ R_WO)
    # What faces away cannot be seen.
    facing = ((view.rays[rows, columns] @ R_WO) * normals).sum(axis=1) < _BEHIND
    error = np.where(valid & facing, error, np.inf)
    points[~valid] = np.inf
    spread = 4 * 1.4826 * float(np.median(np.abs(error[blob & valid])))
    sides = _FINEST_SHARE * 0.5 * float(bounding_size(shape)[0])
    noise = _DEVIATIONS * view.noise
    coarsest = max(_COARSEST, noise)
    finest = min(coarsest, max(_FINEST, sides, doubt, noise))
    thickness = min(coarsest, max(finest, spread))

    # A slanting surface may come nearer by about a pixel's width a pixel.
    slack = thickness + 2 * contour_depth / view.focal[0]
    hidden = np.isnan(depth) | (depth <= 0) | (depth < contour_depth - slack)
    on_surface = np.abs(error) <= thickness
    doubtful = on_surface | (blob & (np.abs(error) <= coarsest))
    labels = np.full(len(pixels), OUTSIDE, dtype=np.int8)
    labels[hidden | doubtful | view.others[rows, columns]] = UNKNOWN
    labels[on_surface & blob] = INSIDE
    if not view.noise:
        labels[(np.abs(error) <= finest) & grown(view.blob, 1)[rows, columns]] = INSIDE
    else:
        labels[blob & ~on_surface] = UNKNOWN
    return Sight(pixels, points, distance, labels, blob & valid, error, thickness)
