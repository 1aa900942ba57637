"""The interaction matrix of image points, and its damped inverse.

Notation and equation numbers are those of F. Chaumette and S. Hutchinson, Visual servo
control, Part I: Basic approaches, IEEE Robotics & Automation Magazine 13(4), 2006. The
camera's frame has z into the scene, x to the right and y down the image; a twist is
[v; w], the velocity of the camera's origin and its angular velocity, both in that frame
[m/s], [rad/s].
"""

from __future__ import annotations

import dataclasses as dc

import numpy as np

from drake_srg.types import Vector


def interaction_matrix(points: Vector, depths: Vector) -> Vector:
    """Return the matrix L with ds/dt = L [v; w] of points at rest (equation 11).

    Args:
        points: Image coordinates x, y at focal length 1, shape (n, 2).
        depths: z of the points in the camera's frame [m], shape (n,).

    Returns:
        Shape (2 n, 6); the rows are x and y of each point.
    """
    x, y = np.asarray(points, dtype=float).T
    nearness = 1.0 / np.asarray(depths, dtype=float)
    zero = np.zeros_like(x)
    rows_x = [-nearness, zero, x * nearness, x * y, -(1.0 + x * x), y]
    rows_y = [zero, -nearness, y * nearness, 1.0 + y * y, -x * y, -x]
    matrix = np.stack([np.stack(rows_x, axis=-1), np.stack(rows_y, axis=-1)], axis=1)
    return matrix.reshape(-1, 6)


@dc.dataclass(frozen=True)
class Solution:
    """A damped least-squares solution."""

    x: Vector  # shape (m,)
    # Least singular value of the matrix; 0 if it has fewer rows than columns.
    least: float


def damped_solution(matrix: Vector, b: Vector, least: float) -> Solution:
    """Return x with matrix x = b, damped where the matrix is nearly singular.

    Every singular value s counts as s / (s² + d²), where d² grows from 0 to `least`²
    as s falls below `least` (Nakamura and Hanafusa, J. Dyn. Sys. Meas. Control 108,
    1986). So x is never longer than b over `least`, whatever the matrix, and is exact
    where all singular values are above `least`.

    Args:
        matrix: Shape (n, m).
        b: Shape (n,).
        least: Singular value below which a direction is damped.
    """
    u, s, vt = np.linalg.svd(matrix, full_matrices=False)
    damping = np.where(s < least, 1.0 - (s / least) ** 2, 0.0) * least**2
    inverse = s / np.maximum(s * s + damping, 1e-300)
    determined = len(s) == matrix.shape[1]
    return Solution(vt.T @ (inverse * (u.T @ b)), float(s[-1]) if determined else 0.0)


def image_displacement(
    points: Vector,
    depths: Vector,
    goal_points: Vector,
    goal_depths: Vector,
    *,
    turns: bool,
    least: float,
) -> Solution:
    """Return the displacement of the camera that takes points to their goals.

    It is -L^+ (s - s*) with L the mean of the interaction matrices here and at the
    goal, which couples large motions in depth and across least (section "Choosing L").

    Args:
        points: Image coordinates at focal length 1, shape (n, 2).
        depths: Of the points [m], shape (n,).
        goal_points: Where they must be, shape (n, 2).
        goal_depths: Their depths there [m], shape (n,).
        turns: Whether the camera may turn, or only move.
        least: See `damped_solution`.

    Returns:
        A translation [m] and a rotation vector [rad], shape (6,), and the least
        singular value of the interaction matrix here.
    """
    here = interaction_matrix(points, depths)
    there = interaction_matrix(goal_points, goal_depths)
    freedoms = 6 if turns else 3
    error = (np.asarray(points) - goal_points).reshape(-1)
    found = damped_solution(0.5 * (here + there)[:, :freedoms], -error, least)
    displacement = np.zeros(6)
    displacement[:freedoms] = found.x
    # The mean may have directions that the points here do not determine.
    singular_values = np.linalg.svd(here[:, :freedoms], compute_uv=False)
    determined = len(singular_values) == freedoms
    return Solution(displacement, float(singular_values[-1]) if determined else 0.0)
