import numpy as np
import pytest
from planning_world import CAN, MOVING
from pydrake.math import RigidTransform

from drake_srg.cell import MakeTaskPlanner
from drake_srg.planning.grasp_search import carrying
from drake_srg.planning.moves import TaskFailure
from drake_srg.scenario import load_scenario
from drake_srg.types import Box, Cylinder, Failure, Mode

START = RigidTransform([0.6, 0.05, 0.5 * CAN.length])
GOAL = RigidTransform([0.55, -0.42, 0.5 * CAN.length])
HEIGHT = START.translation()[2]


@pytest.fixture(scope="module")
def planner():
    return MakeTaskPlanner(load_scenario("kitchen"))


@pytest.fixture(scope="module")
def task(planner):
    return planner.plan(planner.q_home, START, CAN, GOAL)


def ends(trajectory):
    return [trajectory.value(t)[:, 0] for t in (0.0, trajectory.end_time())]


def samples(trajectory, count=40):
    times = np.linspace(0.0, trajectory.end_time(), count)
    return [trajectory.value(t)[:, 0] for t in times]


def object_in_world(planner, task, q):
    return (planner.scene.X_WG(q) @ task.grasp.X_GO).translation()


def test_every_moving_mode_has_a_motion(task):
    assert set(task.motions) == set(MOVING)


def test_each_motion_begins_where_the_last_one_ends(planner, task):
    q = planner.q_home
    for mode in MOVING:
        start, end = ends(task.motions[mode])
        np.testing.assert_allclose(start, q, atol=1e-6, err_msg=mode.value)
        q = end
    np.testing.assert_allclose(q, planner.q_home, atol=1e-6)


def test_each_motion_begins_and_ends_at_rest(task):
    for mode, trajectory in task.motions.items():
        for t in (0.0, trajectory.end_time()):
            rate = trajectory.EvalDerivative(t, 1)
            np.testing.assert_allclose(rate, 0.0, atol=1e-6, err_msg=mode.value)


def test_the_grasp_is_at_the_object_and_the_release_at_the_goal(planner, task):
    options = planner.config
    _, q_grasp = ends(task.motions[Mode.GRASP])
    _, q_place = ends(task.motions[Mode.PLACE])
    # Inverse kinematics and the line's follower allow 0.1 mm each.
    grasped = object_in_world(planner, task, q_grasp)
    np.testing.assert_allclose(grasped, START.translation(), atol=2.5e-4)
    placed = object_in_world(planner, task, q_place)
    above = np.array([0.0, 0.0, options.place_height])
    np.testing.assert_allclose(placed, GOAL.translation() + above, atol=2.5e-4)


def test_lifting_goes_straight_up(planner, task):
    path = [object_in_world(planner, task, q) for q in samples(task.motions[Mode.LIFT])]
    path = np.array(path)
    # A millimetre is the rounding of a straight path's corners, 1e-3 rad over 1 m.
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


def test_planning_again_gives_the_same(planner, task):
    again = planner.plan(planner.q_home, START, CAN, GOAL)
    for mode in MOVING:
        first, second = task.motions[mode], again.motions[mode]
        assert first.end_time() == second.end_time()
        np.testing.assert_array_equal(samples(first, 5), samples(second, 5))


@pytest.mark.parametrize(
    ("start", "goal", "failure"),
    [
        ([1.2, 0.6, HEIGHT], GOAL, Failure.OUT_OF_REACH),
        (START, [1.2, -0.7, HEIGHT], Failure.OUT_OF_REACH),
        (START, [0.0, 0.0, HEIGHT], Failure.BLOCKED),  # in the robot's foot
    ],
)
def test_what_cannot_be_done_is_named(planner, start, goal, failure):
    start, goal = (
        pose if isinstance(pose, RigidTransform) else RigidTransform(pose)
        for pose in (start, goal)
    )
    result = planner.plan(planner.q_home, start, CAN, goal)
    assert isinstance(result, TaskFailure)
    assert result.failure is failure
    assert result.message


def test_an_object_without_known_grasps(planner):
    box = Box([0.05, 0.05, 0.1])
    result = planner.plan(planner.q_home, START, box, GOAL)
    assert result.failure is Failure.NO_GRASP
    assert "Box" in result.message


def test_the_way_out_backs_off_and_goes_home(planner, task):
    _, q_grasp = ends(task.motions[Mode.GRASP])
    back, home = planner.plan_escape(q_grasp, task.grasp.fingers_open)
    np.testing.assert_allclose(ends(back)[0], q_grasp, atol=1e-6)
    X_start, X_end = (planner.scene.X_WG(q) for q in ends(back))
    moved = X_end.translation() - X_start.translation()
    expected = -planner.config.approach_distance * X_start.rotation().col(0)
    np.testing.assert_allclose(moved, expected, atol=1e-3)
    np.testing.assert_allclose(ends(home)[0], ends(back)[1], atol=1e-6)
    np.testing.assert_allclose(ends(home)[1], planner.q_home, atol=1e-6)


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


def test_what_is_carried_keeps_clear_of_what_it_passes_over(planner, task):
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
            # Rounded corners may graze what keeps its distance by a millimetre.
            assert found.distance > planner.config.hand_clearance - 1e-3, found
            up = (scene.X_WG(q) @ over.grasp.X_GO).rotation().matrix()[:, 2]
            assert up[2] > np.cos(np.deg2rad(1.0))  # over it, not around it
