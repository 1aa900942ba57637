"""Smooth motions along collision-free paths, as fast as the arm's limits allow.

With limits on the tip, the tip moves as fast as its limits of speed, acceleration and
jerk along the path allow, as with CoppeliaSim's `moveToPose`. Distance along the path
includes turns.

One approximation serves twice: a cubic spline whose control points lie on the
approximated curve, at averages of the knots (Schoenberg, 1967). Such a spline
reproduces straight lines and stays within the convex hull of four neighbouring points.
Its first and second derivatives are weighted averages of the curve's. Along a path, it
rounds corners by a bounded amount. In time, it turns the steps of a time-optimal
acceleration into ramps without exceeding a limit.
"""

from __future__ import annotations

import dataclasses as dc
import itertools
from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt
from pydrake.math import BsplineBasis, RigidTransform
from pydrake.trajectories import (
    BsplineTrajectory,
    PathParameterizedTrajectory,
    PiecewisePolynomial,
    Trajectory,
)

from drake_srg.planning.motion.limits import InverseDynamics, MotionLimits, TipLimits
from drake_srg.planning.motion.planning_scene import PlanningFailure, PlanningScene
from drake_srg.planning.motion.time_parameterization import load_toppra
from drake_srg.types import Failure, Vector

# Largest distance of a motion from its path at corners, and on lines that it must keep
# [rad].
ROUNDING, STRAIGHT = 0.2, 1e-3


@dc.dataclass(frozen=True, eq=False)
class PathPart:
    """A part of a path.

    Attributes:
        path: Waypoints, shape (K, N) [rad].
        rounding: Largest distance of a motion from the path, everywhere or at each
            waypoint, shape (K,) [rad].
    """

    path: Vector
    rounding: float | Vector = ROUNDING


def joined(parts: Sequence[PathPart]) -> PathPart:
    """Return the parts of a path, each of which begins where the one before ends.

    A motion may cut the corner between two parts, within the nearer half of each.
    """
    roundings: list[Vector] = []
    for i, part in enumerate(parts):
        lengths = np.linalg.norm(np.diff(part.path, axis=0), axis=1)
        share = np.append(0.0, np.cumsum(lengths)) / max(np.sum(lengths), 1e-9)
        rounded = ((share < 0.5) & (i > 0)) | ((share > 0.5) & (i < len(parts) - 1))
        roundings.append(np.where(rounded, ROUNDING, part.rounding))
    first, *others = parts
    return PathPart(
        np.vstack([first.path, *(part.path[1:] for part in others)]),
        np.concatenate([roundings[0], *(other[1:] for other in roundings[1:])]),
    )


def cut(
    trajectory: Trajectory, points: Iterable[Vector], period: float
) -> tuple[Trajectory, ...]:
    """Return the parts of a motion that is cut at points, in order.

    Args:
        trajectory: q(t), shape (N, 1) [rad], from t = 0.
        points: Points to which the cuts are nearest, shape (N,) [rad] each.
        period: Each part but the last lasts a multiple of this time [s].
    """
    end = trajectory.end_time()
    times = np.arange(0.0, end, period)
    q = trajectory.vector_values(times).T
    at = [0]
    for point in points:
        distances = np.linalg.norm(q[at[-1] + 1 :] - point, axis=1)
        at.append(at[-1] + 1 + int(np.argmin(distances)))
    breaks = [*(period * i for i in at), end]
    return tuple(
        PathParameterizedTrajectory(
            trajectory,
            PiecewisePolynomial.FirstOrderHold([0.0, b - a], np.array([[a, b]])),
        )
        for a, b in itertools.pairwise(breaks)
    )


# Longest steps of a path, in distance [m] and of a joint [rad]. `plan_cartesian_path`
# makes shorter steps, so its waypoints are used unchanged.
_STEP = 0.03
_JOINT_STEP = 0.3
_REFINEMENTS = 4  # most halvings of the steps while the path is not free
# Largest violation by the spline of a margin that its waypoints keep [m].
_TIP_GRAZE = 1e-3
# Least distance of a turn of the joints [m/rad]. It gives time to motions that do not
# move the hand; the joints' limits determine how much.
_LEAST_DISTANCE = 1e-3
_SAMPLES = 1000  # times at which a motion is sampled
# Factor by which speeds may exceed their limits between samples.
_SAMPLING_SLACK = 1.01
_STANDING = 0.01  # duration of a path without motion [s]


