import dataclasses as dc

import numpy as np
import pytest
from pydrake.math import RigidTransform

from drake_srg.planning.grasps.grasps import carrying
from drake_srg.planning.motion.planning_scene import carried_drift
from drake_srg.planning.pick_and_place.task_motions import TaskPlanner
from drake_srg.types import Cylinder, Mode
from planning.pick_and_place.kitchen_task import (
    GOAL,
    START,
    assert_joined,
    ends,
    object_in_world,
    samples,
)
from planning.planning_world import CAN, MOVING

pytestmark = pytest.mark.slow


def test_every_moving_mode_has_a_motion(task):
    assert set(task.motions) == set(MOVING)


def test_each_motion_begins_where_the_last_one_ends(planner, task):
    assert_joined(planner, task)


def test_each_motion_begins_and_ends_at_rest(task):
    for mode, trajectory in task.motions.items():
        for t in (0.0, trajectory.end_time()):
            rate = trajectory.EvalDerivative(t, 1)
            np.testing.assert_allclose(rate, 0.0, atol=1e-6, err_msg=mode.value)


def test_the_grasp_is_at_the_object_and_the_release_at_the_goal(planner, task):
    options = planner.config
    _, q_grasp = ends(task.motions[Mode.GRASP])
    _, q_place = ends(task.motions[Mode.PLACE])
    # Inverse kinematics and following a line allow 0.1 mm each.
    grasped = object_in_world(planner, task, q_grasp)
    np.testing.assert_allclose(grasped, START.translation(), atol=2.5e-4)
    placed = object_in_world(planner, task, q_place)
    above = np.array([0.0, 0.0, options.place_height])
    np.testing.assert_allclose(placed, GOAL.translation() + above, atol=2.5e-4)


def test_the_hand_goes_short_of_where_the_object_drifts(planner, task):
    config = dc.replace(planner.config, drift_time=0.006)
    drifting = TaskPlanner(planner.scene, planner.hand, planner.q_home, config)
    other = drifting.plan(planner.q_home, START, CAN, GOAL)
    for mode in (Mode.LIFT, Mode.TRANSFER):
        np.testing.assert_array_equal(
            samples(other.motions[mode]), samples(task.motions[mode])
        )
    (_, q), (_, q_without) = (ends(t.motions[Mode.PLACE]) for t in (other, task))
    X_WG = planner.scene.X_WG(q)
    p_GO = task.grasp.p_GO
    drift = sum(
        carried_drift(planner.scene, task.motions[mode], p_GO, 0.006)
        for mode in (Mode.LIFT, Mode.TRANSFER)
    )
    assert 0.001 < np.linalg.norm(drift) < 0.006
    expected = object_in_world(planner, task, q_without)
    np.testing.assert_allclose(X_WG @ (p_GO + drift), expected, atol=1e-4)


def test_lifting_goes_straight_up(planner, task):
    path = [object_in_world(planner, task, q) for q in samples(task.motions[Mode.LIFT])]
    path = np.array(path)
    # Rounding a straight path's corners by 1e-3 rad over 1 m makes 1 mm.
    np.testing.assert_allclose(path[:, :2] - path[0, :2], 0.0, atol=1e-3)
    assert path[-1, 2] - path[0, 2] == pytest.approx(
        planner.config.lift_height, abs=1e-3
    )
    assert np.all(np.diff(path[:, 2]) > -1e-5)


def test_the_object_is_carried_upright(planner, task):
    for mode in (Mode.LIFT, Mode.TRANSFER, Mode.PLACE):
        for q in samples(task.motions[mode]):
            X_WO = planner.scene.X_WG(q) @ task.grasp.X_GO
            up = X_WO.rotation().col(2)
            assert np.arccos(np.clip(up[2], -1, 1)) < np.deg2rad(10.0), mode


def test_motions_keep_clear_of_other_objects(planner, task):
    # In the middle of the straight way across, as high as the hand.
    q_way = samples(task.motions[Mode.TRANSFER], 3)[1]
    p_way = object_in_world(planner, task, q_way)
    tower = Cylinder(0.03, 2.0 * p_way[2])
    X_WO = RigidTransform(p_way)
    around = planner.plan(planner.q_home, START, CAN, GOAL, obstacles=[(tower, X_WO)])
    with planner.scene.standing(tower, X_WO):
        planner.scene.fingers = 0.0 * planner.scene.fingers
        assert not planner.scene.is_free(q_way)
        for q in samples(around.motions[Mode.TRANSFER]):
            assert planner.scene.clearance(q).distance > 0.0


def test_a_carried_object_keeps_clear_of_what_it_passes_over(planner, task):
    # As high as the bottom of the carried can, in the middle of its way across.
    p_way = object_in_world(planner, task, samples(task.motions[Mode.TRANSFER], 3)[1])
    top = p_way[2] - 0.5 * CAN.length
    post = Cylinder(0.03, top)
    X_WO = RigidTransform([*p_way[:2], 0.5 * top])
    over = planner.plan(planner.q_home, START, CAN, GOAL, obstacles=[(post, X_WO)])
    scene = planner.scene
    with (
        scene.standing(post, X_WO),
        carrying(scene, CAN, over.grasp, supported=True),
    ):
        for q in samples(over.motions[Mode.TRANSFER]):
            found = scene.clearance(q)
            # Rounded corners may break the margin by a millimetre.
            assert found.distance > planner.config.hand_clearance - 1e-3, found
            up = (scene.X_WG(q) @ over.grasp.X_GO).rotation().matrix()[:, 2]
            assert up[2] > np.cos(np.deg2rad(1.0))  # over it, not around it
