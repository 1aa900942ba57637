"""Where an arm hides no place that things are dropped or set down in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.types import Vector

# Horizontal distance of the hand from such a place from which on it hides nothing [m].
_AWAY = 0.6
_TURNS = np.deg2rad(np.arange(15.0, 180.0, 15.0))  # of the first joint


def posture_aside(
    scene: PlanningScene, q_over: Vector, places: Sequence[Vector]
) -> Vector:
    """Return a posture over one place with the first joint turned away from all.

    It is the nearest one with the hand far enough from every place, or else that with
    the hand farthest from them. The first joint must turn about the vertical.

    Args:
        scene: The arm and the furniture.
        q_over: High over one of the places, shape (N,) [rad].
        places: x, y of their middles in world, shape (2,) each [m].
    """
    scene.SetFingers({})
    best, farthest = q_over, 0.0
    for turn in np.outer(_TURNS, [1.0, -1.0]).ravel():
        q = q_over.copy()
        q[0] += turn
        if not (scene.lower[0] <= q[0] <= scene.upper[0] and scene.is_free(q)):
            continue
        p_WG = scene.X_WG(q).translation()[:2]
        away = min(float(np.linalg.norm(p_WG - p)) for p in places)
        if away > _AWAY:
            return q
        if away > farthest:
            best, farthest = q, away
    return best
