"""The motions of a handover: who reaches what, and that the arms keep clear."""

import copy

import numpy as np
import pytest
from pydrake.math import RigidTransform

from drake_srg.planning.handover.config import HandoverMode
from drake_srg.planning.handover.motions import GIVER, RECEIVER, taking_grasps
from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.planning.motion.trajectories import motion_samples
from drake_srg.scenario import load_scenario, robot_arms
from drake_srg.station.planners import MakeHandoverPlanner, MakeTaskPlanner, goal_pose
from drake_srg.types import Cylinder, Failure, Mode
from planning.pick_and_place.kitchen_task import assert_fails, assert_joined, ends
from planning.planning_world import MOVING

BOTTLE = Cylinder(0.025, 0.21)
START = RigidTransform([0.0, -0.48, 0.105])


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("handover")


@pytest.fixture(scope="module")
def system(scenario):
    return MakeHandoverPlanner(scenario)


@pytest.fixture(scope="module")
def planner(system):
    return system._modes[HandoverMode.PULL].replanner.both


@pytest.fixture(scope="module")
def goal(scenario):
    return goal_pose(scenario, BOTTLE)


@pytest.fixture(scope="module")
def plan(planner, goal):
    found = planner.plan(planner.q_home, START, BOTTLE, goal)
    assert not isinstance(found, PlanningFailure), found.message
    return found


def test_the_receiver_waits_with_its_fingers_as_open_as_the_grasp_needs(planner, plan):
    """Opening on the way, the fingers would sweep unchecked space."""
    waiting = planner.waiting_fingers(BOTTLE)
    needed = plan.receiver.grasp.fingers_open
    assert waiting.keys() == needed.keys()
    # Grasps differ a little. Within 0.05 rad, a fingertip is within the hand's margin.
    assert all(abs(waiting[name] - needed[name]) < 0.05 for name in needed)


def test_only_the_giver_reaches_the_object_and_only_the_receiver_the_goal(
    scenario, goal
):
    near = {
        "left": RigidTransform([0.0, 0.48, 0.105]),
        "right": RigidTransform([1.1, 0.48, 0.105]),
    }
    for arm, there, elsewhere in zip(
        robot_arms(scenario), (START, goal), (goal, START), strict=True
    ):
        alone = MakeTaskPlanner(scenario, arm)
        reached = alone.plan(alone.q_home, there, BOTTLE, near[arm.name])
        assert not isinstance(reached, PlanningFailure), (arm.name, reached.message)
        failed = alone.plan(alone.q_home, elsewhere, BOTTLE, near[arm.name])
        assert_fails(failed, Failure.OUT_OF_REACH)


def test_motions_keep_clear_of_the_other_arm_where_that_is(planner, plan):
    giver, receiver = planner, planner.receiver
    q_met = plan.motions[Mode.PLACE].value(100.0)[:, 0]
    q_take = plan.receiver.motions[HandoverMode.PULL].value(0.0)[:, 0]
    took, gave = plan.receiver.grasp, plan.grasp
    for context, scene, fingers, motions, modes in (
        (
            planner.pair.beside(RECEIVER, q_met, gave.fingers_closed),
            receiver.scene,
            took.fingers_open,
            plan.receiver.motions,
            (HandoverMode.APPROACH, HandoverMode.REACH),
        ),
        (
            planner.pair.beside(GIVER, q_take, took.fingers_closed),
            giver.scene,
            gave.fingers_open,
            plan.motions,
            (HandoverMode.WITHDRAW, HandoverMode.CLEAR),
        ),
    ):
        with context:
            scene.SetFingers(fingers)
            for mode in modes:
                samples = motion_samples(scene, motions[mode])
                assert scene.first_hit(samples, 1e-3) is None, mode


def test_motions_follow_one_another_without_a_jump(planner, plan):
    receiver = plan.receiver.motions
    leaving = (HandoverMode.WITHDRAW, HandoverMode.CLEAR)
    order = [plan.motions[m] for m in (*MOVING[:5], *leaving)]
    taking = [receiver[m] for m in (HandoverMode.APPROACH, HandoverMode.REACH)]
    carrying = [receiver[m] for m in MOVING[2:]]
    pull = receiver[HandoverMode.PULL]
    assert_joined(planner.q_home, order)
    home = planner.receiver.q_home
    assert_joined(home, [*taking, *carrying])
    assert_joined(home, [*taking, pull], ends(pull)[1])


def test_the_pull_is_straight_down_and_slow(planner, plan):
    pull, config = plan.receiver.motions[HandoverMode.PULL], planner.config
    scene, end = planner.receiver.scene, pull.end_time()
    start, over = (scene.X_WG(pull.value(t)[:, 0]) for t in (0.0, end))
    moved = over.translation() - start.translation()
    np.testing.assert_allclose(moved, [0.0, 0.0, -config.pull_distance], atol=1e-4)
    assert end >= config.pull_distance / config.pull_speed


def test_hands_take_different_ends(planner, plan):
    height = BOTTLE.length / 2
    for grasp in taking_grasps(planner.receiver.hand, BOTTLE, 0.1):
        # Where the palm's x meets the axis: 0.1 m above the lower end.
        along = -grasp.p_GO[2] / grasp.axis_G[2]
        assert along == pytest.approx(0.1 - height)
        assert grasp.p_GO[1] == 0.0
    assert plan.grasp.axis_G @ [1.0, 0.0, 0.0] == pytest.approx(-1.0)


def test_what_the_giver_does_not_reach_is_told_at_once(planner, goal):
    far = RigidTransform([1.1, -0.5, 0.105])
    failed = planner.plan(planner.q_home, far, BOTTLE, goal)
    assert_fails(failed, Failure.OUT_OF_REACH)
    assert failed.picking


def test_what_the_receiver_does_not_reach_is_told(planner):
    far = RigidTransform([0.0, 0.6, 0.105])
    failed = planner.plan(planner.q_home, START, BOTTLE, far)
    assert_fails(failed, Failure.OUT_OF_REACH)


@pytest.mark.parametrize("force", [0.0, 3.0, 8.0])
def test_a_pull_is_felt_as_the_force_that_it_is(system, planner, force):
    pull, q = system._modes[HandoverMode.PULL], planner.q_home + 0.1
    jacobian = planner.scene.jacobian(q)
    memory = copy.copy(system.state(system.CreateDefaultContext()).memory)
    memory.torque_before = np.arange(7.0)
    memory.torque = memory.torque_before + jacobian.T @ [0, 0, -force, 0, 0, 0]
    assert pull.felt(memory, q) == pytest.approx(force, abs=1e-9)


def test_another_arm_is_an_obstacle_only_while_it_is_there(planner):
    scene, q = planner.receiver.scene, planner.receiver.q_home

    assert scene.is_free(q)
    # The giver's hand in the receiver's: the receiver's home, seen from its own base.
    reaching = np.array([0.0, 0.9, 0.0, -0.4, 0.0, 0.4, 0.0])
    before = scene.positions(q)
    with planner.pair.beside(RECEIVER, reaching, {}):
        assert np.any(scene.positions(q) != before)
        assert scene.clearance(q, 1.0).spare < 1.0
    np.testing.assert_array_equal(scene.positions(q), before)
