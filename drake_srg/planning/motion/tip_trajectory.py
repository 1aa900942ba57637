"""Times a path by how the tip of the hand moves along it: from rest to rest, smoothly.

The tip goes as a lift does: its speed, acceleration and jerk along the path are
limited, and as large as that allows. So move the arms of CoppeliaSim's `moveToPose`,
whose distance between poses counts turns, too.
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
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.planning.motion.trajectories import MotionLimits
from drake_srg.types import Failure, Vector

# Longest steps of a path, in distance [m] and of a joint [rad]: longer than those of
# `plan_cartesian_path`, whose waypoints are taken as they are.
_STEP = 0.03
_JOINT_STEP = 0.3
_REFINEMENTS = 4  # how often steps are halved where the path is not free
# The spline may touch a margin that its waypoints keep [m]; see `trajectories`.
_GRAZE = 1e-3
# Distance that a turn of the joints takes at least [m/rad], so that motions that leave
# the hand where it is take time, too; the joints' limits then say how much.
_LEAST_DISTANCE = 1e-3
_SAMPLES = 1000  # times at which the joints' limits are looked at,
_SAMPLING_SLACK = 1.01  # and what they may be exceeded by between these
_STANDING = 0.01  # duration of a path without motion [s]


def tip_limited_trajectory(
    scene: PlanningScene,
    waypoints: Vector,
    limits: MotionLimits,
    tip: TipLimits,
    *,
    p_GT: Vector | None = None,
) -> Trajectory | PlanningFailure:
    """Moves from rest to rest along `waypoints`, the tip as `tip` says.

    The joints follow a cubic spline through the waypoints, and through points between
    those that are far apart. Distance along it follows a profile of seven phases of
    constant jerk (by Ruckig: Berscheid and Kröger, RSS 2021). The limits are those of
    motion along the path; what a bend adds across it is not limited. Where a joint
    would exceed a limit of velocity or acceleration, the whole motion is slower.
    Torques are not looked at.

    Args:
        scene: What straight joint lines between the waypoints are free in.
        waypoints: Shape (K, N) [rad], as `plan_cartesian_path` and `plan_joint_path`
            return them.
        limits: Of the joints.
        tip: Limits of the tip's motion.
        p_GT: The tip in the hand's frame, shape (3,) [m]; None: its origin.

    Returns:
        q(t), shape (N, 1) [rad], from t = 0; its velocity is EvalDerivative(t, 1). Or
        why there is none.

    Raises:
        ValueError: If waypoints are not shape (K, N).
    """
    if np.ndim(waypoints) != 2 or waypoints.shape[1] != scene.num_joints:
        raise ValueError(f"waypoints need shape (K, N), not {np.shape(waypoints)}.")
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
        # Half way between its points the spline is farthest from what is known free.
        hit = scene.first_hit(path.vector_values((s[1:] + s[:-1]) / 2.0).T, _GRAZE)
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
    """Waypoints (K, N) in steps of at most `scale` of ours, and distances (K,) [m]."""
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
    """The cubic spline through q (K, N) at s (K,); through two, the line."""
    if len(s) == 2:
        return PiecewisePolynomial.FirstOrderHold(s, q.T)
    return PiecewisePolynomial.CubicWithContinuousSecondDerivatives(s, q.T)


def _distance(X: RigidTransform, angle_weight: float) -> float:
    """How far a motion goes in the metric of `TipLimits` [m]."""
    angle = X.rotation().ToAngleAxis().angle()
    return float(np.hypot(np.linalg.norm(X.translation()), angle_weight * angle))


def _profile(distance: float, tip: TipLimits) -> PiecewisePolynomial:
    """Distance over time from rest to rest, shape (1, 1) [m]: the fastest one."""
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
    ends = np.append(phases, True)  # where phases begin, and the last one's end
    breaks = np.append(0.0, np.cumsum(np.array(profile.t)[phases]))
    position, speed = (np.array(x)[ends] for x in (profile.p, profile.v))
    # A cubic is known by its ends' values and slopes.
    return PiecewisePolynomial.CubicHermite(breaks, position[None], speed[None])


def _slowdown(
    path: PiecewisePolynomial, profile: PiecewisePolynomial, limits: MotionLimits
) -> float:
    """Factor of time at which the joints keep their limits; 1 if they do anyway."""
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
