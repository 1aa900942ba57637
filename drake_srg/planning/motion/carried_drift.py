"""How far a simulation in steps carries an object off the hand that holds it."""

from __future__ import annotations

import numpy as np
from pydrake.trajectories import Trajectory

from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.types import Vector

_SAMPLES = 24  # of a motion
_NEARBY = 1e-3  # time by which to follow the joints' speeds [s]


def carried_drift(
    scene: PlanningScene, motion: Trajectory, p_GO: Vector, time: float
) -> Vector:
    """Return how far a held object drifts in the hand's frame G, shape (3,) [m].

    In a step of h, the joints follow their speeds and the hand an arc, while the object
    moves along the tangent. So it drifts by -h/2 times the acceleration that the hand
    has at constant speeds of the joints.

    Args:
        scene: The arm and the gripper.
        motion: Of the arm's joints [rad].
        p_GO: The object's origin in the hand [m], shape (3,).
        time: h/2 [s].
    """
    ends = np.linspace(0.0, motion.end_time(), _SAMPLES + 1)
    accelerations = []
    for t in (ends[:-1] + ends[1:]) / 2.0:
        q, v = motion.value(t).ravel(), motion.EvalDerivative(t).ravel()
        before, X_WG, after = (
            scene.X_WG(q + dt * v) for dt in (-_NEARBY, 0.0, _NEARBY)
        )
        change_W = before @ p_GO - 2.0 * (X_WG @ p_GO) + after @ p_GO
        accelerations.append(X_WG.rotation().inverse() @ change_W / _NEARBY**2)
    drift: Vector = -time * motion.end_time() * np.mean(accelerations, axis=0)
    return drift
