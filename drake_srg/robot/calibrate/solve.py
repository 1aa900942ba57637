"""Solves for a camera's intrinsics and pose by minimizing reprojection errors.

Frames: C is the camera's imager and B the board. P is the camera's mount and Q the
board's. A camera in the hand has P on the hand and Q = world; a fixed camera has
P = world and Q on the hand. X_PQ is known in every view.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence

import cv2
import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from scipy.optimize import least_squares

from drake_srg.common.exceptions import ScenarioError
from drake_srg.robot.calibrate.mounting import MIN_CORNERS
from drake_srg.types import Vector

NUM_PARAMETERS = 16  # focal, center, X_PC and X_QB


@dc.dataclass(frozen=True)
class View:
    """The corners of the board that an image shows, and its known pose.

    Attributes:
        X_PQ: Pose of the board's mount in the camera's mount [m].
        p_B: Corners on the board [m], shape (K, 3).
        pixels: The same corners in the image, shape (K, 2).
    """

    name: str
    X_PQ: RigidTransform
    p_B: Vector
    pixels: Vector


@dc.dataclass(frozen=True)
class Unknowns:
    """Unknowns of a calibration.

    Attributes:
        focal: Focal lengths [pixels], shape (2,).
        center: Principal point [pixels], shape (2,); pixel centers are whole numbers.
        X_PC: Pose of the camera's imager in its mount [m].
        X_QB: Pose of the board in its mount [m].
    """

    focal: Vector
    center: Vector
    X_PC: RigidTransform
    X_QB: RigidTransform

    def moved(self, step: Vector) -> Unknowns:
        """Return these unknowns after a step of shape (16,), see `jacobian`."""
        return Unknowns(
            self.focal + step[0:2],
            self.center + step[2:4],
            self.X_PC @ _small_pose(step[4:10]),
            self.X_QB @ _small_pose(step[10:16]),
        )


def project(unknowns: Unknowns, view: View) -> Vector:
    """Return the pixels (K, 2) at which the view's corners are expected."""
    p_C = _p_C(unknowns, view)
    z = np.maximum(p_C[:, 2:], 1e-3)  # a corner behind the camera gets a large error
    return np.asarray(p_C[:, :2] / z * unknowns.focal + unknowns.center)


def residuals(unknowns: Unknowns, view: View) -> Vector:
    """Return expected minus observed pixels (K, 2)."""
    return project(unknowns, view) - view.pixels


def jacobian(unknowns: Unknowns, view: View) -> Vector:
    """Return the derivatives of `project`, shape (K, 2, 16).

    The parameters are focal (2) and center (2) [pixels], then a small motion of C,
    expressed in C (6), and one of B, expressed in B (6). A motion is a rotation vector
    (3) [rad] and a translation (3) [m].
    """
    p_C = _p_C(unknowns, view)
    z = np.maximum(p_C[:, 2], 1e-3)
    xy = p_C[:, :2] / z[:, None]
    # Derivative of the pixel by the point in C.
    by_point = np.zeros((len(p_C), 2, 3))
    for axis in range(2):
        by_point[:, axis, axis] = unknowns.focal[axis] / z
        by_point[:, axis, 2] = -unknowns.focal[axis] * xy[:, axis] / z
    R_CB = (unknowns.X_PC.inverse() @ view.X_PQ @ unknowns.X_QB).rotation().matrix()
    result = np.zeros((len(p_C), 2, NUM_PARAMETERS))
    for axis in range(2):
        result[:, axis, axis] = xy[:, axis]
        result[:, axis, 2 + axis] = 1.0
    result[:, :, 4:7] = by_point @ _cross(p_C)
    result[:, :, 7:10] = -by_point
    result[:, :, 10:13] = -by_point @ (R_CB @ _cross(view.p_B))
    result[:, :, 13:16] = by_point @ R_CB
    return result


def _p_C(unknowns: Unknowns, view: View) -> Vector:
    X_CB = unknowns.X_PC.inverse() @ view.X_PQ @ unknowns.X_QB
    return np.asarray(X_CB.multiply(view.p_B.T).T)


def _cross(p: Vector) -> Vector:
    """Return the matrices (K, 3, 3) of the cross products with points (K, 3)."""
    x, y, z = p.T
    o = np.zeros_like(x)
    return np.array([[o, -z, y], [z, o, -x], [-y, x, o]]).transpose(2, 0, 1)


def _small_pose(step: Vector) -> RigidTransform:
    """Return the pose of a rotation vector and a translation, shape (6,)."""
    turn = cv2.Rodrigues(step[:3])[0]
    return RigidTransform(RotationMatrix.ProjectToRotationMatrix(turn), step[3:])


