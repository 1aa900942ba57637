"""How an empty hand gets away, with the scenario's own arm and bin."""

import numpy as np
import pytest

from drake_srg.cell.clearing import MakeClearingPlanner
from drake_srg.planning.grasps.top_grasp import palm_pose
from drake_srg.planning.motion.failure import PlanningFailure
from drake_srg.planning.motion.hand_target import HandTarget
from drake_srg.planning.motion.inverse_kinematics import solve_inverse_kinematics
from drake_srg.scenario import load_scenario
from planning.clearing.fake_table import grasp_at

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
