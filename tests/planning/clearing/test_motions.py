"""How the arm gets to a grasp and away, with the scenario's own arm and bin."""

import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform

from drake_srg.planning.clearing.motions import reach_with_hand_down, turned_to
from drake_srg.planning.grasps.top_grasps import palm_pose
from drake_srg.planning.motion.inverse_kinematics import (
    HandTarget,
    solve_inverse_kinematics,
)
from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.scenario import load_scenario
from drake_srg.station.clearing import MakeClearingPlanner
from drake_srg.station.perception import clearing_destinations
from drake_srg.station.planners import own_scene
from drake_srg.types import Mode
from planning.clearing.fake_table import grasp_at, moved, table


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("clear_table", overrides=["clutter.count=1"])


def test_an_iiwa_reaches_the_middle_of_the_table_but_not_its_own_foot(scenario):
    home = np.array(scenario.arm.home)
    reach = reach_with_hand_down(own_scene(scenario), home, np.array([0.6, 0.0, 0.2]))
    assert reach.center == pytest.approx((0.0, 0.0))
    assert 0.3 < reach.least < 0.5
    assert 0.75 < reach.most < 0.9
    assert reach.contains(np.array([[0.6, 0.0], [0.1, 0.0], [0.9, 0.3]])).tolist() == [
        True,
        False,
        False,
    ]


def test_what_is_out_of_reach_itself_has_no_ring(scenario):
    home = np.array(scenario.arm.home)
    far = np.array([1.5, 0.0, 0.2])
    assert reach_with_hand_down(own_scene(scenario), home, far) is None


@settings(max_examples=20, deadline=None)
@given(azimuth=st.floats(-2.0, 2.0), radius=st.floats(0.4, 0.8))
def test_an_arm_that_is_turned_to_a_place_has_its_hand_before_it(
    scenario, azimuth, radius
):
    scene, home = own_scene(scenario), np.array(scenario.arm.home)
    place = scene.p_WA[:2] + radius * np.array([np.cos(azimuth), np.sin(azimuth)])
    turned = turned_to(scene, home, place)
    hand = scene.X_WG(turned).translation() - scene.p_WA
    assert np.arctan2(hand[1], hand[0]) == pytest.approx(azimuth, abs=1e-6)
    np.testing.assert_array_equal(turned[1:], home[1:])


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_an_arm_at_its_limit_turns_the_other_way_round(scenario, side):
    scene, home = own_scene(scenario), np.array(scenario.arm.home)
    behind = side * np.radians(145.0)
    place = scene.p_WA[:2] + 0.6 * np.array([np.cos(behind), -np.sin(behind)])
    turned = turned_to(scene, np.array([behind, *home[1:]]), place)
    hand = scene.X_WG(turned).translation() - scene.p_WA
    assert np.arctan2(hand[1], hand[0]) == pytest.approx(-behind, abs=1e-6)
    assert scene.lower[0] <= turned[0] <= scene.upper[0]


@pytest.mark.parametrize("name", ["clear_table_fast", "sort_table", "row_table"])
def test_the_arm_aside_is_far_from_where_loads_go(name):
    scenario = load_scenario(name, seed=1)
    planner = MakeClearingPlanner(scenario).planner
    scene = planner.motions.scene
    scene.SetFingers({})
    p_WG = scene.X_WG(planner.q_aside).translation()
    p_over = scene.X_WG(planner.motions.q_over).translation()
    assert p_WG[2] == pytest.approx(p_over[2], abs=1e-6)
    assert scene.is_free(planner.q_aside)
    for place in clearing_destinations(scenario):
        assert np.linalg.norm(p_WG[:2] - place.middle) > 0.5


PLACE = (0.55, 0.05)


@pytest.fixture(scope="module")
def motions():
    scenario = load_scenario("clear_table", overrides=["clutter.count=1"])
    return MakeClearingPlanner(scenario).planner.motions


