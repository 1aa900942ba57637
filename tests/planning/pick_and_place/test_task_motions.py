import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.types import Box, Failure, Mode
from planning.pick_and_place.kitchen_task import GOAL, START, ends, samples
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
    assert isinstance(result, PlanningFailure)
    assert result.failure is failure
    assert result.message


def test_an_object_without_known_grasps_is_not_taken(planner):
    box = Box([0.2, 0.2, 0.1])
    result = planner.plan(planner.q_home, START, box, GOAL)
    assert result.failure is Failure.NO_GRASP
    assert "Box" in result.message


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
