"""Goal poses of the picked object: at the end of a cycle and of a run."""

from __future__ import annotations

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.common.convex_pieces import Solid
from drake_srg.objects.models import simple_shape
from drake_srg.objects.solids import planned_solid
from drake_srg.planning.task.sightings import lean, set_down_at, standing_at
from drake_srg.scenario import Scenario
from drake_srg.scenario.schema import script_of
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
    solid = shape or planned_solid(pick, scenario.objects[pick])
    if script_of(scenario) or solid is None:
        height = X_WO_start.translation()[2]
        return RigidTransform(X_WO_start.rotation(), [*place.position, height])
    if scenario.task.repeat % 2 == 0:
        return X_WO_start if shape is None else standing_at(X_WO_start, shape)
    if shape is None:
        return set_down_at(goal_pose(scenario, solid), X_WO_start, solid)
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
    shape = simple_shape(pick, scenario.objects[pick])
    if isinstance(shape, Sphere):
        return None
    if shape is None:  # it may be turned about the vertical, also where it lies
        up_O, up_O_end = (X.rotation().matrix()[2] for X in (X_WO_start, X_WO))
        sine = float(np.linalg.norm(np.cross(up_O, up_O_end)))
        return float(np.arctan2(sine, up_O @ up_O_end))
    X_WO_goal = final_pose(scenario, X_WO_start)
    goal = X_WO_goal.rotation().col(2)
    axis = X_WO.rotation().col(2)
    tilt = lean(goal, axis)
    stood = goal @ X_WO_start.rotation().col(2) > np.cos(0.25 * np.pi)
    return np.pi - tilt if stood and goal @ axis < 0.0 else tilt