@pytest.mark.parametrize(
    "p_W", [(0.5, 0.0, 0.175), (0.3, -0.4, 0.28), (0.45, 0.3, 0.3)]
)
def test_retreats_over_the_bin_even_if_the_hand_presses_on_something(motions, p_W):
    scene = motions.scene
    fingers = grasp_at(PLACE).fingers_open
    scene.SetFingers(fingers)
    target = HandTarget.from_pose(palm_pose(np.array(p_W), 0.4))
    q = solve_inverse_kinematics(
        scene, target, q_nominal=motions.q_over, check_clearance=False
    ).q
    way = motions.plan_retreat(q, fingers)
    assert not isinstance(way, PlanningFailure), way.message
    np.testing.assert_allclose(way.value(0.0)[:, 0], q, atol=1e-6)
    np.testing.assert_allclose(way.value(1e9)[:, 0], motions.q_over, atol=1e-6)


def test_leaves_the_bin_straight_up(motions):
    scene = motions.scene
    over = HandTarget.from_pose(scene.X_WG(motions.q_over))
    target = over.shifted(np.array([0.0, 0.0, -0.15]))
    q = solve_inverse_kinematics(
        scene, target, q_nominal=motions.q_over, check_clearance=False
    ).q
    start = scene.X_WG(q).translation()
    way = motions.plan_up(q, grasp_at(PLACE).fingers_open, start[2] + 0.1)
    assert not isinstance(way, PlanningFailure), way.message
    times = np.linspace(0.0, way.end_time(), 20)
    p_WG = np.array([scene.X_WG(way.value(t)[:, 0]).translation() for t in times])
    np.testing.assert_allclose(p_WG[:, :2] - start[:2], 0.0, atol=1e-3)
    assert p_WG[-1, 2] > start[2] + 0.1
    assert np.all(np.diff(p_WG[:, 2]) > 0.0)


def test_a_hand_above_the_bin_retreats_without_going_down(motions):
    scene = motions.scene
    over = HandTarget.from_pose(scene.X_WG(motions.q_over))
    target = over.shifted(np.array([0.1, 0.1, 0.05]))
    q = solve_inverse_kinematics(
        scene, target, q_nominal=motions.q_over, check_clearance=False
    ).q
    way = motions.plan_retreat(q, {})
    assert not isinstance(way, PlanningFailure), way.message
    times = np.linspace(0.0, way.end_time(), 20)
    p_WG = np.array([scene.X_WG(way.value(t)[:, 0]).translation() for t in times])
    # Straight across, not down first: half the way down is half the way across.
    across = np.linalg.norm(p_WG[:, :2] - p_WG[0, :2], axis=1)
    assert np.interp(0.01, p_WG[0, 2] - p_WG[:, 2], across) > 0.01


@pytest.mark.parametrize(
    ("place", "yaw"),
    [((0.55, 0.07), -0.6), ((0.55, 0.35), -0.17), ((0.45, 0.35), -0.17)],
)
def test_the_arm_faces_the_grasp(motions, place, yaw):
    turned = RigidTransform(palm_pose(np.array([*place, 0.2]), yaw))
    grasp = dc.replace(grasp_at(place), X_WG=turned)
    planned = motions.plan(motions.q_home, grasp, moved(table()))
    assert not isinstance(planned, PlanningFailure), planned.message
    q = planned[Mode.GRASP].value(1e9)[:, 0]
    # An arm bent backwards would have its first joint turned by pi.
    assert q[0] == pytest.approx(np.arctan2(place[1], place[0]), abs=1.0)


def test_motions_follow_one_another(motions):
    planned = motions.plan(motions.q_home, grasp_at(PLACE), moved(table()))
    order = (Mode.PRE_GRASP, Mode.GRASP, Mode.LIFT, Mode.TRANSFER)
    q = motions.q_home
    for mode in order:
        np.testing.assert_allclose(planned[mode].value(0.0)[:, 0], q, atol=1e-6)
        q = planned[mode].value(1e9)[:, 0]
