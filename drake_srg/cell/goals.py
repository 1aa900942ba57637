"""Goal poses of the picked object: at the end of a cycle and of a run."""

from __future__ import annotations

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.common.convex_pieces import Solid
from drake_srg.objects.models import simple_shape
from drake_srg.planning.task.sightings import lean, standing_at
from drake_srg.scenario import Scenario
from drake_srg.types import Sphere


def goal_pose(scenario: Scenario, shape: Solid) -> RigidTransform:
    """Return the upright pose at which the planner places the object, X_WO [m].

    Args:
        scenario: The scenario with the task.
        shape: The object's shape.
    """
    place = scenario.task.place
    height = scenario.table.height if place.height is None else place.height
    below = shape.half_extent(np.array([0.0, 0.0, -1.0]))
    return RigidTransform([*place.position, height + below])


def final_pose(scenario: Scenario, X_WO_start: RigidTransform) -> RigidTransform:
    """Return the pose at which the object must be at the end of a run, X_WO [m].

    A script keeps the object's height and orientation, and the planner the orientation
    of one that is no simple shape. After an even number of the planner's cycles, the
    object is back at its start, upright if its shape is simple.

    Args:
        scenario: The scenario of the run.
        X_WO_start: Pose at which the object was first found [m].
    """
    pick, place = scenario.task.pick, scenario.task.place
    shape = simple_shape(pick, scenario.objects[pick])
    returned = scenario.task.repeat % 2 == 0 and not scenario.script
    if scenario.script or shape is None:
        if returned:
            return X_WO_start
        height = X_WO_start.translation()[2]
        if place.height is not None and not scenario.script:
            height += place.height - scenario.table.height
        return RigidTransform(X_WO_start.rotation(), [*place.position, height])
    if returned:
        return standing_at(X_WO_start, shape)
    return goal_pose(scenario, shape)


def final_tilt(
    scenario: Scenario, X_WO_start: RigidTransform, X_WO: RigidTransform
) -> float | None:
    """Return the angle of the object's axis from its goal [rad]; None for a sphere.

    An object that did not stand at the start may be placed on either end.

    Args:
        scenario: The scenario of the run.
        X_WO_start: Pose at which the object was first found [m].
        X_WO: Pose of the object at the end [m].
    """
    pick = scenario.task.pick
    if isinstance(simple_shape(pick, scenario.objects[pick]), Sphere):
        return None
    X_WO_goal = final_pose(scenario, X_WO_start)
    goal = X_WO_goal.rotation().col(2)
    axis = X_WO.rotation().col(2)
    tilt = lean(goal, axis)
    stood = goal @ X_WO_start.rotation().col(2) > np.cos(0.25 * np.pi)
    return np.pi - tilt if stood and goal @ axis < 0.0 else tilt
