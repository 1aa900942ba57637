"""RRT-Connect with a point and a wall in the plane."""

from __future__ import annotations

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.planning.motion.inverse_kinematics import (
    AxisTarget,
    HandTarget,
)
from drake_srg.planning.motion.paths import (
    follow,
    plan_cartesian_path,
    plan_joint_path,
    rrt_connect,
    shortcut_path,
)
from drake_srg.types import Failure, Sphere
from planning.pick_and_place.kitchen_task import assert_fails

unit = st.floats(-1.0, 1.0)


@settings(max_examples=40, deadline=None)
@given(st.lists(unit, min_size=6, max_size=6))
def test_it_meets_a_near_pose_exactly_and_stays_near(iiwa, shift):
    home = np.array([0.0, -0.1, 0.0, -1.9, 0.0, 1.3, 0.0])
    turn = RotationMatrix.MakeXRotation(0.1 * shift[3]).multiply(
        RotationMatrix.MakeYRotation(0.1 * shift[4])
    )
    near = RigidTransform(turn, 0.02 * np.array(shift[:3]))
    target = HandTarget.from_pose(iiwa.X_WG(home) @ near)
    q = follow(iiwa, target, home)
    assert target.distance(iiwa.X_WG(q)) < 2e-6
    assert target.angle_violation(iiwa.X_WG(q)) == 0.0
    assert np.max(np.abs(q - home)) < 0.4


def test_it_stops_a_joint_at_its_limit_and_goes_on_with_the_others(iiwa, home):
    q = home.copy()
    q[6] = iiwa.upper[6] - 0.03
    target = HandTarget.from_pose(
        iiwa.X_WG(q) @ RigidTransform(RotationMatrix.MakeXRotation(0.03), np.zeros(3))
    )
    found = follow(iiwa, target, q)
    # Without the limit, joint 7 does nearly all of the turn about its own axis.
    assert iiwa.upper[6] - 0.021 < found[6] <= iiwa.upper[6] - 0.02 + 1e-9
    assert target.distance(iiwa.X_WG(found)) < 2e-6


def test_it_returns_none_out_of_reach(iiwa, home):
    assert follow(iiwa, HandTarget(np.array([2.0, 0.0, 0.0])), home) is None


def test_it_turns_an_axis_only_as_far_as_its_angle(iiwa, home):
    X_WG = iiwa.X_WG(home)
    tilted = X_WG.rotation().matrix()[:, 0] + np.array([0.3, 0.0, 0.0])
    axis = AxisTarget(np.array([1.0, 0.0, 0.0]), tilted / np.linalg.norm(tilted), 0.1)
    target = HandTarget(iiwa.X_WG(home).translation(), axes=(axis,))
    q = follow(iiwa, target, home)
    X_WG = iiwa.X_WG(q)
    assert target.distance(X_WG) < 2e-6
    angle = np.arccos(X_WG.rotation().matrix()[:, 0] @ axis.direction_W)
    assert angle == pytest.approx(0.1, abs=1e-4)


LOWER, UPPER = np.array([-1.0, -1.0]), np.array([1.0, 1.0])
START, GOAL = np.array([-0.8, 0.0]), np.array([0.8, 0.0])


def barrier(gap: float):
    """Return the edge test of a wall, |x| < 0.05, that ends `gap` below y = 1."""

    def is_edge_free(q1: np.ndarray, q2: np.ndarray) -> bool:
        left, right = sorted((q1, q2), key=lambda q: q[0])
        inside = np.clip([-0.05, 0.05], left[0], right[0])
        if abs(inside.sum()) > 0.1 - 1e-12 and np.ptp(inside) < 1e-12:
            return True  # on one side of the wall
        height = np.interp(inside, [left[0], right[0]], [left[1], right[1]])
        return bool(np.min(height) >= 1.0 - gap - 1e-9)

    return is_edge_free


def search(gap: float, seed: int) -> np.ndarray | None:
    scene = SimpleNamespace(
        lower=LOWER, upper=UPPER, levers=np.ones(2), is_edge_free=barrier(gap)
    )
    rng = np.random.default_rng(seed)
    return rrt_connect(scene, START, GOAL, step=0.3, max_iterations=500, rng=rng)


