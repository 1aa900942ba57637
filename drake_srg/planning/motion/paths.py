"""Collision-free paths of the joints, and of the hand on straight lines."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable

import numpy as np
from numpy.random import Generator, default_rng
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RotationMatrix

from drake_srg.common.geometry import cross
from drake_srg.planning.motion.inverse_kinematics import (
    JOINT_MARGIN,
    HandTarget,
    IkFailure,
    solve_inverse_kinematics,
)
from drake_srg.planning.motion.planning_scene import PlanningFailure, PlanningScene
from drake_srg.types import Failure, Vector

_DAMPING = 1e-6  # m² and rad²: matters only within a millimetre of a singularity
_CLOSE = 1e-7  # m and rad; the next step would only add rounding errors
_MOST_STEPS = 20  # of Newton's method
_SHORTCUTS = 20  # number of random shortcuts to try on a path around obstacles
# Turn of the hand between the waypoints of a line, and the largest step of a joint
# there [rad]. With a larger one, the hand would leave its line in between.
_TURN_SPACING, _JOINT_STEP = 0.1, 0.3


def follow(scene: PlanningScene, target: HandTarget, q: Vector) -> Vector | None:
    """Move the joints from `q` by the least motion that takes the hand to `target`.

    Position and orientation are met exactly, despite tolerances; an axis turns
    only if it exceeds its angle. A joint that meets its limit stays there while the
    others continue. Collisions are not checked.

    Args:
        scene: The arm.
        target: Target of the hand.
        q: Posture of the arm, shape (N,) [rad].

    Returns:
        Joint angles near `q`, shape (N,) [rad], or None if it does not converge.
    """
    # A joint that starts beyond the margin may stay there, but must not go farther.
    lower = np.minimum(scene.lower + JOINT_MARGIN, q)
    upper = np.maximum(scene.upper - JOINT_MARGIN, q)
    for _ in range(_MOST_STEPS):
        error, jacobian = _linearize(scene, target, q)
        if np.max(np.abs(error)) < _CLOSE:
            return q
        step = np.zeros_like(q)
        free = np.ones(q.shape, dtype=bool)
        while True:
            J = jacobian * free
            rest = error - jacobian @ np.where(free, 0.0, step)
            damped = J @ J.T + _DAMPING * np.eye(len(error))
            step = np.where(free, J.T @ np.linalg.solve(damped, rest), step)
            beyond = (q + step < lower - 1e-12) | (q + step > upper + 1e-12)
            if not np.any(beyond):
                break
            step = np.clip(q + step, lower, upper) - q
            free &= ~beyond
        q = q + step
    return None


def _linearize(
    scene: PlanningScene, target: HandTarget, q: Vector
) -> tuple[Vector, Vector]:
    """Return the errors, shape (m,) [m, rad], and their Jacobian, shape (m, N)."""
    X_WG, J_W = scene.X_WG(q), scene.jacobian(q, target.p_GT)
    errors = [target.p_WT - X_WG @ target.p_GT]
    rows = [J_W[:3]]
    if target.R_WG is not None:
        turn = (target.R_WG @ X_WG.rotation().inverse()).ToAngleAxis()
        errors.append(turn.angle() * turn.axis())
        rows.append(J_W[3:])
    for axis in target.axes:
        axis_W = X_WG.rotation() @ axis.axis_G
        normal = cross(axis_W, axis.direction_W)
        sine = float(np.linalg.norm(normal))
        beyond = np.arctan2(sine, axis_W @ axis.direction_W) - axis.angle
        if axis.angle == 0.0:
            # The vector error across the axis: its length alone would let the axis
            # circle.
            errors.append(beyond * normal / max(sine, 1e-12))
            across = np.eye(3) - np.outer(axis.direction_W, axis.direction_W)
            rows.append(across @ J_W[3:])
        elif beyond > 0.0 and sine > 0.0:
            errors.append(np.array([beyond]))
            rows.append(normal[np.newaxis] / sine @ J_W[3:])
    return np.concatenate(errors), np.concatenate(rows)


EdgeTest = Callable[[Vector, Vector], bool]


class _Tree:
    """A tree of postures; the joints' `weights` (N,) define the metric."""

    def __init__(self, root: Vector, weights: Vector) -> None:
        self.vertices = [root]
        self._weighted = [weights * root]
        self._parents = [-1]
        self._weights = weights

    def extend(self, target: Vector, step: float, is_edge_free: EdgeTest) -> bool:
        """Grow one step towards `target`; return whether it was free."""
        offsets = np.array(self._weighted) - self._weights * target
        distances = np.linalg.norm(offsets, axis=1)
        nearest = int(np.argmin(distances))
        q_near = self.vertices[nearest]
        share = min(1.0, step / max(distances[nearest], 1e-12))
        q_new = target if share == 1.0 else q_near + share * (target - q_near)
        if not is_edge_free(q_near, q_new):
            return False
        self.vertices.append(q_new)
        self._weighted.append(self._weights * q_new)
        self._parents.append(nearest)
        return True

    def branch(self) -> list[Vector]:
        """Return the vertices from the newest down to the root."""
        branch, index = [], len(self.vertices) - 1
        while index >= 0:
            branch.append(self.vertices[index])
            index = self._parents[index]
        return branch


