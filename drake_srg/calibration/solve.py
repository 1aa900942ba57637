"""Solves for a camera's intrinsics and pose by the reprojection of all corners."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares

from drake_srg.calibration.board import MIN_CORNERS
from drake_srg.calibration.projection import (
    NUM_PARAMETERS,
    Unknowns,
    View,
    jacobian,
    residuals,
)
from drake_srg.calibration.start import first_estimate
from drake_srg.common.exceptions import ScenarioError
from drake_srg.types import Vector

# Fewer views than this leave nothing to judge the estimate by.
MIN_VIEWS = 5
# Corners are found with an error of 0.05 to 0.3 pixels. A fit that is better than this
# is so by chance, and one that is worse has wrong poses or another board [pixels].
_LEAST_NOISE, _MOST_ERROR = 0.05, 2.0
# Largest standard deviations of the camera's position [m] and rotation [rad] that
# count as an estimate. Good views give 0.1 mm and 0.01 degrees.
MOST_POSITION_STD, MOST_ROTATION_STD = 1e-3, np.radians(0.2)
# Distances between corner and expectation, over the noise of either coordinate: their
# median, and up to where they count fully [Huber, Robust Estimation of a Location
# Parameter, 1964]. Of normally distributed errors, 6 % are farther.
_MEDIAN, _HUBER = 1.177, 2.35
# Rounds in which the noise of each view is renewed.
_ROUNDS = 4


@dc.dataclass(frozen=True)
class Calibration:
    """A camera's estimated intrinsics and pose.

    Attributes:
        estimate: The intrinsics and both poses.
        covariance: Of the 16 parameters, in the units of `projection.jacobian`.
        condition: Condition number of the estimate, parameters scaled to equal effect.
        rms: Root mean square of the distances between corners and expectation [pixels].
        views: The views used.
        dropped: Names of other views, and why each was dropped.
    """

    estimate: Unknowns
    covariance: Vector
    condition: float
    rms: float
    views: tuple[View, ...]
    dropped: dict[str, str]

    @property
    def focal_std(self) -> Vector:
        """Standard deviations of the focal lengths [pixels], shape (2,)."""
        return np.sqrt(np.diag(self.covariance)[0:2])

    @property
    def center_std(self) -> Vector:
        """Standard deviations of the principal point [pixels], shape (2,)."""
        return np.sqrt(np.diag(self.covariance)[2:4])

    @property
    def rotation_std(self) -> float:
        """Standard deviation of the camera's rotation, all axes together [rad]."""
        return float(np.sqrt(np.trace(self.covariance[4:7, 4:7])))

    @property
    def position_std(self) -> float:
        """Standard deviation of the camera's position, all axes together [m]."""
        return float(np.sqrt(np.trace(self.covariance[7:10, 7:10])))


def calibrate(views: Sequence[View], focal: Vector, center: Vector) -> Calibration:
    """Estimate intrinsics, the camera's pose and the board's pose.

    Args:
        views: Corners and hand poses. A view is dropped if it has too few corners, or
            all of them on one line.
        focal: Approximate focal lengths [pixels], shape (2,).
        center: Approximate principal point [pixels], shape (2,).

    Raises:
        ScenarioError: If too few views are left, if they are too alike to tell the
            parameters apart, or if no parameters fit them.
    """
    few = {view.name: reason for view in views if (reason := _too_few(view))}
    used = tuple(view for view in views if view.name not in few)
    if len(used) < MIN_VIEWS:
        seen = sum(1 for view in views if len(view.pixels) > 0)
        raise ScenarioError(
            f"{len(used)} usable views, needs at least {MIN_VIEWS} (got {len(views)} "
            f"images, {seen} show the board, usable from {MIN_CORNERS} corners)"
        )
    estimate, noise = _fit(used, first_estimate(used, focal, center))
    error = np.concatenate([residuals(estimate, view) for view in used])
    rms = float(np.sqrt(np.mean(np.sum(error**2, axis=1))))
    if rms > _MOST_ERROR:
        raise ScenarioError(
            f"no camera fits these views: {rms:.1f} pixels are left (allowed: "
            f"{_MOST_ERROR:g}); check the board's size and the poses of the hand"
        )
    covariance, condition = _covariance(used, estimate, noise)
    result = Calibration(estimate, covariance, condition, rms, used, few)
    if (
        not np.all(np.isfinite(covariance))
        or result.position_std > MOST_POSITION_STD
        or result.rotation_std > MOST_ROTATION_STD
    ):
        raise ScenarioError(
            f"the {len(used)} views are too alike: condition number {condition:.1e}, "
            f"standard deviations {1e3 * result.position_std:.1f} mm and "
            f"{np.degrees(result.rotation_std):.2f} degrees (allowed: "
            f"{1e3 * MOST_POSITION_STD:g} mm and {np.degrees(MOST_ROTATION_STD):g} "
            "degrees); turn the hand about two axes at least"
        )
    return result


