"""The fit of a solid's pose to a depth image, from a first guess.

At the true pose, the visible points of the solid lie on its surface, and its outline
separates the pixels that show it from those that do not. The first condition is a
robust least squares problem. The second is a logistic regression of the pixels' labels
on their distance to the outline. Its linear tails tolerate wrong labels. Newton's
method minimises the sum of both costs while the outline's softness shrinks from the
first guess's error to a fraction of a pixel.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence

import cv2
import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.common.geometry import ConvexPieces, Solid, cross
from drake_srg.types import Box, Cylinder, Sphere, Vector
from drake_srg.vision.images import robust_deviation
from drake_srg.vision.sight import INSIDE, UNKNOWN, Outline, View, look
from drake_srg.vision.solids import round_axis, signed_distance

Normal = tuple[Vector, Vector]  # gradient (k,) and Hessian (k, k) of a cost

# Least standard deviation of depth [m], for renderers, whose depth has no noise.
_DEPTH_DEVIATION = 1e-4
# Error beyond which Huber's cost is linear [standard deviations]; 95 % efficient for
# normally distributed noise.
_HUBER = 1.345
_SAMPLES = 400  # greatest number of points, and of pixels; more add little
_STEPS = 12  # of Newton's method at one softness, at most
_RIDGE = 1e-9  # added to the Hessian's diagonal, as a share of its trace


@dc.dataclass(frozen=True)
class Alignment:
    """A pose with its standard deviations, from the curvature of the cost.

    Attributes:
        X_WO: The pose.
        position_deviation: Standard deviation of p_WO in the direction in which it is
            largest [m].
        axis_deviation: Standard deviation of the direction of the solid's z [rad], or
            of the orientation of convex pieces; 0 for a ball.
    """

    X_WO: RigidTransform
    position_deviation: float
    axis_deviation: float


def align(
    shape: Solid,
    X_WO: RigidTransform,
    view: View,
    softnesses: Sequence[float],
    *,
    upright: bool = False,
) -> Alignment:
    """Return the pose near a first guess that explains a view best.

    Args:
        shape: The solid.
        X_WO: First guess.
        view: The view. Its blob must have depth.
        softnesses: Softness of the outline in each stage [pixels], from the error of
            the first guess to a fraction of a pixel; at least one.
        upright: Whether the solid's z is fixed.
    """
    radius = 0.5 * float(np.linalg.norm(shape.bounding_size))
    pixel = float(np.linalg.norm(X_WO.translation() - view.origin)) / view.focal[0]
    for softness in softnesses:
        margin, doubt = int(np.ceil(3 + 2 * softness)), softness * pixel
        sight = look(shape, X_WO, view, margin=margin, doubt=doubt)
        # Within the outline, depth decides which pixels belong to the solid:
        # colours may vary.
        points = sight.points[sight.blob | (sight.surface & (sight.distance < -1))]
        known = (sight.labels != UNKNOWN) & (np.abs(sight.distance) < 3 + 8 * softness)
        side = np.where(sight.labels == INSIDE, 1, -1)[known]
        count = len(points)
        points, pixels, side = (
            _thin(values, _SAMPLES) for values in (points, sight.pixels[known], side)
        )
        for _ in range(_STEPS):
            basis = _directions(shape, X_WO, radius, upright)
            b, H = _depth_cost(shape, X_WO, points, count, basis)
            outline = Outline.of(shape, X_WO, view)
            more = _outline_cost(outline, pixels, side, softness, basis)
            b, H = b + more[0], H + more[1]
            H += _RIDGE * np.trace(H) * np.eye(len(H))
            step = -np.linalg.solve(H, b)
            length = float(np.linalg.norm(step))
            shorter = 0.3 * radius / max(length, 0.3 * radius)
            X_WO = _moved(X_WO, basis @ step * shorter)
            if length < 0.03 * softness * pixel:
                break
    covariance = np.linalg.inv(H)
    largest = np.linalg.eigvalsh(covariance[:3, :3])[-1]
    turns = 0.0 if upright else np.diag(covariance)[3:][_matters(shape)].sum()
    return Alignment(X_WO, float(np.sqrt(largest)), float(np.sqrt(turns)) / radius)


def _matters(shape: Solid) -> list[int]:
    """Return the axes of `_directions` about which a rotation is visible."""
    if isinstance(shape, ConvexPieces):
        return [axis for axis in range(3) if axis != round_axis(shape)]
    # The outline of a box shows its turn about z.
    return [] if isinstance(shape, Sphere) else [0, 1]


def _directions(
    shape: Solid, X_WO: RigidTransform, radius: float, upright: bool
) -> Vector:
    """Return the pose's directions: translations, and turns about the visible axes.

    Returns:
        A translation and a rotation vector in W in each column, shape (6, k). A unit
        step is 1 m; for turns, 1 m along a circle of `radius` [m].
    """
    turned = isinstance(shape, Box | ConvexPieces)
    turns = 3 if turned else 2 if isinstance(shape, Cylinder) else 0
    axes = X_WO.rotation().matrix()[:, 2 * upright : turns]
    basis = np.zeros((6, 3 + axes.shape[1]))
    basis[:3, :3] = np.eye(3)
    basis[3:, 3:] = axes / radius
    return basis


def _depth_cost(
    shape: Solid,
    X_WO: RigidTransform,
    points: Vector,
    count: int,
    basis: Vector,
) -> Normal:
    """Return Huber's cost of the points' distances, scaled to `count` points."""
    R, p = X_WO.rotation().matrix(), X_WO.translation()
    error, gradient = signed_distance(shape, (points - p) @ R)
    g = gradient @ R.T
    J = -np.concatenate([g, cross(points - p, g)], axis=1) @ basis
    noise = max(_DEPTH_DEVIATION, robust_deviation(error))
    weight = np.minimum(1.0, _HUBER * noise / np.maximum(np.abs(error), 1e-12))
    weight *= count / len(points) / noise**2
    return J.T @ (weight * error), (J.T * weight) @ J


def _outline_cost(
    outline: Outline, pixels: Vector, side: Vector, softness: float, basis: Vector
) -> Normal:
    """Return the logistic cost of the pixels; `side` is 1 inside, -1 outside."""
    distance, J = outline.gradient(pixels)
    J = J @ basis
    wrong = 0.5 * (1 + np.tanh(0.5 * side * distance / softness))
    b = J.T @ (side * wrong) / softness
    return b, (J.T * (wrong * (1 - wrong))) @ J / softness**2


def _moved(X_WO: RigidTransform, step: Vector) -> RigidTransform:
    """Return a pose after a translation and a turn about the solid's centre, in W."""
    turn = cv2.Rodrigues(step[3:])[0] @ X_WO.rotation().matrix()
    R = RotationMatrix.ProjectToRotationMatrix(turn)
    return RigidTransform(R, X_WO.translation() + step[:3])


def _thin(values: Vector, most: int) -> Vector:
    """Return every n-th value, at most `most` values."""
    return values[:: max(1, -(-len(values) // most))]
