"""The motions of two arms that carry together: a closed chain, level, within limits."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from drake_srg.common.geometry import ConvexPieces
from drake_srg.common.srg_geometry import SRG
from drake_srg.planning.carrying.motions import (
    CarryTaskPlanner,
    PairGrasp,
    aligned,
    end_walls,
    object_path,
)
from drake_srg.planning.motion.limits import MotionLimits
from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.scenario import load_scenario
from drake_srg.station.planners import MakeCarryPlanner, goal_pose, pick_task
from drake_srg.types import Box, Failure, Mode
from planning.pick_and_place.kitchen_task import assert_a_cycle

X_WO = RigidTransform(RollPitchYaw(0.0, 0.0, 0.08), [0.44, 0.2, 0.0])
CARRIED = (Mode.LIFT, Mode.TRANSFER, Mode.PLACE)


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("carry_together")


@pytest.fixture(scope="module")
def shape(scenario):
    return pick_task(scenario).shape


@pytest.fixture(scope="module")
def planner(scenario):
    found = MakeCarryPlanner(scenario)._modes[Mode.IDLE].replanner._task_planner
    assert isinstance(found, CarryTaskPlanner)
    return found


@pytest.fixture(scope="module")
def goal(scenario, shape):
    return goal_pose(scenario, shape)


@pytest.fixture(scope="module")
def plan(planner, shape, goal):
    found = planner.plan(planner.q_home, X_WO, shape, goal)
    assert not isinstance(found, PlanningFailure), found.message
    return found


def test_both_hands_keep_their_places_on_an_object_that_stays_level(planner, plan):
    grasp = plan.grasp
    for mode in CARRIED:
        motion = plan.motions[mode]
        for t in np.linspace(0.0, motion.end_time(), 60):
            hands = planner.X_WGs(motion.value(t)[:, 0])
            first, second = (
                X @ X_GO for X, X_GO in zip(hands, grasp.X_GOs, strict=True)
            )
            apart = first.translation() - second.translation()
            assert np.linalg.norm(apart) < 1e-4
            for X in (first, second):
                assert X.rotation().matrix()[2, 2] > np.cos(np.deg2rad(0.05))


def test_the_object_goes_from_where_it_was_to_its_goal_along_the_world(
    planner, plan, goal
):
    ends = [
        planner.X_WG(plan.motions[mode].value(t)[:, 0]) @ plan.grasp.X_GOs[0]
        for mode, t in ((Mode.LIFT, 0.0), (Mode.PLACE, np.inf))
    ]
    assert ends[0].IsNearlyEqualTo(X_WO, 3e-3)
    pressed = goal.translation() - [0, 0, planner.config.press_depth]
    np.testing.assert_allclose(ends[1].translation(), pressed, atol=1e-4)
    np.testing.assert_allclose(ends[1].rotation().matrix(), np.eye(3), atol=3e-3)


def test_motions_follow_one_another_and_keep_the_limits(planner, plan):
    assert_a_cycle(planner, plan)
    most = np.tile(MotionLimits.of_plant(planner.scene).velocity, 2)
    for motion in plan.motions.values():
        for t in np.linspace(0.0, motion.end_time(), 50):
            assert np.all(np.abs(motion.EvalDerivative(t, 1)[:, 0]) <= 1.001 * most)


def test_a_plan_leaves_the_scenes_as_they_were(planner, shape, goal):
    before = [arm.scene.positions(np.zeros(7)) for arm in planner.pair.arms]
    planner.plan(planner.q_home, X_WO, shape, goal)
    after = [arm.scene.positions(np.zeros(7)) for arm in planner.pair.arms]
    np.testing.assert_array_equal(before, after)


def test_reasons_name_the_arm_and_the_obstacle(planner, shape, goal):
    away = RigidTransform([-0.6, 0.2, 0.0]) @ X_WO
    far = planner.plan(planner.q_home, away, shape, goal)
    assert far.failure in (Failure.OUT_OF_REACH, Failure.BLOCKED)
    assert far.message.startswith(("left", "right"))
    wall = (Box([0.1, 0.1, 0.6]), RigidTransform([0.45, -0.05, 0.3]))
    blocked = planner.plan(planner.q_home, X_WO, shape, goal, [wall])
    assert blocked.failure is Failure.BLOCKED
    assert "transfer" in blocked.message


def test_a_place_is_planned_from_where_the_object_is_seen(planner, plan, shape, goal):
    q = plan.motions[Mode.TRANSFER].value(np.inf)[:, 0]
    shift = np.array([0.004, -0.003, 0.002])
    seen = RigidTransform(shift) @ planner.X_WG(q) @ plan.grasp.X_GOs[0]
    held = planner.regrasped(plan.grasp, q, seen)
    found = planner.plan_place(q, held, shape, goal)
    end = found.motions[Mode.PLACE]
    last = planner.X_WG(end.value(end.end_time())[:, 0]) @ held.X_GOs[0]
    assert np.linalg.norm((last.translation() - goal.translation())[:2]) < 1e-4


def test_both_hands_must_hold(plan):
    grasp = plan.grasp
    assert isinstance(grasp, PairGrasp)
    held = [grasp.base_angle] * 2 + [grasp.tip_angle] * 2
    empty = [1.9, 1.9, 0.0, 0.0]
    near = np.zeros(8)
    assert grasp.holds(np.array([*held, *held]), near)
    assert not grasp.holds(np.array([*held, *empty]), near)
    assert not grasp.holds(np.array([*empty, *held]), near)


def test_the_bases_sensors_keep_a_wall_that_creeps_in_the_hands(planner, shape):
    """If a base link lost the wall, Algorithm 1 would make the grip jump.

    Crates of up to 2 kg creep down by up to 2 mm on the longest way.
    """
    wall = end_walls(shape)[0]
    ends = SRG.hinge_x + SRG.base_length
    found = wall.grasps(planner.hand)
    assert found
    for grasp in found:
        top = grasp.X_GO @ np.array([0.0, 0.0, 0.5 * wall.box.size[2]])
        assert top[0] + 0.002 < ends
        assert top[0] > SRG.palm_face_x + planner.scene.step  # clear of the palm


def test_end_walls_are_found_and_odd_ones_refused(shape):
    first, second = end_walls(shape)
    assert first.X_OE.translation()[0] == pytest.approx(-0.325)
    assert second.X_OE.translation()[0] == pytest.approx(0.325)
    assert first.box.size == pytest.approx([0.05, 0.26, 0.1])
    order = sorted(range(len(shape.pieces)), key=lambda i: shape.pieces[i][:, 0].mean())
    low = list(shape.pieces)
    low[order[0]] = low[order[0]] * [1.0, 1.0, 0.5]
    assert end_walls(ConvexPieces(tuple(low))) is None
    assert end_walls(Box([0.7, 0.26, 0.1])) is None


@given(st.floats(-3.1, 3.1), st.floats(-0.5, 0.5), st.floats(0.0, 0.3))
def test_an_object_path_is_straight_and_even(yaw, y, z):
    start = RigidTransform(RotationMatrix.MakeZRotation(yaw), [0.1, 0.2, 0.0])
    end = RigidTransform([0.3, y, z])
    path = [start, *object_path(start, end)]
    assert path[-1].IsNearlyEqualTo(end, 1e-9)
    steps = np.diff([X.translation() for X in path], axis=0)
    np.testing.assert_allclose(steps, np.broadcast_to(steps[0], steps.shape), atol=1e-9)
    assert np.linalg.norm(steps[0]) <= 0.02 + 1e-9


@given(st.floats(-3.1, 3.1))
def test_the_goal_turns_an_object_by_a_quarter_turn_at_most(yaw):
    X = RigidTransform(RotationMatrix.MakeZRotation(yaw), [0.0, 0.0, 0.0])
    goal = aligned(RigidTransform([0.4, 0.1, 0.0]), X)
    turn = (goal.rotation().inverse() @ X.rotation()).ToAngleAxis().angle()
    assert abs(turn) <= 0.5 * np.pi + 1e-9
    np.testing.assert_array_equal(goal.translation(), [0.4, 0.1, 0.0])