def first_estimate(views: Sequence[View], focal: Vector, center: Vector) -> Unknowns:
    """Return initial unknowns from which a least-squares fit converges.

    In each view X_PC X_CB = X_PQ X_QB. The rotations are the null vector of these
    equations, written out for the 18 entries of R_PC and R_QB. The translations follow
    by linear least squares.

    Args:
        views: At least three views, with the hand turned about at least two axes.
        focal: Approximate focal lengths [pixels], shape (2,).
        center: Approximate principal point [pixels], shape (2,).
    """
    seen = [_board_pose(view, focal, center) for view in views]
    known = [view.X_PQ for view in views]
    turns, one = [], np.eye(3)
    for X_CB, X_PQ in zip(seen, known, strict=True):
        left = np.kron(X_CB.rotation().matrix().T, one)
        right = np.kron(one, X_PQ.rotation().matrix())
        turns.append(np.hstack([left, -right]))
    null = np.linalg.svd(np.vstack(turns))[2][-1]
    R_PC, R_QB = null[:9].reshape(3, 3).T, null[9:].reshape(3, 3).T
    sign = np.sign(np.linalg.det(R_PC)) or 1.0
    R_PC, R_QB = _nearest_rotation(sign * R_PC), _nearest_rotation(sign * R_QB)
    rows, values = [], []
    for X_CB, X_PQ in zip(seen, known, strict=True):
        rows.append(np.hstack([one, -X_PQ.rotation().matrix()]))
        values.append(X_PQ.translation() - R_PC @ X_CB.translation())
    p = np.linalg.lstsq(np.vstack(rows), np.concatenate(values), rcond=None)[0]
    return Unknowns(
        np.array(focal, float),
        np.array(center, float),
        RigidTransform(R_PC, p[:3]),
        RigidTransform(R_QB, p[3:]),
    )


def _board_pose(view: View, focal: Vector, center: Vector) -> RigidTransform:
    """Return X_CB of one view."""
    matrix = np.array([[focal[0], 0, center[0]], [0, focal[1], center[1]], [0, 0, 1.0]])
    _, turn, p = cv2.solvePnP(
        view.p_B, view.pixels, matrix, None, flags=cv2.SOLVEPNP_IPPE
    )
    R = RotationMatrix.ProjectToRotationMatrix(cv2.Rodrigues(turn)[0])
    return RigidTransform(R, p.ravel())


def _nearest_rotation(matrix: Vector) -> RotationMatrix:
    """Return the rotation nearest to a matrix, scaled by any factor."""
    u, _, v = np.linalg.svd(matrix)
    u[:, 2] *= np.linalg.det(u @ v)
    return RotationMatrix.ProjectToRotationMatrix(u @ v)


# With fewer views, the residuals do not show how good the estimate is.
MIN_VIEWS = 5
# Corners are found with an error of 0.05 to 0.3 pixels. A fit better than the first
# value is due to chance; one worse than the second has wrong poses or another board
# [pixels].
_LEAST_NOISE, _MOST_ERROR = 0.05, 2.0
# Largest standard deviations of the camera's position [m] and rotation [rad] that
# count as an estimate. Good views give 0.1 mm and 0.01 degrees.
MOST_POSITION_STD, MOST_ROTATION_STD = 1e-3, np.radians(0.2)
# Distances between observed and expected corners, in standard deviations of one
# coordinate: the median, and Huber's limit, beyond which they no longer count fully
# [Huber, Robust Estimation of a Location Parameter, 1964]. Of normally distributed
# errors, 6 % exceed the limit.
_MEDIAN, _HUBER = 1.177, 2.35
# Number of rounds, each of which estimates the noise of each view anew, and most steps
# of a round. Eight views need 32 steps if the initial intrinsics are off by a tenth.
# With more steps, views that determine no camera would only be refused later.
_ROUNDS, _MOST_STEPS = 4, 100


@dc.dataclass(frozen=True)
class Calibration:
    """A camera's estimated intrinsics and pose.

    Attributes:
        estimate: The intrinsics and both poses.
        covariance: Covariance of the parameters of `jacobian`, shape (16, 16).
        condition: Condition number, with parameters scaled to equal effect.
        rms: Root mean square distance of observed from expected corners [pixels].
        views: The views that the fit uses.
        dropped: Why each of the other views was dropped, by the views' names.
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
        """Standard deviation of the camera's rotation, combined over all axes [rad]."""
        return float(np.sqrt(np.trace(self.covariance[4:7, 4:7])))

    @property
    def position_std(self) -> float:
        """Standard deviation of the camera's position, combined over all axes [m]."""
        return float(np.sqrt(np.trace(self.covariance[7:10, 7:10])))


