"""Where a known shape is, given the depth pixels of its visible surface.

An upright cylinder or box is found by its top: a plane through the highest points,
then the outline of known size that best separates pixels on the top from pixels that
look past it. Pixels with something nearer than the top say nothing and are left out, so
an outline half hidden still gives the whole position. A ball is fitted to its points.
"""

from __future__ import annotations

import dataclasses as dc

import cv2
import numpy as np
import numpy.typing as npt

from drake_srg.types import Box, Cylinder, Shape, Sphere, Vector
from drake_srg.vision.outline import (
    circle,
    fit_outline,
    guess_rectangle,
    outline_samples,
    rectangle,
)
from drake_srg.vision.view import View

Mask = npt.NDArray[np.bool_]
Labels = npt.NDArray[np.int8]
# What a pixel says about the outline; UNKNOWN is hidden, without depth, or another's.
OUTSIDE, UNKNOWN, INSIDE = -1, 0, 1

_FLOOR = 5e-5  # m, least thickness of a surface: a renderer's depth has no noise
_STEEPEST = np.cos(np.deg2rad(15.0))  # a top leaning more is taken as not understood
_UP = np.array([0.0, 0.0, 1.0])


@dc.dataclass(frozen=True)
class Fit:
    """Position of a shape.

    Attributes:
        position: Centre p_WO [m], shape (3,).
        axis: The shape's z axis in W, shape (3,).
        quality: Share of the expected outline seen, 0 .. 1.
        cut: Part of the expected outline lies outside the image.
        hidden: More than a tenth of the outline in the image was not found.
    """

    position: Vector
    axis: Vector
    quality: float
    cut: bool
    hidden: bool


def fit_shape(shape: Shape, view: View) -> Fit | None:
    """The centre of `shape`, or None where the view shows too little of it."""
    if isinstance(shape, Sphere):
        return _fit_sphere(shape, view)
    return _fit_upright(shape, view)


def fit_plane(points: Vector, extent: float) -> tuple[Vector, Vector, float]:
    """The plane through the topmost of `points`, nearly level.

    Grows from the points near the highest ones and narrows to four standard deviations
    of what it holds. A patch too narrow to tell its slope is taken as level.

    Args:
        points: Shape (n, 3), n > 0, z up [m].
        extent: Size of the surface looked for [m].

    Returns:
        Unit normal (3,), a point of the plane (3,), half its thickness [m].
    """
    normal, thickness = _UP, 3e-3
    center = np.array([0.0, 0.0, np.quantile(points[:, 2], 0.95)])
    for _ in range(6):
        height = (points - center) @ normal
        top = points[np.abs(height) <= thickness]
        if len(top) < 3:
            break
        center = top.mean(axis=0)
        variance, axes = np.linalg.eigh(np.cov(top.T))
        lean = axes[:, 0] * np.copysign(1.0, axes[2, 0])
        wide = variance[1] > (0.1 * extent) ** 2
        normal = lean if wide and lean[2] > _STEEPEST else _UP
        residual = np.abs((top - center) @ normal)
        thickness = min(thickness, max(_FLOOR, 4 * 1.4826 * float(np.median(residual))))
    return normal, center, thickness


def _fit_upright(shape: Cylinder | Box, view: View) -> Fit | None:
    points = view.points()
    seen = points[view.blob & np.isfinite(view.depth) & (view.depth > 0)]
    if len(seen) < 3:
        return None
    size = (2 * shape.radius,) * 2 if isinstance(shape, Cylinder) else shape.size[:2]
    normal, center, thickness = fit_plane(seen, min(size))

    with np.errstate(invalid="ignore"):
        height = (points - center) @ normal
    labels = _label(view, height, thickness)
    if not (labels == INSIDE).any():
        return None
    # Where each pixel's ray meets the plane, in the plane's own coordinates.
    reach = ((center - view.origin) @ normal) / (view.rays @ normal)
    e1 = np.cross(_UP if abs(normal[2]) < 0.5 else [0.0, 1.0, 0.0], normal)
    basis = np.stack([e1, np.cross(normal, e1)]) / np.linalg.norm(e1)
    plane = (view.origin + view.rays * reach[..., None] - center) @ basis.T
    pixel = float(np.median(reach[labels == INSIDE])) / view.focal

    use = _edge(labels) & (reach > 0)
    deepest = cv2.distanceTransform(
        np.pad(labels == INSIDE, 1).astype(np.uint8), cv2.DIST_L2, 3
    )[1:-1, 1:-1].argmax()
    start = plane.reshape(-1, 2)[deepest]
    if isinstance(shape, Cylinder):
        outline = circle(shape.radius)
    else:
        outline = rectangle(*shape.size[:2])
        start = guess_rectangle(plane[labels == INSIDE], shape.size)
    found = fit_outline(outline, plane[use], labels[use] == INSIDE, start, pixel)

    def ring(grow: float) -> Vector:
        return center + outline_samples(shape, found, grow) @ basis

    quality, cut, hidden = _seen(view, labels, ring(-1.5 * pixel), ring(1.5 * pixel))
    position = center + found[:2] @ basis - 0.5 * shape.height * normal
    return Fit(position, normal, quality, cut, hidden)


