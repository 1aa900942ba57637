"""The peg goes into its hole, and the planner reports by name why others do not fit."""

import numpy as np
import pytest
from pydrake.math import RigidTransform

from drake_srg.objects.models import object_shape
from drake_srg.planning.servoing.hand_motion import ServoArm, hand_twist
from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate
from drake_srg.station.planners import MakeTaskPlanner, goal_pose
from drake_srg.types import Mode

NO_HOLE = "directives.hole.add_model.file=package://drake_srg/sdf/hole_none.sdf"


@pytest.mark.parametrize("position", [(0.46, 0.19), (0.6, 0.0), (0.74, -0.19)])
def test_the_hand_has_a_way_out_where_the_peg_is_seated(position):
    scenario = load_scenario("insert")
    config, peg = scenario.planner, scenario.objects["peg"]
    planner, shape = MakeTaskPlanner(scenario), object_shape("peg", peg)
    down = RigidTransform([0.0, 0.0, -config.depth - config.hover])
    over = down.inverse() @ goal_pose(scenario, shape)
    X_WO = RigidTransform([*position, 0.5 * shape.length])
    task = planner.plan(planner.q_home, X_WO, shape, over)
    place = task.motions[Mode.PLACE]
    q, arm = place.value(place.end_time())[:, 0], ServoArm(planner.scene.plant)
    goal = down @ arm.X_WG(q)
    for _ in range(200):
        twist = hand_twist(arm.X_WG(q), goal, gain=100.0, speed=0.05, turning=0.5)
        q = arm.step(q, twist, 0.01, 0.02).q
    assert arm.X_WG(q).IsNearlyEqualTo(goal, 1e-6)
    assert isinstance(planner.plan_escape(q, task.grasp.fingers_open), tuple)


@pytest.mark.slow
def test_the_peg_is_seated_and_released():
    metrics = Simulate(load_scenario("insert", overrides=["safety={}"])).metrics
    assert metrics.success, metrics.failure
    assert metrics.safety_stops == []
    assert np.abs(metrics.placement_error_m[2]) < 5e-4


@pytest.mark.slow
def test_a_plate_without_a_hole_is_told():
    # The experiment insertion_told has other wrong holes.
    overrides = [NO_HOLE, "planner.tries=1", "safety={}"]
    metrics = Simulate(load_scenario("insert", overrides=overrides)).metrics
    assert metrics.failure == "no_hole"
    assert metrics.safety_stops == []
