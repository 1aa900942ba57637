"""Motions along free paths that limit how the tip of the hand moves.

The tip moves like a lift: as fast as limits of its speed, acceleration and jerk along
the path allow. CoppeliaSim's `moveToPose` moves arms in this way; its distance between
poses includes turns.
"""

import itertools

import numpy as np
from pydrake.math import RigidTransform
from pydrake.trajectories import (
    PathParameterizedTrajectory,
    PiecewisePolynomial,
    Trajectory,
)

from drake_srg.planning.motion.config import TipLimits
from drake_srg.planning.motion.failure import PlanningFailure
from drake_srg.planning.motion.limits import MotionLimits
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.types import Failure, Vector

# Longest steps of a path, in distance [m] and of a joint [rad]. Those of
# `plan_cartesian_path` are shorter, so its waypoints are used as they are.
_STEP = 0.03
_JOINT_STEP = 0.3
_REFINEMENTS = 4  # how often steps are halved while the path is not free
# How far the spline may break a margin that its waypoints keep [m]; see `trajectories`.
_TIP_GRAZE = 1e-3
# Least distance of a turn of the joints [m/rad]. It makes motions that leave the hand
# where it is take time; the joints' limits determine how much.
_LEAST_DISTANCE = 1e-3
_SAMPLES = 1000  # times at which the joints' limits are checked,
_SAMPLING_SLACK = 1.01  # and by how much they may be exceeded in between
_STANDING = 0.01  # duration of a path without motion [s]


def tip_limited_trajectory(
    scene: PlanningScene,
    waypoints: Vector,
    limits: MotionLimits,
    tip: TipLimits,
    *,
    p_GT: Vector | None = None,
) -> Trajectory | PlanningFailure:
    """Move from rest to rest along `waypoints`, the tip within the limits of `tip`.

    The joints follow a cubic spline through the waypoints, and through points between
    those that are far apart. Distance along it follows a profile of seven phases of
    constant jerk (by Ruckig: Berscheid and Kröger, RSS 2021). The limits apply along
    the path; what a bend adds across it is not limited. Where a joint would exceed a
    limit of velocity or acceleration, the whole motion is slower. Torques are not
    checked.

    Args:
        scene: The scene in which straight joint lines between the waypoints are free.
        waypoints: Shape (K, N) [rad], as `plan_cartesian_path` and `plan_joint_path`
            return them.
        limits: Limits of the joints.
        tip: Limits of the tip's motion.
        p_GT: The tip in the hand's frame, shape (3,) [m]; None: the frame's origin.

    Returns:
        q(t), shape (N, 1) [rad], from t = 0, with the velocity EvalDerivative(t, 1); or
        why there is no motion.

    Raises:
        ValueError: If waypoints are not of shape (K, N).
    """
    if np.ndim(waypoints) != 2 or waypoints.shape[1] != scene.num_joints:
        raise ValueError(
            f"waypoints: must have shape (K, N), got {np.shape(waypoints)}"
        )
    # Drake's splines need knots that are 1e-10 apart.
    moves = np.max(np.abs(np.diff(waypoints, axis=0)), axis=1) > 1e-6
    waypoints = waypoints[np.append(moves, True)]
    if len(waypoints) == 1:
        breaks = [0.0, _STANDING]
        return PiecewisePolynomial.ZeroOrderHold(breaks, np.tile(waypoints.T, 2))
    p_GT = np.zeros(3) if p_GT is None else p_GT
    for refinement in range(_REFINEMENTS + 1):
        q, s = _refined(scene, waypoints, tip, p_GT, 0.5**refinement)
        path = _interpolation(s, q)
        # Half way between its points, the spline is farthest from the checked line.
        hit = scene.first_hit(path.vector_values((s[1:] + s[:-1]) / 2.0).T, _TIP_GRAZE)
        if hit is None:
            slower = _slowdown(path, _profile(s[-1], tip), limits)
            return PathParameterizedTrajectory(
                path, _profile(s[-1], tip.slowed(slower))
            )
    message = f"no smooth motion along the path is free: {hit}"
    return PlanningFailure(Failure.BLOCKED, message, hit)


def _refined(
    scene: PlanningScene, q: Vector, tip: TipLimits, p_GT: Vector, scale: float
) -> tuple[Vector, Vector]:
    """Return waypoints (K, N) in steps of at most `scale` of the longest allowed.

    The second value is their distance along the path, (K,) [m].
    """
    while True:
        X_WT = [scene.X_WG(x) @ RigidTransform(p_GT) for x in q]
        X_TT = [X_1.inverse() @ X_2 for X_1, X_2 in itertools.pairwise(X_WT)]
        steps = np.array([_distance(X, tip.angle_weight) for X in X_TT])
        turns = np.max(np.abs(np.diff(q, axis=0)), axis=1)
        long = (steps > scale * _STEP) | (turns > scale * _JOINT_STEP)
        if not np.any(long):
            steps = np.maximum(steps, _LEAST_DISTANCE * turns)
            return q, np.append(0.0, np.cumsum(steps))
        (where,) = np.nonzero(long)
        q = np.insert(q, where + 1, (q[where] + q[where + 1]) / 2.0, axis=0)


def _interpolation(s: Vector, q: Vector) -> PiecewisePolynomial:
    """Return the cubic spline through q (K, N) at s (K,), of two points the line."""
    if len(s) == 2:
        return PiecewisePolynomial.FirstOrderHold(s, q.T)
    return PiecewisePolynomial.CubicWithContinuousSecondDerivatives(s, q.T)


def _distance(X: RigidTransform, angle_weight: float) -> float:
    """Return the length of a motion in the metric of `TipLimits` [m]."""
    angle = X.rotation().ToAngleAxis().angle()
    return float(np.hypot(np.linalg.norm(X.translation()), angle_weight * angle))


def _profile(distance: float, tip: TipLimits) -> PiecewisePolynomial:
    """Return the fastest distance over time from rest to rest, shape (1, 1) [m]."""
    import ruckig

    move = ruckig.InputParameter(1)
    move.target_position = [distance]
    move.max_velocity = [tip.velocity]
    move.max_acceleration = [tip.acceleration]
    move.max_jerk = [tip.jerk]
    result = ruckig.Trajectory(1)
    ruckig.Ruckig(1).calculate(move, result)
    ((profile,),) = result.profiles
    phases = np.array(profile.t) > 1e-9
    ends = np.append(phases, True)  # where phases begin, and where the last one ends
    breaks = np.append(0.0, np.cumsum(np.array(profile.t)[phases]))
    position, speed = (np.array(x)[ends] for x in (profile.p, profile.v))
    # A cubic is determined by the values and slopes at its ends.
    return PiecewisePolynomial.CubicHermite(breaks, position[None], speed[None])


def _slowdown(
    path: PiecewisePolynomial, profile: PiecewisePolynomial, limits: MotionLimits
) -> float:
    """Return the factor of time with which the joints keep their limits, 1 or more."""
    t = np.linspace(0.0, profile.end_time(), _SAMPLES)
    s, rate, rate_dot = (profile.derivative(i).vector_values(t)[0] for i in range(3))
    slope, bend = (path.derivative(i).vector_values(s).T for i in (1, 2))
    v = slope * rate[:, None]
    a = bend * rate[:, None] ** 2 + slope * rate_dot[:, None]
    exceeded = max(
        np.max(np.abs(v) / limits.velocity),
        np.sqrt(np.max(np.abs(a) / limits.acceleration)),
    )
    return float(max(1.0, _SAMPLING_SLACK * exceeded))