@pytest.mark.parametrize("seed", range(10))
def test_the_search_goes_around_the_wall(seed):
    path = search(0.3, seed)
    assert path is not None
    np.testing.assert_array_equal(path[0], START)
    np.testing.assert_array_equal(path[-1], GOAL)
    assert all(map(barrier(0.3), path[:-1], path[1:]))
    assert np.all((path >= LOWER) & (path <= UPPER))


def test_the_search_finds_nothing_without_a_gap():
    assert search(-0.1, 0) is None


def test_the_seed_determines_the_path():
    np.testing.assert_array_equal(search(0.3, 1), search(0.3, 1))
    assert not np.array_equal(search(0.3, 1), search(0.3, 2))


@pytest.mark.parametrize("seed", range(10))
def test_a_shortcut_is_free_no_longer_and_keeps_the_ends(seed):
    path = search(0.3, seed)
    short = shortcut_path(
        path, is_edge_free=barrier(0.3), attempts=50, rng=np.random.default_rng(seed)
    )
    assert all(map(barrier(0.3), short[:-1], short[1:]))
    np.testing.assert_array_equal(short[[0, -1]], path[[0, -1]])
    assert length_of(short) <= length_of(path) + 1e-12
    # Two straight lines over the wall's end are 2.13 long.
    assert length_of(short) < 1.2 * 2.13


def test_a_shortcut_of_a_free_detour_is_the_straight_line():
    detour = np.array([START, [-0.4, 0.9], [0.3, -0.7], GOAL])
    short = shortcut_path(
        detour,
        is_edge_free=lambda a, b: True,
        attempts=5,
        rng=np.random.default_rng(0),
    )
    np.testing.assert_array_equal(short, [START, GOAL])


def length_of(path: np.ndarray) -> float:
    return float(np.sum(np.linalg.norm(np.diff(path, axis=0), axis=1)))


def test_a_free_straight_line_is_the_path(iiwa, sides):
    path = plan_joint_path(iiwa, *sides)
    np.testing.assert_array_equal(path, sides)


@pytest.mark.slow
@pytest.mark.usefixtures("wall")
@pytest.mark.parametrize("seed", range(3))
def test_the_path_around_a_wall_is_free_and_repeatable(iiwa, sides, seed):
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
    assert_fails(failure, Failure.BLOCKED, "the goal is not free", "obstacle")


@pytest.mark.usefixtures("wall")
def test_a_failed_search_names_what_is_on_the_straight_line(iiwa, sides):
    failure = plan_joint_path(iiwa, *sides, max_iterations=0)
    assert_fails(failure, Failure.BLOCKED, "no path in 0 iterations", "obstacle")


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


@pytest.fixture
def moved(iiwa, sides):
    """Return a function that plans a straight line of the hand by an offset [m]."""

    def planned(*way):
        here = HandTarget.from_pose(iiwa.X_WG(sides[0]))
        return plan_cartesian_path(iiwa, sides[0], here.shifted(np.array(way)))

    return planned


def test_a_line_into_the_table_is_blocked(moved):
    assert_fails(moved(0, 0, -0.25), Failure.BLOCKED, "table", "along the line")


def test_a_line_out_of_reach_fails_as_out_of_reach(moved):
    assert_fails(moved(0.6, 0, 0), Failure.OUT_OF_REACH)


def test_a_target_where_the_hand_is_gives_a_path(moved, sides):
    np.testing.assert_allclose(moved(0, 0, 0), [sides[0]] * 2, atol=1e-6)


def test_a_line_is_checked_once_all_along(iiwa, moved, monkeypatch):
    checked = []
    is_free = iiwa.is_free
    monkeypatch.setattr(iiwa, "is_free", lambda q: checked.append(q) or is_free(q))
    np.testing.assert_array_equal(checked, iiwa.samples(moved(0, 0, 0.1)))


def test_what_blocks_a_line_before_its_end_comes_first(moved):
    failure = moved(0, 0, -2.0)
    assert failure.failure is Failure.BLOCKED
    assert float(failure.message.split()[0]) < 0.5
