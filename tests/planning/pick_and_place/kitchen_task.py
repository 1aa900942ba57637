"""The task of the kitchen's can, and helpers to look at its motions."""

import numpy as np
from pydrake.math import RigidTransform

from planning.planning_world import CAN, MOVING

START = RigidTransform([0.6, 0.05, 0.5 * CAN.length])
GOAL = RigidTransform([0.55, -0.42, 0.5 * CAN.length])


def ends(trajectory):
    return [trajectory.value(t)[:, 0] for t in (0.0, trajectory.end_time())]


def samples(trajectory, count=40):
    times = np.linspace(0.0, trajectory.end_time(), count)
    return [trajectory.value(t)[:, 0] for t in times]


def assert_joined(planner, task):
    """Assert that each motion begins where the last one ends, from home to home."""
    q = planner.q_home
    for mode in MOVING:
        start, end = ends(task.motions[mode])
        np.testing.assert_allclose(start, q, atol=1e-6, err_msg=mode.value)
        q = end
    np.testing.assert_allclose(q, planner.q_home, atol=1e-6)


def object_in_world(planner, task, q):
    return (planner.scene.X_WG(q) @ task.grasp.X_GO).translation()
