"""The task planner of the five-axis arm: cylinders that stand, lie and lean."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from drake_srg.planning.grasps.grasps import pose_along
from drake_srg.planning.motion.inverse_kinematics import (
    AxisTarget,
    HandTarget,
    IkSolution,
    solve_inverse_kinematics,
)
from drake_srg.planning.motion.paths import follow
from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.planning.pick_and_place.sightings import lean
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeTaskPlanner
from drake_srg.station.planners import goal_pose
from drake_srg.types import Cylinder, Failure, Mode
from planning.pick_and_place.kitchen_task import (
    assert_a_cycle,
    assert_fails,
    ends,
    samples,
)
from planning.planning_world import MOVING

pytestmark = pytest.mark.slow

SCENARIO = load_scenario("assistive_arm")
CYLINDER = Cylinder(0.0125, 0.05)
GOAL = goal_pose(SCENARIO, CYLINDER)
BASE = np.array([0.0, -0.17282])  # of joint 1's axis, x and y [m]
UP = np.array([0.0, 0.0, 1.0])
HELD = [Mode.LIFT, Mode.TRANSFER, Mode.PLACE]


def at(radius, azimuth=0.0, lean=0.0, off=0.0, up=1):
    """Return the pose of a cylinder on table 1; angles are in degrees.

    Args:
        radius: Distance of its middle from joint 1's axis [m].
        azimuth: Azimuth of its middle, 0 straight in front of the arm.
        lean: Angle of its axis from the vertical; at 90 it lies.
        off: Direction in which it leans, 0 straight away from the arm.
        up: -1 has its other end up.
    """
    azimuth, lean, off = np.deg2rad([azimuth, lean, off])
    away = -np.array([np.cos(azimuth), np.sin(azimuth)])
    aside = np.array([away[1], -away[0]])
    level = np.cos(off) * away + np.sin(off) * aside
    axis = np.array([*np.sin(lean) * level, np.cos(lean)])
    height = 0.1 + 0.025 * np.cos(lean) + 0.0125 * np.sin(lean)
    return pose_along(np.array([*(BASE + radius * away), height]), up * axis)


POSES = {
    "upright, far": at(0.41, 10.0),
    "upright, near": at(0.25, -15.0),
    "lying": at(0.265, lean=90.0),
    "lying, its other end": at(0.265, lean=90.0, up=-1),
    "lying, the arm stretched": at(0.281, 12.0, lean=90.0),
    "lying, off radial": at(0.26, -12.0, lean=90.0, off=14.0),
    "leaning away, 15 degrees": at(0.33, 8.0, lean=15.0, off=-60.0),
    "leaning away, 30 degrees": at(0.40, lean=30.0, off=25.0),
    "leaning away, 60 degrees": at(0.30, lean=60.0),
}


@pytest.fixture(scope="module")
def planner():
    return MakeTaskPlanner(SCENARIO)


@pytest.fixture(scope="module")
def tasks(planner):
    return {
        name: planner.plan(planner.q_home, X_WO, CYLINDER, GOAL)
        for name, X_WO in POSES.items()
    }


@pytest.fixture(params=POSES)
def posed(request, tasks):
    """Return a pose, and the task that is planned for it."""
    task = tasks[request.param]
    assert not isinstance(task, PlanningFailure), task.message
    return POSES[request.param], task


def axis_angle(X_WO, axis_W):
    """Return the angle between an object's axis and a line [rad]."""
    return lean(X_WO.rotation().matrix()[:, 2], axis_W)


def test_each_motion_begins_where_the_last_one_ends(planner, posed):
    assert_a_cycle(planner, posed[1])


def test_the_hand_grasps_at_the_middle_with_the_pads_along_the_axis(planner, posed):
    X_WO, task = posed
    X_WG = planner.scene.X_WG(ends(task.motions[Mode.GRASP])[1])
    X_held = X_WG @ task.grasp.X_GO
    # Inverse kinematics allows 0.1 mm on each axis.
    assert np.linalg.norm(X_held.translation() - X_WO.translation()) < 2e-4
    axis_W = X_WO.rotation().matrix()[:, 2]
    angle = axis_angle(X_held, axis_W)
    if abs(axis_W[2]) < 0.1:
        # With the palm right above it, closing pads turn an object that lies across
        # them, by up to 16 degrees. SNOPT's cosines are right to 1e-6: here 1e-3 rad.
        assert angle < np.deg2rad(16.0) + 1e-3
        down = X_WG.rotation().matrix()[:, 0]
        np.testing.assert_allclose(down, -UP, atol=0.004)
    else:
        assert angle < 0.004


def test_the_object_stands_upright_when_it_is_released(planner, posed):
    _, task = posed
    X_WO = planner.scene.X_WG(ends(task.motions[Mode.PLACE])[1]) @ task.grasp.X_GO
    above = planner.config.place_height * UP
    np.testing.assert_allclose(
        X_WO.translation(), GOAL.translation() + above, atol=2.5e-4
    )
    assert axis_angle(X_WO, UP) < 0.006


