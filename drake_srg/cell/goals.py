"""Where the picked object shall be, at the end of a cycle and of a run."""

from __future__ import annotations

import numpy as np
from pydrake.math import RigidTransform

from drake_srg.objects.models import simple_shape
from drake_srg.planning.task.sightings import lean, standing_at
from drake_srg.scenario import Scenario
from drake_srg.types import Shape, Sphere


def goal_pose(scenario: Scenario, shape: Shape) -> RigidTransform:
    """Where a cycle of the planner's shall put the object, upright, X_WO [m]."""
    place = scenario.task.place
    height = scenario.table.height if place.height is None else place.height
    return RigidTransform([*place.position, height + 0.5 * shape.height])


def final_pose(scenario: Scenario, X_WO_start: RigidTransform) -> RigidTransform:
    """Where the object shall be at the end of a run, X_WO [m].

    A script leaves it as high and as upright as it was. After an even number of cycles
    it is back where it was, upright.

    Args:
        scenario: What was run.
        X_WO_start: Where the object was first found [m].
    """
    pick, place = scenario.task.pick, scenario.task.place
    shape = simple_shape(pick, scenario.objects[pick])
    if scenario.script or shape is None:
        height = X_WO_start.translation()[2]
        return RigidTransform(X_WO_start.rotation(), [*place.position, height])
    if scenario.task.repeat % 2 == 0:
        return standing_at(X_WO_start, shape)
    return goal_pose(scenario, shape)


def final_tilt(
    scenario: Scenario, X_WO_start: RigidTransform, X_WO: RigidTransform
) -> float | None:
    """Angle of the object's axis from where it shall point [rad]; None for a ball.

    What did not stand at first may be set down on either end.
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
