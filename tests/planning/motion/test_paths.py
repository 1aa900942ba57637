from __future__ import annotations

import itertools

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.planning.motion.failure import PlanningFailure
from drake_srg.planning.motion.hand_target import AxisTarget, HandTarget
from drake_srg.planning.motion.inverse_kinematics import solve_inverse_kinematics
from drake_srg.planning.motion.paths import (
    plan_cartesian_path,
    plan_joint_path,
)
from drake_srg.types import Box, Failure, Sphere

DOWN = RotationMatrix(np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]))
WALL = Box((0.3, 0.03, 0.5))
X_WALL = RigidTransform([0.6, 0.0, 0.25])


@pytest.fixture(scope="module")
def sides(iiwa):
    """Return postures left and right of a wall."""
    home = np.array([0.0, -0.1, 0.0, -1.9, 0.0, 1.3, 0.0])
    return [
        solve_inverse_kinematics(
            iiwa, HandTarget(np.array([0.55, y, 0.3]), DOWN), q_nominal=home
        ).q
        for y in (-0.3, 0.3)
    ]


def test_a_free_straight_line_is_the_path(iiwa, sides):
    path = plan_joint_path(iiwa, *sides)
    np.testing.assert_array_equal(path, sides)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_the_path_around_a_wall_is_free_and_repeatable(iiwa, sides, seed):
    with iiwa.standing(WALL, X_WALL):
        path = plan_joint_path(iiwa, *sides, seed=seed)
        again = plan_joint_path(iiwa, *sides, seed=seed)
        # Between two checked configurations nothing comes closer than contact.
        fine = [q for a, b in itertools.pairwise(path) for q in
                a + np.linspace(0, 1, 200)[:, None] * (b - a)]  # fmt: skip
        assert all(iiwa.clearance(q).distance > 0.0 for q in fine)
    assert len(path) > 2
    np.testing.assert_array_equal(path[[0, -1]], sides)
    np.testing.assert_array_equal(path, again)
    assert np.all((path >= iiwa.lower) & (path <= iiwa.upper))


def test_a_blocked_goal_is_named(iiwa, sides):
    with iiwa.standing(Sphere(0.1), iiwa.X_WG(sides[1])):
        failure = plan_joint_path(iiwa, *sides)
    assert isinstance(failure, PlanningFailure)
    assert failure.message.startswith("the goal is not free")
    assert "obstacle" in failure.clearance.bodies
    assert failure.failure is Failure.BLOCKED


def test_a_failed_search_names_what_is_on_the_straight_line(iiwa, sides):
    with iiwa.standing(WALL, X_WALL):
        failure = plan_joint_path(iiwa, *sides, max_iterations=0)
    assert isinstance(failure, PlanningFailure)
    assert "no path in 0 iterations" in failure.message
    assert "obstacle" in failure.clearance.bodies


def test_the_hand_goes_straight_and_turns_evenly(iiwa, sides):
    X_start = iiwa.X_WG(sides[0])
    target = HandTarget(
        X_start.translation() + np.array([0.05, 0.08, -0.03]),
        X_start.rotation() @ RotationMatrix.MakeXRotation(0.6),
    )
    path = plan_cartesian_path(iiwa, sides[0], target)
    np.testing.assert_array_equal(path[0], sides[0])
    way = target.p_WT - X_start.translation()
    for q_1, q_2 in itertools.pairwise(path):
        # Half way between waypoints the hand is furthest from its line. The sagitta of
        # 0.1 rad over the 0.2 m between wrist and hand is 0.25 mm.
        X_WG = iiwa.X_WG((q_1 + q_2) / 2)
        offset = X_WG.translation() - X_start.translation()
        share = (offset @ way) / (way @ way)
        assert 0.0 < share < 1.0
        assert np.linalg.norm(offset - share * way) < 5e-4
        turn = (X_start.rotation().inverse() @ X_WG.rotation()).ToAngleAxis()
        assert turn.angle() == pytest.approx(0.6 * share, abs=5e-3)
    assert target.distance(iiwa.X_WG(path[-1])) < 2e-6


def test_an_axis_is_kept_while_the_hand_moves(iiwa, sides):
    axis = AxisTarget(np.array([1.0, 0, 0]), np.array([0.0, 0, -1.0]), 0.05)
    start = iiwa.X_WG(sides[0]).translation()
    target = HandTarget(start + np.full(3, 0.1), axes=(axis,))
    path = plan_cartesian_path(iiwa, sides[0], target)
    for q in path:
        assert target.angle_violation(iiwa.X_WG(q)) < 1e-5


def test_a_line_into_the_table_is_blocked(iiwa, sides):
    target = HandTarget.from_pose(iiwa.X_WG(sides[0])).shifted(np.array([0, 0, -0.25]))
    failure = plan_cartesian_path(iiwa, sides[0], target)
    assert isinstance(failure, PlanningFailure)
    assert "table" in failure.clearance.bodies
    assert "along the line" in failure.message


def test_a_line_out_of_reach_fails_as_out_of_reach(iiwa, sides):
    target = HandTarget.from_pose(iiwa.X_WG(sides[0])).shifted(np.array([0.6, 0, 0]))
    failure = plan_cartesian_path(iiwa, sides[0], target)
    assert isinstance(failure, PlanningFailure)
    assert failure.failure is Failure.OUT_OF_REACH


def test_a_target_where_the_hand_is_gives_a_path(iiwa, sides):
    path = plan_cartesian_path(
        iiwa, sides[0], HandTarget.from_pose(iiwa.X_WG(sides[0]))
    )
    np.testing.assert_allclose(path, [sides[0]] * 2, atol=1e-6)


def test_a_line_is_checked_once_all_along(iiwa, sides, monkeypatch):
    checked = []
    is_free = iiwa.is_free
    monkeypatch.setattr(iiwa, "is_free", lambda q: checked.append(q) or is_free(q))
    target = HandTarget.from_pose(iiwa.X_WG(sides[0])).shifted(np.array([0, 0, 0.1]))
    path = plan_cartesian_path(iiwa, sides[0], target)
    np.testing.assert_array_equal(checked, iiwa.samples(path))


def test_what_blocks_a_line_before_its_end_comes_first(iiwa, sides):
    down = HandTarget.from_pose(iiwa.X_WG(sides[0])).shifted(np.array([0, 0, -2.0]))
    failure = plan_cartesian_path(iiwa, sides[0], down)
    assert failure.failure is Failure.BLOCKED
    assert float(failure.message.split()[0]) < 0.5