def rrt_connect(
    scene: PlanningScene,
    q_start: Vector,
    q_goal: Vector,
    *,
    step: float,
    max_iterations: int,
    rng: Generator,
) -> Vector | None:
    """Search for a free polyline from `q_start` to `q_goal`, both free themselves.

    Two of three samples come from the box that start and goal span, widened by 1 rad,
    because paths around obstacles are mostly nearby. The third comes from anywhere
    within the limits.

    Args:
        scene: The arm, and what to keep clear of.
        q_start: First waypoint, shape (N,) [rad].
        q_goal: Last waypoint, shape (N,) [rad].
        step: Longest edge of a tree [m]: joints count with their levers.
        max_iterations: Largest number of samples.
        rng: Source of the samples.

    Returns:
        The waypoints, shape (K, N) [rad], or None after `max_iterations` samples.
    """
    lower, upper, is_edge_free = scene.lower, scene.upper, scene.is_edge_free
    near_lower = np.maximum(lower, np.minimum(q_start, q_goal) - 1.0)
    near_upper = np.minimum(upper, np.maximum(q_start, q_goal) + 1.0)
    first, second = (_Tree(root, scene.levers) for root in (q_start, q_goal))
    for iteration in range(max_iterations):
        sample = (
            rng.uniform(lower, upper)
            if iteration % 3 == 2
            else rng.uniform(near_lower, near_upper)
        )
        if first.extend(sample, step, is_edge_free):
            target = first.vertices[-1]
            while second.extend(target, step, is_edge_free):
                if second.vertices[-1] is target:
                    path = first.branch()[::-1] + second.branch()[1:]
                    return np.array(path if iteration % 2 == 0 else path[::-1])
        first, second = second, first
    return None


def shortcut_path(
    path: Vector, *, is_edge_free: EdgeTest, attempts: int, rng: Generator
) -> Vector:
    """Replace stretches of a free polyline by straight lines where those are free.

    First, each vertex is joined to the farthest one in a free straight line. Then
    `attempts` pairs of random points are joined. Start and end stay.

    Returns:
        The shorter waypoints, shape (K', N).
    """
    vertices, index = [path[0]], 0
    while index < len(path) - 1:
        index = next(
            last
            for last in range(len(path) - 1, index, -1)
            if last == index + 1 or is_edge_free(path[index], path[last])
        )
        vertices.append(path[index])
    for _ in range(attempts):
        if len(vertices) == 2:
            break
        a, b = np.sort(rng.uniform(0.0, len(vertices) - 1.0, 2))
        i, j = int(a), int(b)
        if i == j:
            continue
        q_a = vertices[i] + (a - i) * (vertices[i + 1] - vertices[i])
        q_b = vertices[j] + (b - j) * (vertices[j + 1] - vertices[j])
        if is_edge_free(q_a, q_b):
            vertices = [*vertices[: i + 1], q_a, q_b, *vertices[j + 1 :]]
    return np.array(vertices)