def _fit_sphere(shape: Sphere, view: View) -> Fit | None:
    points = view.points()
    valid = np.isfinite(view.depth) & (view.depth > 0)
    seen = points[view.blob & valid]
    if len(seen) < 3:
        return None
    toward = seen.mean(axis=0) - view.origin
    distance = float(np.linalg.norm(toward))
    center = seen.mean(axis=0) + 0.6 * shape.radius * toward / distance
    for _ in range(20):
        away = seen - center
        r = np.linalg.norm(away, axis=1)
        error = r - shape.radius
        scale = max(_FLOOR, 3 * 1.4826 * float(np.median(np.abs(error))))
        weight = np.minimum(1.0, scale / np.maximum(np.abs(error), 1e-12))  # Huber
        J = away / r[:, None]
        H = (J.T * weight) @ J + 1e-9 * np.eye(3)
        step = np.linalg.solve(H, J.T @ (weight * error))
        center = center + step
        if float(np.linalg.norm(step)) < 1e-7:
            break

    with np.errstate(invalid="ignore"):
        off = np.linalg.norm(points - center, axis=-1) - shape.radius
        nearer = valid & ((points - center) @ toward < -shape.radius * distance)
    height = np.where(nearer, 1.0, np.where(np.abs(off) <= scale, 0.0, -1.0))
    labels = _label(view, np.where(view.depth > 0, height, np.nan), 0.5)
    # The rim a camera sees is a small circle, on the near side of the equator.
    toward = center - view.origin
    distance = float(np.linalg.norm(toward))
    toward = toward / distance
    rim = center - shape.radius**2 / distance * toward
    radius = shape.radius * np.sqrt(max(0.0, 1 - (shape.radius / distance) ** 2))
    e1 = np.cross(toward, [1.0, 0.0, 0.0] if abs(toward[0]) < 0.9 else _UP)
    basis = np.stack([e1, np.cross(toward, e1)]) / np.linalg.norm(e1)
    pixel = distance / view.focal

    def ring(grow: float) -> Vector:
        flat = outline_samples(Cylinder(radius, 0.0), np.zeros(2), grow)
        return np.asarray(rim + flat @ basis)

    return Fit(center, _UP, *_seen(view, labels, ring(-1.5 * pixel), ring(1.5 * pixel)))


def _label(view: View, height: Vector, thickness: float) -> Labels:
    """What each pixel says, from its height over the surface looked for.

    The colour mask may miss the mixed pixels of its rim; depth decides there.
    """
    blob = cv2.dilate(view.blob.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    labels = np.full(height.shape, OUTSIDE, dtype=np.int8)
    labels[(np.abs(height) <= thickness) & blob] = INSIDE
    labels[(height > thickness) | np.isnan(height) | (view.depth <= 0)] = UNKNOWN
    labels[(np.abs(height) <= thickness) & view.others & ~blob] = UNKNOWN
    return labels


def _edge(labels: Labels) -> Mask:
    """Pixels that lie within three of both an inside and an outside one."""
    kernel = np.ones((7, 7), np.uint8)
    near = [
        cv2.dilate((labels == which).astype(np.uint8), kernel) > 0
        for which in (INSIDE, OUTSIDE)
    ]
    return np.asarray(near[0] & near[1] & (labels != UNKNOWN))


def _seen(
    view: View, labels: Labels, inner: Vector, outer: Vector
) -> tuple[float, bool, bool]:
    """Quality, cut, hidden of an outline between two rings of world points."""
    h, w = labels.shape

    def at(points: Vector) -> tuple[Labels, Mask]:
        u, v = np.rint(view.project(points)).astype(int).T
        inside = (u >= 0) & (v >= 0) & (u < w) & (v < h)
        return labels[np.clip(v, 0, h - 1), np.clip(u, 0, w - 1)], inside

    (inner_label, inner_in), (outer_label, outer_in) = at(inner), at(outer)
    in_image = inner_in & outer_in
    found = in_image & (inner_label == INSIDE) & (outer_label == OUTSIDE)
    missing = (in_image & ~found).mean()
    return float(found.mean()), bool((~in_image).any()), bool(missing > 0.1)
