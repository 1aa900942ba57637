"""Newton's method for targets of the hand near the last posture."""

from __future__ import annotations

import numpy as np
from pydrake.multibody.tree import JacobianWrtVariable

from drake_srg.common.cross import cross
from drake_srg.planning.motion.hand_target import HandTarget
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.types import Vector

_DAMPING = 1e-6  # m² and rad²: matters only within a millimetre of a singularity
_CLOSE = 1e-7  # m and rad; the next step would only add rounding errors


def follow(
    scene: PlanningScene,
    target: HandTarget,
    q: Vector,
    *,
    joint_margin: float = 0.02,
    max_iterations: int = 20,
) -> Vector | None:
    """Move the joints from `q` just as far as takes the hand to `target`.

    Position and orientation are met exactly, whatever their tolerances; an axis turns
    only where it exceeds its angle. A joint that meets its limit stays there while the
    others go on. Collisions are not checked.

    Args:
        scene: The arm.
        target: Where the hand must be.
        q: Where the arm is, shape (N,) [rad].
        joint_margin: Distance kept from the joint limits [rad].
        max_iterations: Most steps of Newton's method.

    Returns:
        Joint angles near `q`, shape (N,) [rad], or None if it does not converge.
    """
    # A start beyond the margin may stay there, but must go no further.
    lower = np.minimum(scene.lower + joint_margin, q)
    upper = np.maximum(scene.upper - joint_margin, q)
    for _ in range(max_iterations):
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
    """Return what is missing, shape (m,) [m, rad], and its Jacobian, shape (m, N)."""
    X_WG = scene.X_WG(q)
    world = scene.plant.world_frame()
    J_W = scene.plant.CalcJacobianSpatialVelocity(
        scene.context, JacobianWrtVariable.kQDot, scene.hand_frame, target.p_GT,
        world, world,
    )[:, scene.arm_indices]  # fmt: skip
    errors = [target.p_WT - X_WG @ target.p_GT]
    rows = [J_W[3:]]
    if target.R_WG is not None:
        turn = (target.R_WG @ X_WG.rotation().inverse()).ToAngleAxis()
        errors.append(turn.angle() * turn.axis())
        rows.append(J_W[:3])
    for axis in target.axes:
        axis_W = X_WG.rotation() @ axis.axis_G
        normal = cross(axis_W, axis.direction_W)
        sine = float(np.linalg.norm(normal))
        beyond = np.arctan2(sine, axis_W @ axis.direction_W) - axis.angle
        if axis.angle == 0.0:
            # The whole error across the axis: its length alone lets the axis go around.
            errors.append(beyond * normal / max(sine, 1e-12))
            across = np.eye(3) - np.outer(axis.direction_W, axis.direction_W)
            rows.append(across @ J_W[:3])
        elif beyond > 0.0 and sine > 0.0:
            errors.append(np.array([beyond]))
            rows.append(normal[np.newaxis] / sine @ J_W[:3])
    return np.concatenate(errors), np.concatenate(rows)