def tip_limited_trajectory(
    scene: PlanningScene,
    waypoints: Vector,
    limits: MotionLimits,
    tip: TipLimits,
    *,
    p_GT: Vector | None = None,
) -> Trajectory | PlanningFailure:
    """Plan a motion from rest to rest along `waypoints`, within the tip's limits.

    The joints follow a cubic spline through the waypoints, and through points between
    those that are far apart. Distance along it follows a profile of seven phases of
    constant jerk (by Ruckig: Berscheid and Kröger, RSS 2021). The limits apply along
    the path; the acceleration across a bend is not limited. If a joint would exceed a
    limit of velocity or acceleration, the whole motion slows down. Torques are not
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
    _check_shape(scene, waypoints)
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
        # Halfway between its points, the spline is farthest from the checked line.
        hit = scene.first_hit(path.vector_values((s[1:] + s[:-1]) / 2.0).T, _TIP_GRAZE)
        if hit is None:
            slower = _slowdown(path, _profile(s[-1], tip), limits)
            return PathParameterizedTrajectory(
                path, _profile(s[-1], tip.slowed(slower))
            )
    message = f"no smooth motion along the path is free: {hit}"
    return PlanningFailure(Failure.BLOCKED, message)


def _check_shape(scene: PlanningScene, waypoints: Vector) -> None:
    if np.ndim(waypoints) != 2 or waypoints.shape[1] != scene.num_joints:
        raise ValueError(
            f"waypoints: must have shape (K, N), got {np.shape(waypoints)}"
        )


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
    """Return the cubic spline through q (K, N) at s (K,); a line for two points."""
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
    ends = np.append(phases, True)  # starts of phases, and the end of the last one
    breaks = np.append(0.0, np.cumsum(np.array(profile.t)[phases]))
    position, speed = (np.array(x)[ends] for x in (profile.p, profile.v))
    # A cubic is determined by the values and slopes at its ends.
    return PiecewisePolynomial.CubicHermite(breaks, position[None], speed[None])


def _slowdown(
    path: PiecewisePolynomial, profile: PiecewisePolynomial, limits: MotionLimits
) -> float:
    """Return the factor on time at which the joints keep their limits, at least 1."""
    t = np.linspace(0.0, profile.end_time(), _SAMPLES)
    s, rate, rate_dot = (profile.derivative(i).vector_values(t)[0] for i in range(3))
    slope, bend = (path.derivative(i).vector_values(s).T for i in (1, 2))
    v = slope * rate[:, None]
    a = bend * rate[:, None] ** 2 + slope * rate_dot[:, None]
    return max(1.0, _SAMPLING_SLACK * limits.slowdown(v, a))


# Between the checked configurations, the polyline may break its margin by this [m]. A
# motion that is checked there must not fail because of that.
_GRAZE = 1e-3
# A motion keeps a line, within `STRAIGHT` [rad], if no link is farther than this from
# its place on the line [m].
_ON_LINE = 3e-3
_RAMP = 0.04  # duration of the shortest ramp from one acceleration to another [s]


def time_optimal_trajectory(
    scene: PlanningScene,
    waypoints: Vector,
    limits: MotionLimits,
    *,
    rounding: float | Vector = ROUNDING,
) -> BsplineTrajectory | PlanningFailure:
    """Plan a fast motion from rest to rest along `waypoints`, within `limits`.

    The path's corners are rounded, by less and less until the motion is free in
    `scene`. toppra finds the fastest motion along it; a spline then gives each step of
    the acceleration a ramp. The whole motion lasts two to three ramps longer than the
    fastest. The result keeps the limits of velocity and acceleration at every instant,
    and those of torque at every knot.

    Args:
        scene: The scene in which the polyline is free, with the object in the hand.
        waypoints: The polyline, shape (K, N) [rad].
        limits: Limits of the motion.
        rounding: Largest distance of the motion from the polyline [rad], everywhere or
            at each waypoint, shape (K,). For a path of `plan_cartesian_path`, 1e-3
            keeps the hand within a millimetre of its line. If only some waypoints have
            such a value, their lines are not checked again.

    Returns:
        q(t), shape (N, 1) [rad], from t = 0, with the velocity EvalDerivative(t, 1); or
        why there is no motion.

    Raises:
        ValueError: If a rounding is not positive, or waypoints are not of shape (K, N).
    """
    _check_shape(scene, waypoints)
    allowed = np.broadcast_to(rounding, len(waypoints))
    if np.min(allowed) <= 0.0:
        raise ValueError("rounding must be positive")
    lengths = np.linalg.norm(np.diff(waypoints, axis=0), axis=1)
    distinct = np.append(True, lengths > 1e-9)
    waypoints, allowed = waypoints[distinct], allowed[distinct]
    if len(waypoints) == 1:
        return _ramped(np.repeat(waypoints, 5, axis=0), _RAMP)
    message = ""
    spans = 4
    while spans <= 256:
        path, deviation = rounded_path(waypoints, spans, allowed)
        spans *= 2
        if deviation > 1.0:
            continue
        progress = load_toppra()(scene, path, limits, grid_of(path))
        if progress is None:
            return PlanningFailure(
                Failure.OUT_OF_REACH,
                "the arm's torque cannot hold the arm all along this path",
            )
        motion = PathParameterizedTrajectory(path, progress)
        trajectory = _within_limits(scene, motion, limits)
        # A straight line stays straight and has been checked.
        samples = motion_samples(scene, trajectory)
        if len(waypoints) == 2:
            samples = samples[:0]
        elif np.ndim(rounding) > 0:
            samples = samples[~_on_lines(scene, waypoints, allowed, samples)]
        hit = scene.first_hit(samples, _GRAZE)
        if hit is None:
            return trajectory
        message = f": {hit}"
    return PlanningFailure(Failure.BLOCKED, f"no rounding of the path is free{message}")


def rounded_path(
    waypoints: Vector, spans: int, allowed: float | Vector = np.inf
) -> tuple[BsplineTrajectory, float]:
    """Return a spline of `spans` equal spans over a polyline, and its deviation.

    Args:
        waypoints: The polyline, shape (K, N) [rad].
        spans: The more there are, the less the corners are rounded.
        allowed: Distance from the polyline, everywhere or at each waypoint, (K,) [rad].

    Returns:
        q(s), shape (N, 1) [rad], from s = 0 to the length of the polyline [rad]; and
        the spline's largest distance from the polyline at corners and knots, as a share
        of the allowed distance there.
    """
    lengths = np.linalg.norm(np.diff(waypoints, axis=0), axis=1)
    breaks = np.append(0.0, np.cumsum(lengths))
    allowed = np.broadcast_to(allowed, len(waypoints))

    def polyline(s: Vector) -> Vector:
        return np.array([np.interp(s, breaks, q) for q in waypoints.T]).T

    knots = np.linspace(0.0, breaks[-1], spans + 1)
    knots = np.concatenate([[0.0] * 3, knots, breaks[-1:], breaks[-1:], breaks[-1:]])
    averages = (knots[1:-3] + knots[2:-2] + knots[3:-1]) / 3.0
    control = polyline(averages)
    # Drake 1.58 with NumPy before 2.4 misreads strided columns as rows.
    columns = list(np.ascontiguousarray(control)[..., None])
    path = BsplineTrajectory(BsplineBasis(4, list(knots)), columns)
    s = np.concatenate([breaks, knots])
    deviation = np.linalg.norm(path.vector_values(s).T - polyline(s), axis=1)
    return path, float(np.max(deviation / np.interp(s, breaks, allowed)))


def _on_lines(
    scene: PlanningScene, waypoints: Vector, allowed: Vector, samples: Vector
) -> npt.NDArray[np.bool_]:
    """Return which samples (M, N) are on lines that a motion must keep, shape (M,).

    Args:
        scene: The scene, which bounds the links' motion by each joint.
        waypoints: The polyline, shape (K, N) [rad].
        allowed: Largest distance from it at each waypoint, shape (K,) [rad].
        samples: Configurations [rad].
    """
    kept = np.maximum(allowed[:-1], allowed[1:]) <= STRAIGHT
    starts, lines = waypoints[:-1][kept], np.diff(waypoints, axis=0)[kept]
    from_start = samples[:, np.newaxis] - starts
    share = np.sum(from_start * lines, axis=-1) / np.sum(lines**2, axis=-1)
    nearest = np.clip(share, 0.0, 1.0)[..., np.newaxis] * lines
    moved = np.abs(from_start - nearest) @ scene.levers
    return np.asarray(np.min(moved, axis=-1, initial=np.inf) < _ON_LINE)


def grid_of(path: BsplineTrajectory) -> Vector:
    """Return the s at which a motion along a path keeps its limits, shape (K,)."""
    spans = path.num_control_points() - 3
    return np.linspace(0.0, path.end_time(), int(np.clip(2 * spans, 30, 200)) + 1)


def _within_limits(
    scene: PlanningScene, motion: Trajectory, limits: MotionLimits
) -> BsplineTrajectory:
    """Return the motion with ramped acceleration, stretched until it keeps the limits.

    TOPP-RA keeps the limits at its grid points, but may slightly exceed them in
    between. Differences of a uniform cubic spline's control points bound its
    derivatives.
    """
    count = int(np.ceil(motion.end_time() / _RAMP))
    times = np.linspace(0.0, motion.end_time(), count + 1)
    times = np.concatenate([[0.0] * 2, times, times[-1:], times[-1:]])
    control = motion.vector_values(times).T
    step = motion.end_time() / count
    v = np.diff(control, axis=0) / step
    a = np.diff(v, axis=0) / step
    q_knot = (control[:-2] + 4.0 * control[1:-1] + control[2:]) / 6.0
    v_knot = (v[:-1] + v[1:]) / 2.0
    stretch = max(
        1.0,
        limits.slowdown(v, a),
        np.sqrt(_torque_use(scene, q_knot, v_knot, a, limits.torque)),
    )
    return _ramped(control, stretch * step)


def _torque_use(
    scene: PlanningScene, q: Vector, v: Vector, a: Vector, limit: Vector
) -> float:
    """Return the largest torque as a share of the limits that gravity leaves."""
    dynamics = InverseDynamics(scene)
    use = 0.0
    for q_i, v_i, a_i in zip(q, v, a, strict=True):
        dynamics.SetPosition(q_i)
        motion = dynamics.moving(v_i, a_i)
        left = np.maximum(limit - np.sign(motion) * dynamics.holding(), 1e-6)
        use = max(use, float(np.max(np.abs(motion) / left)))
    return use


def _ramped(control: Vector, step: float) -> BsplineTrajectory:
    """Return the uniform cubic spline of control points (n, N), `step` [s] apart."""
    knots = step * np.arange(-3.0, len(control) + 1.0)
    return BsplineTrajectory(BsplineBasis(4, list(knots)), list(control[..., None]))


def motion_samples(
    scene: PlanningScene, trajectory: Trajectory, levers: Vector | None = None
) -> Vector:
    """Return configurations along a motion, as dense as the scene's step, (K, N).

    Args:
        scene: The scene.
        trajectory: The motion.
        levers: Bounds on the motion by each joint, shape (N,) [m/rad]; None: the
            scene's.
    """
    levers = scene.levers if levers is None else levers
    times = np.linspace(0.0, trajectory.end_time(), _SAMPLES)
    q = trajectory.vector_values(times).T
    moved = np.append(0.0, np.cumsum(np.abs(np.diff(q, axis=0)) @ levers))
    marks = np.arange(0.0, moved[-1], scene.step)
    return q[np.append(np.searchsorted(moved, marks), -1)]
