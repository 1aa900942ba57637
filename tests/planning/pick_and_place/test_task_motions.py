"""The motions of a pick and place, of the kitchen's arm."""

import dataclasses as dc

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from drake_srg.planning.grasps.grasps import carrying
from drake_srg.planning.motion.planning_scene import carried_drift
from drake_srg.planning.pick_and_place.task_motions import TaskPlanner
from drake_srg.types import Box, Cylinder, Failure, Mode
from planning.pick_and_place.kitchen_task import (
    GOAL,
    START,
    assert_a_cycle,
    assert_fails,
    ends,
    object_in_world,
    samples,
)
from planning.planning_world import CAN, MOVING

HEIGHT = START.translation()[2]


@pytest.mark.slow
def test_the_same_call_plans_the_same_motions(planner, task):
    again = planner.plan(planner.q_home, START, CAN, GOAL)
    for mode in MOVING:
        first, second = task.motions[mode], again.motions[mode]
        assert first.end_time() == second.end_time()
        np.testing.assert_array_equal(samples(first, 5), samples(second, 5))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("start", "goal", "failure"),
    [
        ([1.2, 0.6, HEIGHT], GOAL, Failure.OUT_OF_REACH),
        (START, [1.2, -0.7, HEIGHT], Failure.OUT_OF_REACH),
        (START, [0.0, 0.0, HEIGHT], Failure.BLOCKED),  # in the foot of the arm
    ],
)
def test_a_failure_names_what_is_impossible(planner, start, goal, failure):
    start, goal = (
        pose if isinstance(pose, RigidTransform) else RigidTransform(pose)
        for pose in (start, goal)
    )
    result = planner.plan(planner.q_home, start, CAN, goal)
    assert_fails(result, failure)
    assert result.message


def test_an_object_without_known_grasps_is_not_taken(planner):
    box = Box([0.2, 0.2, 0.1])
    result = planner.plan(planner.q_home, START, box, GOAL)
    assert_fails(result, Failure.NO_GRASP, "Box")


@pytest.mark.slow
@pytest.mark.parametrize("yaw", [0.0, 0.7, 2.5])
def test_a_box_is_taken_by_its_faces_and_stands_as_the_hand_holds_it(planner, yaw):
    box = Box([0.05, 0.07, 0.1])
    X_WO = RigidTransform(RotationMatrix.MakeZRotation(yaw), [0.6, 0.1, 0.051])
    task = planner.plan(planner.q_home, X_WO, box, GOAL)
    _, q_grasp = ends(task.motions[Mode.GRASP])
    y_O = (X_WO.inverse() @ planner.scene.X_WG(q_grasp)).rotation().col(1)
    assert np.sort(np.abs(y_O)) == pytest.approx([0.0, 0.0, 1.0], abs=0.004)
    _, q_place = ends(task.motions[Mode.PLACE])
    X_WO_placed = planner.scene.X_WG(q_place) @ task.grasp.X_GO
    assert X_WO_placed.rotation().col(2)[2] == pytest.approx(1.0, abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("shape", [CAN, Box([0.05, 0.06, 0.1])])
def test_what_lies_is_set_upright(planner, shape):
    lying = RotationMatrix(RollPitchYaw(np.pi / 2, 0.0, 0.5))
    height = shape.half_extent(lying.inverse() @ [0.0, 0.0, 1.0]) + 0.001
    X_WO = RigidTransform(lying, [0.6, 0.1, height])
    task = planner.plan(planner.q_home, X_WO, shape, GOAL)
    _, q_grasp = ends(task.motions[Mode.GRASP])
    x_W = planner.scene.X_WG(q_grasp).rotation().col(0)
    assert x_W[2] < -np.cos(np.deg2rad(35.0))  # from above
    _, q_place = ends(task.motions[Mode.PLACE])
    X_WO_placed = planner.scene.X_WG(q_place) @ task.grasp.X_GO
    assert abs(X_WO_placed.rotation().col(2)[2]) == pytest.approx(1.0, abs=1e-4)
    lowest = GOAL.translation() + planner.config.place_height * np.eye(3)[2]
    np.testing.assert_allclose(X_WO_placed.translation(), lowest, atol=1e-3)


def test_the_escape_backs_off_and_goes_home(planner, task):
    _, q_grasp = ends(task.motions[Mode.GRASP])
    back, home = planner.plan_escape(q_grasp, task.grasp.fingers_open)
    np.testing.assert_allclose(ends(back)[0], q_grasp, atol=1e-6)
    X_start, X_end = (planner.scene.X_WG(q) for q in ends(back))
    moved = X_end.translation() - X_start.translation()
    expected = -planner.config.approach_distance * X_start.rotation().col(0)
    np.testing.assert_allclose(moved, expected, atol=1e-3)
    np.testing.assert_allclose(ends(home)[0], ends(back)[1], atol=1e-6)
    np.testing.assert_allclose(ends(home)[1], planner.q_home, atol=1e-6)


def test_each_motion_begins_where_the_last_one_ends(planner, task):
    assert_a_cycle(planner, task)


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


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
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
