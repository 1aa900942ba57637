"""The task of the kitchen's can, and helpers to look at its motions."""

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.planning.motion.planning_scene import PlanningFailure
from planning.planning_world import CAN, MOVING

START = RigidTransform([0.6, 0.05, 0.5 * CAN.length])
GOAL = RigidTransform([0.55, -0.42, 0.5 * CAN.length])


def ends(trajectory):
    return [trajectory.value(t)[:, 0] for t in (0.0, trajectory.end_time())]


def samples(trajectory, count=40):
    times = np.linspace(0.0, trajectory.end_time(), count)
    return [trajectory.value(t)[:, 0] for t in times]


def assert_joined(q_start, motions, q_end=None):
    """Assert that motions join end to end, by default in a closed loop."""
    q = q_start
    for motion in motions:
        start, end = ends(motion)
        np.testing.assert_allclose(start, q, atol=1e-6)
        q = end
    np.testing.assert_allclose(q, q_start if q_end is None else q_end, atol=1e-6)


def assert_a_cycle(planner, task):
    """Assert that a task has a motion for each moving mode, from home to home."""
    assert set(task.motions) == set(MOVING)
    assert_joined(planner.q_home, [task.motions[mode] for mode in MOVING])


def object_in_world(planner, task, q):
    return (planner.scene.X_WG(q) @ task.grasp.X_GO).translation()


def assert_fails(result, failure, *words):
    """Assert that planning fails for a reason whose message has some words."""
    assert isinstance(result, PlanningFailure)
    assert result.failure is failure
    assert all(word in result.message for word in words), result.message
