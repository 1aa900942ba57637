"""Where an arm reaches a table with the hand down."""

from __future__ import annotations

import numpy as np

from drake_srg.planning.grasps.top_grasp import palm_pose
from drake_srg.planning.grasps.top_grasp_search import Reach
from drake_srg.planning.motion.hand_target import HandTarget
from drake_srg.planning.motion.inverse_kinematics import (
    IkFailure,
    solve_from,
    solve_inverse_kinematics,
)
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.types import Vector

_WITHIN = 0.01  # error of the ring's radii [m]
_STARTS = 4  # of inverse kinematics in the middle


def turned_to(scene: PlanningScene, q: Vector, p_W: Vector) -> Vector:
    """Return a posture turned about the arm's first joint to face a place.

    The best start of inverse kinematics for a hand there: from a posture that faces
    elsewhere, the solver often ends with the arm bent backwards, or nowhere. The first
    joint must turn about the vertical.

    Args:
        scene: The arm.
        q: The posture, shape (N,) [rad].
        p_W: The place, shape (2 or 3,) [m].

    Returns:
        Shape (N,) [rad], turned as far as the joint's limits allow, the other way
        round where they forbid the short one.
    """
    (x, y), (x_to, y_to) = (
        p[:2] - scene.p_WA[:2] for p in (scene.X_WG(q).translation(), p_W)
    )
    turn = np.arctan2(x * y_to - y * x_to, x * x_to + y * y_to)
    turned = q[0] + turn + 2.0 * np.pi * np.array([0.0, -1.0, 1.0])
    allowed = np.clip(turned, scene.lower[0], scene.upper[0])
    first = allowed[np.argmin(abs(allowed - turned))]
    return np.array([first, *q[1:]])


def reach_with_hand_down(
    scene: PlanningScene, q_nominal: Vector, p_WG: Vector
) -> Reach | None:
    """Return the ring around the arm's first joint in which the hand can point down.

    The first joint must turn about the vertical. Obstacles do not count.

    Args:
        scene: The arm.
        q_nominal: A posture with the hand down, shape (N,) [rad].
        p_WG: Where the palm may be, such as over the middle of the table, shape (3,)
            [m]. Its height counts, and the direction from the arm.

    Returns:
        The ring; None if the hand does not reach `p_WG` itself.
    """
    away = p_WG[:2] - scene.p_WA[:2]
    middle = float(np.linalg.norm(away))
    yaw = float(np.arctan2(away[1], away[0]))

    def target(radius: float) -> HandTarget:
        p = np.array([*(scene.p_WA[:2] + radius / middle * away), p_WG[2]])
        return HandTarget.from_pose(palm_pose(p, yaw))

    in_middle = solve_inverse_kinematics(
        scene,
        target(middle),
        q_nominal=q_nominal,
        q_guess=turned_to(scene, q_nominal, p_WG),
        max_starts=_STARTS,
        check_clearance=False,
    )
    if isinstance(in_middle, IkFailure):
        return None
    ends = []
    for beyond in (0.0, float(scene.levers[0])):
        within, without, q = middle, beyond, in_middle.q
        while abs(without - within) > _WITHIN:
            between = 0.5 * (within + without)
            # What is reached nearby is the best start, and the only one needed.
            found = solve_from(scene, target(between), q)
            if found is None:
                without = between
            else:
                within, q = between, found
        ends.append(within)
    x, y = scene.p_WA[:2]
    return Reach((float(x), float(y)), *ends)