def plan_joint_path(
    scene: PlanningScene,
    q_start: Vector,
    q_goal: Vector,
    *,
    max_iterations: int = 1000,
    seed: int = 0,
) -> Vector | PlanningFailure:
    """Find waypoints that straight joint lines connect without collision.

    The path is the straight line if it is free, otherwise the shortened path of
    RRT-Connect. The same call returns the same path.

    Args:
        scene: The arm, and what to keep clear of.
        q_start: First waypoint, shape (N,) [rad].
        q_goal: Last waypoint, shape (N,) [rad].
        max_iterations: Most iterations of RRT-Connect; each takes about 5 ms.
        seed: Seed of the search.

    Returns:
        Waypoints, shape (K, N) [rad], or why there is no path.
    """
    for name, q in (("start", q_start), ("goal", q_goal)):
        hit = scene.first_hit([q])
        if hit:
            message = f"the {name} is not free: {hit}"
            return PlanningFailure(Failure.BLOCKED, message)
    if scene.is_edge_free(q_start, q_goal):
        return np.array([q_start, q_goal])
    rng = default_rng(seed)
    path = rrt_connect(
        scene,
        q_start,
        q_goal,
        step=0.5,  # m of motion; a few steps lead around any obstacle
        max_iterations=max_iterations,
        rng=rng,
    )
    if path is None:
        hit = scene.first_hit(scene.samples(np.array([q_start, q_goal])))
        return PlanningFailure(
            Failure.BLOCKED,
            f"no path in {max_iterations} iterations; on the straight line, {hit}",
        )
    return shortcut_path(
        path, is_edge_free=scene.is_edge_free, attempts=_SHORTCUTS, rng=rng
    )


def plan_cartesian_path(
    scene: PlanningScene,
    q_start: Vector,
    target: HandTarget,
    *,
    spacing: float = 0.02,
) -> Vector | PlanningFailure:
    """Plan a straight path of the hand's point T from `q_start` to `target`.

    An orientation turns evenly about one axis from its start. Axes stay within their
    angles along the whole line, so `q_start` must meet them. To end at a known posture
    instead of starting from one, plan backwards and reverse the path.

    Args:
        scene: The arm, and what to keep clear of.
        q_start: First waypoint, shape (N,) [rad].
        target: Target of the hand.
        spacing: Distance of T between waypoints [m].

    Returns:
        Waypoints, shape (K, N) [rad], or why there is no path.
    """
    path, failure = _line(scene, q_start, target, spacing)
    p_start = scene.X_WG(q_start) @ target.p_GT
    for q in scene.samples(path) if len(path) > 1 else ():
        hit = scene.first_hit([q])
        if hit:
            along = float(np.linalg.norm(scene.X_WG(q) @ target.p_GT - p_start))
            message = f"{along:.3f} m along the line, {hit}"
            return PlanningFailure(Failure.BLOCKED, message)
    return failure or path


def _line(
    scene: PlanningScene, q_start: Vector, target: HandTarget, spacing: float
) -> tuple[Vector, PlanningFailure | None]:
    """Follow the line of `plan_cartesian_path`, ignoring obstacles.

    Returns:
        The waypoints that are reached, shape (K, N) [rad], and the reason why the line
        ends early, if it does.
    """
    X_WG = scene.X_WG(q_start)
    p_start = X_WG @ target.p_GT
    turn = AngleAxis()
    if target.R_WG is not None:
        turn = (X_WG.rotation().inverse() @ target.R_WG).ToAngleAxis()
    length = float(np.linalg.norm(target.p_WT - p_start))
    count = int(np.ceil(max(length / spacing, abs(turn.angle()) / _TURN_SPACING, 1.0)))
    path = [q_start]
    for share in np.linspace(0.0, 1.0, count + 1)[1:]:
        R_WG = None
        if target.R_WG is not None:
            part = RotationMatrix(AngleAxis(share * turn.angle(), turn.axis()))
            R_WG = X_WG.rotation() @ part
        waypoint = dc.replace(
            target, p_WT=p_start + share * (target.p_WT - p_start), R_WG=R_WG
        )
        where = f"{share * length:.3f} m along the line"
        q = follow(scene, waypoint, path[-1])
        if q is None:
            found = solve_inverse_kinematics(
                scene,
                waypoint,
                q_nominal=path[-1],
                max_starts=1,
                check_clearance=False,
            )
            if isinstance(found, IkFailure):
                message = f"{where}, {found.message}"
                return np.array(path), PlanningFailure(found.failure, message)
            q = found.q
        jump = np.abs(q - path[-1])
        if np.max(jump) > _JOINT_STEP:
            i = int(np.argmax(jump))
            far = f"{jump[i]:.2f} {scene.joint_units[i]}"
            message = f"{where}, {scene.joint_names[i]} would jump by {far}"
            return np.array(path), PlanningFailure(Failure.OUT_OF_REACH, message)
        path.append(q)
    return np.array(path), None