def calibrate(views: Sequence[View], focal: Vector, center: Vector) -> Calibration:
    """Estimate intrinsics, the camera's pose and the board's pose.

    Args:
        views: Corners and poses of the mounts. A view is dropped if it has too few
            corners, or all of them on one line.
        focal: Approximate focal lengths [pixels], shape (2,).
        center: Approximate principal point [pixels], shape (2,).

    Raises:
        ScenarioError: If too few views are left, if they are too similar to determine
            the parameters, if no parameters fit, or if the fit does not converge.
    """
    few = {view.name: reason for view in views if (reason := _too_few(view))}
    used = tuple(view for view in views if view.name not in few)
    if len(used) < MIN_VIEWS:
        seen = sum(1 for view in views if len(view.pixels) > 0)
        raise ScenarioError(
            f"{len(used)} usable views, needs at least {MIN_VIEWS} (got {len(views)} "
            f"images, {seen} show the board, usable from {MIN_CORNERS} corners)"
        )
    estimate, noise, ended = _fit(used, first_estimate(used, focal, center))
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
    if not ended:
        raise ScenarioError(
            f"the fit to {len(used)} views does not end within {_ROUNDS * _MOST_STEPS} "
            "steps; start from better focal lengths, or add views"
        )
    return result


def _too_few(view: View) -> str:
    """Return why a view's corners do not determine the board's pose, or ""."""
    count = len(view.pixels)
    if count < MIN_CORNERS:
        return f"{count} corners"
    if np.linalg.matrix_rank(view.p_B - view.p_B[0], tol=1e-6) < 2:
        return f"{count} corners on one line"
    return ""


def _fit(views: Sequence[View], estimate: Unknowns) -> tuple[Unknowns, Vector, bool]:
    """Return the estimate that minimizes Huber's loss, and the noise of each view.

    The last value says whether the fit has found the minimum.
    """
    ended = False
    for _ in range(_ROUNDS):
        noise = _noise(views, estimate)
        estimate, ended = _minimize(views, estimate, noise)
    return estimate, _noise(views, estimate), ended


def _noise(views: Sequence[View], estimate: Unknowns) -> Vector:
    """Return the standard deviations of the corners in each view [pixels].

    Corners of tilted or distant boards are found less accurately, up to ten times less.
    """
    medians = [
        np.median(np.linalg.norm(residuals(estimate, view), axis=1)) for view in views
    ]
    return np.maximum(np.array(medians) / _MEDIAN, _LEAST_NOISE)


def _minimize(
    views: Sequence[View], estimate: Unknowns, noise: Vector
) -> tuple[Unknowns, bool]:
    """Minimize Huber's loss; return the estimate, and whether this is the minimum.

    The loss is the sum of |s e|² over the corners' errors e. Up to Huber's limit h, s
    is 1. Beyond, it follows from s² |e|² = 2 h |e| - h².
    """

    def shrunk(step: Vector) -> Vector:
        error = _errors(views, estimate.moved(step), noise)
        return (error * _shrinking(error)[0][:, None]).ravel()

    def derivatives(step: Vector) -> Vector:
        # `jacobian` differentiates by small motions of the moved poses, which agrees
        # with derivatives by `step` near 0. The last round starts where the round
        # before ended, so its steps stay near 0.
        moved = estimate.moved(step)
        error, J = _errors(views, moved, noise), _jacobians(views, moved, noise)
        s, slope = _shrinking(error)
        radial = np.einsum("ki,kip->kp", error, J)
        J = s[:, None, None] * J + np.einsum("ki,k,kp->kip", error, slope, radial)
        return J.reshape(-1, NUM_PARAMETERS)

    start = np.zeros(NUM_PARAMETERS)
    found = least_squares(
        *(shrunk, start, derivatives),
        method="lm",
        x_scale="jac",
        max_nfev=_MOST_STEPS,
    )
    return estimate.moved(found.x), bool(found.success)


def _shrinking(error: Vector) -> tuple[Vector, Vector]:
    """Return s of `_minimize`, and its derivative by |e| divided by |e|, both (K,)."""
    size = np.maximum(np.linalg.norm(error, axis=1), _HUBER)
    square = _HUBER * (2.0 * size - _HUBER)
    s = np.sqrt(square) / size
    slope = (_HUBER / square - 1.0 / size) * s / size
    return s, np.where(size > _HUBER, slope, 0.0)


def _errors(views: Sequence[View], estimate: Unknowns, noise: Vector) -> Vector:
    """Return the residuals of all corners, divided by their noise, shape (K, 2)."""
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
    # The variance of Huber's estimate depends on the residuals, cut off at the limit,
    # and on the share of residuals within the limit.
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