def _too_few(view: View) -> str:
    """Return why a view's corners do not tell the board's pose; empty if they do."""
    count = len(view.pixels)
    if count < MIN_CORNERS:
        return f"{count} corners"
    if np.linalg.matrix_rank(view.p_B - view.p_B[0], tol=1e-6) < 2:
        return f"{count} corners on one line"
    return ""


def _fit(views: Sequence[View], estimate: Unknowns) -> tuple[Unknowns, Vector]:
    """Return the estimate that minimises Huber's loss, and the noise of each view."""
    for _ in range(_ROUNDS):
        noise = _noise(views, estimate)
        estimate = _minimize(views, estimate, noise)
    return estimate, _noise(views, estimate)


def _noise(views: Sequence[View], estimate: Unknowns) -> Vector:
    """Return the standard deviations of the corners in each view [pixels].

    Corners of tilted and far boards are found worse, some by a tenth of the accuracy.
    """
    medians = [
        np.median(np.linalg.norm(residuals(estimate, view), axis=1)) for view in views
    ]
    return np.maximum(np.array(medians) / _MEDIAN, _LEAST_NOISE)


def _minimize(views: Sequence[View], estimate: Unknowns, noise: Vector) -> Unknowns:
    """Return the estimate that minimises Huber's loss of the corners' distances.

    It is the sum of squares of the errors e times s, with s = 1 up to Huber's limit h
    and s² |e|² = 2 h |e| - h² beyond.
    """

    def shrunk(step: Vector) -> Vector:
        error = _errors(views, estimate.moved(step), noise)
        return (error * _shrinking(error)[0][:, None]).ravel()

    def derivatives(step: Vector) -> Vector:
        # `jacobian` is for small motions of the poses as moved. The last round starts
        # where the one before ended: there, they are those by `step`.
        moved = estimate.moved(step)
        error, J = _errors(views, moved, noise), _jacobians(views, moved, noise)
        s, slope = _shrinking(error)
        radial = np.einsum("ki,kip->kp", error, J)
        J = s[:, None, None] * J + np.einsum("ki,k,kp->kip", error, slope, radial)
        return J.reshape(-1, NUM_PARAMETERS)

    start = np.zeros(NUM_PARAMETERS)
    found = least_squares(shrunk, start, derivatives, method="lm", x_scale="jac")
    return estimate.moved(found.x)


def _shrinking(error: Vector) -> tuple[Vector, Vector]:
    """Return s and its derivative by |e| over |e|, see `_minimize`, shape (K,)."""
    size = np.maximum(np.linalg.norm(error, axis=1), _HUBER)
    square = _HUBER * (2.0 * size - _HUBER)
    s = np.sqrt(square) / size
    slope = (_HUBER / square - 1.0 / size) * s / size
    return s, np.where(size > _HUBER, slope, 0.0)


def _errors(views: Sequence[View], estimate: Unknowns, noise: Vector) -> Vector:
    """Return the residuals of all corners over their noise, shape (K, 2)."""
    pairs = zip(views, noise, strict=True)
    return np.concatenate([residuals(estimate, view) / std for view, std in pairs])


def _jacobians(views: Sequence[View], estimate: Unknowns, noise: Vector) -> Vector:
    """Return the derivatives of `_errors`, shape (K, 2, 16)."""
    pairs = zip(views, noise, strict=True)
    return np.concatenate([jacobian(estimate, view) / std for view, std in pairs])


def _covariance(
    views: Sequence[View], estimate: Unknowns, noise: Vector
) -> tuple[Vector, float]:
    """Return the covariance (16, 16) of the parameters, and its condition number."""
    J = _jacobians(views, estimate, noise).reshape(-1, NUM_PARAMETERS)
    # The variance of Huber's estimate: limited residuals, and the share within limits.
    size = np.linalg.norm(_errors(views, estimate, noise), axis=1)
    limited = float(np.sum(np.minimum(size, _HUBER) ** 2))
    limited /= float(np.mean(size <= _HUBER)) ** 2 * max(len(J) - NUM_PARAMETERS, 1)
    effect = np.linalg.norm(J, axis=0)
    singular = np.linalg.svd(J / effect, compute_uv=False)
    condition = float(singular[0] / max(singular[-1], 1e-300))
    if condition > 1e12:
        return np.full((NUM_PARAMETERS, NUM_PARAMETERS), np.inf), condition
    inverse = np.linalg.inv((J / effect).T @ (J / effect))
    return max(limited, 1.0) * inverse / np.outer(effect, effect), condition