def test_the_object_goes_straight_into_the_recess(planner, posed):
    _, task = posed
    for q in samples(task.motions[Mode.PLACE]):
        X_WO = planner.scene.X_WG(q) @ task.grasp.X_GO
        # The recess has 1 mm to spare all around.
        aside = X_WO.translation()[:2] - GOAL.translation()[:2]
        assert np.linalg.norm(aside) < 0.7e-3
        assert axis_angle(X_WO, UP) < 0.01


def test_all_motions_keep_clear(planner, posed):
    _, task = posed
    scene = planner.scene
    for mode in MOVING:
        held = mode in HELD
        scene.SetFingers(task.grasp.fingers_closed if held else task.grasp.fingers_open)
        for q in samples(task.motions[mode]):
            clearance = scene.clearance(q)
            # Rounded corners of timed paths use up some of the margin, not all.
            assert clearance.distance > 0.0, (mode, str(clearance))


def test_the_carried_object_hits_nothing(planner, posed):
    _, task = posed
    scene = planner.scene
    scene.SetFingers(task.grasp.fingers_closed)
    with scene.holding(CYLINDER, task.grasp.X_GO, margin=-0.003):
        for q in samples(task.motions[Mode.TRANSFER]):
            assert scene.clearance(q).spare > 0.0


@pytest.mark.parametrize(
    ("X_WO", "failure", "words"),
    [
        (at(0.265, lean=90.0, off=45.0), Failure.OUT_OF_REACH, "degrees across"),
        (at(0.265, lean=90.0, off=90.0), Failure.OUT_OF_REACH, "degrees across"),
        (at(0.33, lean=90.0), Failure.OUT_OF_REACH, "from above"),
        (at(0.33, lean=45.0, off=180.0), Failure.BLOCKED, "table"),
        (at(0.33, lean=45.0, off=90.0), Failure.BLOCKED, "table"),
        (at(0.6), Failure.OUT_OF_REACH, "mm"),
    ],
)
def test_a_failure_gives_its_reason(planner, X_WO, failure, words):
    result = planner.plan(planner.q_home, X_WO, CYLINDER, GOAL)
    assert_fails(result, failure, words)


def exactly(scene, q, p_GT):
    """Return the five-joint task at the posture `q`: the tip, and the pads' axis."""
    X_WG = scene.X_WG(q)
    axis = AxisTarget(UP, X_WG.rotation().matrix()[:, 2], angle=0.0)
    return HandTarget(X_WG @ p_GT, axes=(axis,), p_GT=p_GT, position_tolerance=0.0)


def least_gain(scene, q, p_GT):
    """Return the least singular value of the task's Jacobian [m/rad, rad/rad]."""
    J = scene.jacobian(q, p_GT)
    across = scene.X_WG(q).rotation().matrix()[:, :2]
    return np.linalg.svd(np.vstack([J[:3], across.T @ J[3:]]))[1][-1]


fives = st.lists(st.floats(-1.0, 1.0), min_size=5, max_size=5).map(np.array)


@settings(max_examples=60)
@given(fives, fives)
def test_both_solvers_agree_on_the_five_joint_task(planner, where, aside):
    scene, p_GT = planner.scene, planner.hand.p_GT
    middle, half = 0.5 * (scene.upper + scene.lower), 0.5 * (scene.upper - scene.lower)
    # Starts stay within the limits, and away from singular postures.
    q = middle + (half - 0.15) * where
    assume(least_gain(scene, q, p_GT) > 0.05)
    target, start = exactly(scene, q, p_GT), q + 0.1 * aside

    program = solve_inverse_kinematics(
        scene, target, q_nominal=start, check_clearance=False
    )
    followed = follow(scene, target, start)
    assert isinstance(program, IkSolution)
    assert followed is not None
    axis_W = target.axes[0].direction_W
    for solution in (program.q, followed):
        X_WG = scene.X_WG(solution)
        np.testing.assert_allclose(X_WG @ p_GT, target.p_WT, atol=1e-6)
        z = X_WG.rotation().matrix()[:, 2]
        np.testing.assert_allclose(z, axis_W, atol=1e-6)


def test_the_opposite_of_an_exact_axis_is_no_solution(planner):
    scene, p_GT = planner.scene, planner.hand.p_GT
    target = exactly(scene, np.deg2rad([0.0, 0.0, 0.0, -70.0, 5.0]), p_GT)
    # From here, the opposite is nearer.
    start = np.deg2rad([0.0, 0.0, 0.0, 110.0, 5.0])
    z = scene.X_WG(start).rotation().matrix()[:, 2]
    assert z @ target.axes[0].direction_W < -0.9
    found = solve_inverse_kinematics(
        scene, target, q_nominal=start, check_clearance=False
    )
    assert isinstance(found, IkSolution)
    z = scene.X_WG(found.q).rotation().matrix()[:, 2]
    np.testing.assert_allclose(z, target.axes[0].direction_W, atol=1e-6)
