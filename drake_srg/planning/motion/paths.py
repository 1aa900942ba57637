"""Free paths: of the joints, straight or around obstacles; of the hand, straight."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from numpy.random import default_rng
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RotationMatrix

from drake_srg.planning.motion.failure import PlanningFailure
from drake_srg.planning.motion.follow import follow
from drake_srg.planning.motion.hand_target import HandTarget
from drake_srg.planning.motion.inverse_kinematics import (
    IkFailure,
    solve_inverse_kinematics,
)
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.planning.motion.rrt import rrt_connect, shortcut_path
from drake_srg.types import Failure, Vector


def plan_joint_path(
    scene: PlanningScene,
    q_start: Vector,
    q_goal: Vector,
    *,
    max_iterations: int = 1000,
    shortcuts: int = 20,
    seed: int = 0,
) -> Vector | PlanningFailure:
    """Find waypoints that straight joint lines connect without collision.

    The path is the straight line if that is free, or else that of RRT-Connect,
    shortened. The same call returns the same path.

    Args:
        scene: The arm, and what to keep clear of.
        q_start: First waypoint, shape (N,) [rad].
        q_goal: Last waypoint, shape (N,) [rad].
        max_iterations: Most iterations of RRT-Connect; each takes about 5 ms.
        shortcuts: How many random shortcuts to try.
        seed: Seed of the search.

    Returns:
        Waypoints, shape (K, N) [rad], or why there is no path.
    """
    for name, q in (("start", q_start), ("goal", q_goal)):
        hit = scene.first_hit([q])
        if hit:
            message = f"the {name} is not free: {hit}"
            return PlanningFailure(Failure.BLOCKED, message, hit)
    if scene.is_edge_free(q_start, q_goal):
        return np.array([q_start, q_goal])
    rng = default_rng(seed)
    path = rrt_connect(
        q_start,
        q_goal,
        lower=scene.lower,
        upper=scene.upper,
        weights=scene.levers,
        is_edge_free=scene.is_edge_free,
        step=0.5,  # m of motion; a few steps make up any way around
        max_iterations=max_iterations,
        rng=rng,
    )
    if path is None:
        hit = scene.first_hit(scene.samples(np.array([q_start, q_goal])))
        return PlanningFailure(
            Failure.BLOCKED,
            f"no path in {max_iterations} iterations; on the straight line, {hit}",
            hit,
        )
    return shortcut_path(
        path, is_edge_free=scene.is_edge_free, attempts=shortcuts, rng=rng
    )


def plan_cartesian_path(
    scene: PlanningScene,
    q_start: Vector,
    target: HandTarget,
    *,
    spacing: float = 0.02,
    turn_spacing: float = 0.1,
    max_joint_step: float = 0.3,
    joint_margin: float = 0.02,
) -> Vector | PlanningFailure:
    """Move the hand's point T straight from where it is at `q_start` to `target`.

    An orientation turns evenly about one axis from where it starts. Axes are kept
    within their angles all along, so `q_start` must have them there. To end at a known
    posture instead of starting from one, plan backwards and reverse the path.

    Args:
        scene: The arm, and what to keep clear of.
        q_start: First waypoint, shape (N,) [rad].
        target: Where the hand must arrive.
        spacing: Distance of T between waypoints [m].
        turn_spacing: Turn of the hand between waypoints [rad].
        max_joint_step: Largest step of a joint between waypoints [rad]; with a larger
            one, the hand would leave its line in between.
        joint_margin: Distance kept from the joint limits [rad].

    Returns:
        Waypoints, shape (K, N) [rad], or why there is no path.
    """
    path, failure = _line(
        scene,
        q_start,
        target,
        spacing=spacing,
        turn_spacing=turn_spacing,
        max_joint_step=max_joint_step,
        joint_margin=joint_margin,
    )
    p_start = scene.X_WG(q_start) @ target.p_GT
    for q in scene.samples(path) if len(path) > 1 else ():
        hit = scene.first_hit([q])
        if hit:
            along = float(np.linalg.norm(scene.X_WG(q) @ target.p_GT - p_start))
            message = f"{along:.3f} m along the line, {hit}"
            return PlanningFailure(Failure.BLOCKED, message, hit)
    return failure or path


def _line(
    scene: PlanningScene,
    q_start: Vector,
    target: HandTarget,
    *,
    spacing: float,
    turn_spacing: float,
    max_joint_step: float,
    joint_margin: float,
) -> tuple[Vector, PlanningFailure | None]:
    """Follow the line of `plan_cartesian_path`, whatever is in the way.

    Returns:
        The waypoints that are reached, shape (K, N) [rad], and why the rest is not.
    """
    X_WG = scene.X_WG(q_start)
    p_start = X_WG @ target.p_GT
    turn = AngleAxis()
    if target.R_WG is not None:
        turn = (X_WG.rotation().inverse() @ target.R_WG).ToAngleAxis()
    length = float(np.linalg.norm(target.p_WT - p_start))
    count = int(np.ceil(max(length / spacing, abs(turn.angle()) / turn_spacing, 1.0)))
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
        q = follow(scene, waypoint, path[-1], joint_margin=joint_margin)
        if q is None:
            found = solve_inverse_kinematics(
                scene,
                waypoint,
                q_nominal=path[-1],
                joint_margin=joint_margin,
                max_starts=1,
                check_clearance=False,
            )
            if isinstance(found, IkFailure):
                message = f"{where}, {found.message}"
                return np.array(path), PlanningFailure(found.failure, message)
            q = found.q
        jump = np.abs(q - path[-1])
        if np.max(jump) > max_joint_step:
            joint = scene.joint_names[int(np.argmax(jump))]
            message = f"{where}, {joint} would jump by {np.max(jump):.2f} rad"
            return np.array(path), PlanningFailure(Failure.OUT_OF_REACH, message)
        path.append(q)
    return np.array(path), None
