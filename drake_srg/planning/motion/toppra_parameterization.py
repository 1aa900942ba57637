"""The fastest motions along paths, by TOPP-RA (Pham and Pham, 2018)."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydrake.trajectories import BsplineTrajectory, PiecewisePolynomial
from toppra.algorithm import TOPPRA
from toppra.constraint import LinearConstraint
from toppra.constraint.linear_constraint import canlinear_colloc_to_interpolate
from toppra.interpolator import AbstractGeometricPath

from drake_srg.planning.motion.arm_model import ArmModel
from drake_srg.planning.motion.limits import InverseDynamics, MotionLimits
from drake_srg.types import Vector

_UNLIMITED = 1e6  # replaces infinity, which the solver refuses


def toppra_parameterization(
    arm: ArmModel, path: BsplineTrajectory, limits: MotionLimits, grid: Vector
) -> PiecewisePolynomial | None:
    """Return the fastest progress s(t) along a path, from rest to rest.

    Args:
        arm: The arm, with its payload.
        path: q(s), shape (N, 1) [rad], with nonzero derivative.
        limits: Limits of the motion at the points of the grid. Between them, the motion
            may exceed them a little.
        grid: Increasing values of s, shape (K,), from the path's start to its end.

    Returns:
        s(t) from t = 0, or None if the torque limits cannot hold the arm along the
        path.
    """
    solver = TOPPRA(
        [_Limits(arm, limits)],
        _Path(path),
        gridpoints=grid,
        solver_wrapper="seidel",
    )
    _, speed, _ = solver.compute_parameterization(0.0, 0.0)
    if speed is None:
        return None
    mean_speed = (speed[:-1] + speed[1:]) / 2.0
    if not np.all(mean_speed > 0.0):
        return None
    # Between grid points the path's acceleration is constant.
    times = np.append(0.0, np.cumsum(np.diff(grid) / mean_speed))
    return PiecewisePolynomial.CubicHermite(times, grid[None], speed[None])


class _Limits(LinearConstraint):
    """All limits of a motion, as bounds along its path.

    With the path's speed squared x and its acceleration u, a joint's acceleration is
    q' u + q'' x, and its torque M q' u + (M q'' + C(q, q') q') x + g (Pham and Pham,
    2018). Unlike toppra's own constraints, this one computes the holding torques only
    once per grid point, and does not format a description of itself.
    """

    def __init__(self, arm: ArmModel, limits: MotionLimits) -> None:
        super().__init__()
        self._dynamics = InverseDynamics(arm)
        self._velocity = limits.velocity
        self._bound = np.concatenate([limits.acceleration, limits.torque])
        self._bound = np.minimum(self._bound, _UNLIMITED)
        self.dof = arm.num_joints
        self.identical = True  # bounds and their signs are the same along the path

    def compute_constraint_params(self, path: _Path, gridpoints: Vector) -> Any:
        """Return the bounds at the grid points, as toppra's `LinearConstraint` does."""
        q, dq, ddq = (path(gridpoints, order) for order in range(3))
        torque_u, torque_x, hold = np.empty((3, *q.shape))
        for i in range(len(q)):
            self._dynamics.SetPosition(q[i])
            torque_u[i] = self._dynamics.moving(np.zeros(self.dof), dq[i])
            torque_x[i] = self._dynamics.moving(dq[i], ddq[i])
            hold[i] = self._dynamics.holding()
        sides = np.vstack([np.eye(2 * self.dof), -np.eye(2 * self.dof)])
        bounds = canlinear_colloc_to_interpolate(
            np.hstack([dq, torque_u]),
            np.hstack([ddq, torque_x]),
            np.hstack([np.zeros_like(q), hold]),
            sides,
            np.tile(self._bound, 2),
            None,
            None,
            gridpoints,
            identical=True,
        )
        with np.errstate(divide="ignore", over="ignore"):
            fastest = np.min(self._velocity / np.abs(dq), axis=1)
        fastest = np.minimum(fastest, _UNLIMITED) ** 2
        return *bounds[:-1], np.stack([np.zeros_like(fastest), fastest], axis=1)


class _Path(AbstractGeometricPath):
    """A spline with toppra's interface."""

    def __init__(self, path: BsplineTrajectory) -> None:
        self._derivatives = [path, path.MakeDerivative(1), path.MakeDerivative(2)]

    @property
    def dof(self) -> int:
        return int(self._derivatives[0].rows())

    @property
    def path_interval(self) -> Vector:
        path = self._derivatives[0]
        return np.array([path.start_time(), path.end_time()])

    def __call__(self, path_positions: Vector, order: int = 0) -> Vector:
        values: Vector = self._derivatives[order].vector_values(path_positions)
        return values.T
