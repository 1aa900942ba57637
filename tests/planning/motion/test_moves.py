import dataclasses as dc
from unittest.mock import Mock

import numpy as np
import pytest
from pydrake.math import RigidTransform

from drake_srg.planning.motion.limits import MotionConfig, TipLimits
from drake_srg.planning.motion.moves import Moves
from drake_srg.planning.motion.paths import plan_joint_path
from drake_srg.planning.motion.planning_scene import NoPathError, PlanningFailure
from drake_srg.planning.motion.trajectories import STRAIGHT, PathPart
from drake_srg.types import Failure, Sphere

UP = np.array([0.0, 0.0, 1.0])
PERIOD = 0.01  # s
CONFIG = MotionConfig(lift_height=0.06, approach_distance=0.05)


@pytest.fixture(scope="module")
def moves(iiwa):
    return Moves(iiwa, np.zeros(3), CONFIG)


def moved(scene, path):
    """Return how far the hand is from where a path began, (K, 3) [m]."""
    p_WG = np.array([scene.X_WG(q).translation() for q in path])
    return p_WG - p_WG[0]


def test_up_and_down_go_straight_by_the_lift_height(iiwa, moves, home):
    up = moves.straight(home, moves.above(home))
    np.testing.assert_allclose(moved(iiwa, up)[-1], 0.06 * UP, atol=1e-6)
    down = moves.straight(up[-1], moves.below(up[-1]))
    np.testing.assert_allclose(moved(iiwa, down)[-1], -0.06 * UP, atol=1e-6)
    # Waypoints lie on the line; joint lines between them leave it by little.
    np.testing.assert_allclose(moved(iiwa, up)[:, :2], 0.0, atol=1e-6)
    higher = moves.straight(home, moves.above(home, 0.1))
    np.testing.assert_allclose(moved(iiwa, higher)[-1], 0.1 * UP, atol=1e-6)


def test_back_is_along_the_palm(iiwa, moves, home):
    ahead = iiwa.X_WG(home).rotation().matrix()[:, 0]
    back = moved(iiwa, moves.straight(home, moves.behind(home)))
    np.testing.assert_allclose(back[-1], -0.05 * ahead, atol=1e-6)


def test_lines_through_targets_are_joined(iiwa, moves, home):
    first = moves.above(home)
    second = first.shifted(np.array([0.05, 0.0, 0.0]))
    path = moves.through(home, [first, second])
    np.testing.assert_array_equal(path[0], home)
    way = moved(iiwa, path)
    np.testing.assert_allclose(way[-1], [0.05, 0.0, 0.06], atol=1e-6)
    corner = np.argmin(np.linalg.norm(way - 0.06 * UP, axis=1))
    np.testing.assert_allclose(way[corner], 0.06 * UP, atol=1e-6)


def test_a_blocked_move_raises_what_is_in_the_way(iiwa, moves, home):
    X_WO = RigidTransform(iiwa.X_WG(home).translation() + 0.3 * UP)
    with (
        iiwa.standing(Sphere(0.05), X_WO),
        pytest.raises(NoPathError, match="obstacle") as raised,
    ):
        moves.straight(home, moves.above(home, 0.3))
    assert raised.value.failure.failure is Failure.BLOCKED
    assert "obstacle" in raised.value.failure.message


def test_a_move_out_of_reach_raises_so(moves, home):
    with pytest.raises(NoPathError, match="along the line") as raised:
        moves.through(home, [moves.above(home), moves.above(home, 2.0)])
    assert raised.value.failure.failure is Failure.OUT_OF_REACH


def test_postures_are_joined_as_the_joints_please(iiwa, moves, home):
    goal = home + np.array([0.5, 0.1, 0.0, 0.1, 0.0, 0.0, 0.0])
    path = moves.joint_path(home, goal)
    np.testing.assert_array_equal(path, plan_joint_path(iiwa, home, goal))


def test_where_the_tip_is_limited_postures_are_joined_by_its_line(iiwa, home):
    limited = Moves(iiwa, np.zeros(3), MotionConfig(tip_limits=TipLimits()))
    goal = limited.straight(home, limited.above(home, 0.2))[-1]
    path = limited.joint_path(home, goal)
    np.testing.assert_array_equal(path[-1], goal)
    np.testing.assert_allclose(moved(iiwa, path)[:, :2], 0.0, atol=1e-5)
    # The joints' own line leaves that of the hand.
    direct = moved(iiwa, iiwa.samples(np.array([home, goal])))
    assert np.max(np.abs(direct[:, :2])) > 1e-3


def test_a_load_slows_the_arm(moves, home):
    path = moves.straight(home, moves.above(home))
    empty = moves.timed(path, moves.free, straight=True)
    loaded = moves.timed(path, moves.holding, straight=True)
    assert loaded.end_time() > 1.2 * empty.end_time()
    np.testing.assert_allclose(loaded.value(loaded.end_time())[:, 0], path[-1])


def test_limits_of_the_tip_are_kept_in_place_of_the_fastest_motion(iiwa, home):
    slow = TipLimits(velocity=0.02)
    limited = Moves(iiwa, np.zeros(3), MotionConfig(tip_limits=slow))
    path = limited.straight(home, limited.above(home, 0.1))
    assert limited.timed(path, limited.free).end_time() > 0.1 / 0.02


@pytest.fixture
def corner(moves, home):
    """Return a path straight up, and a path from there to the side."""
    up = moves.straight(home, moves.above(home, 0.2))
    aside = moves.joint_path(up[-1], up[-1] + np.array([0.8, *np.zeros(6)]))
    return PathPart(up, STRAIGHT), PathPart(aside)


def both_ways(moves, corner):
    """Return the motions with a rest at the corner, and those of `without_rest`."""
    apart = tuple(moves.timed_part(part, moves.free) for part in corner)
    return apart, moves.without_rest(apart, corner, moves.free, PERIOD)


def test_goes_around_a_corner_without_a_rest(iiwa, moves, corner):
    apart, (first, second) = both_ways(moves, corner)
    together = first.end_time() + second.end_time()
    assert together < sum(motion.end_time() for motion in apart) - 0.05
    assert first.end_time() / PERIOD == pytest.approx(round(first.end_time() / PERIOD))
    for order in (0, 1, 2):
        np.testing.assert_allclose(
            first.EvalDerivative(first.end_time(), order),
            second.EvalDerivative(0.0, order),
            atol=1e-9,
        )
    assert np.max(np.abs(first.EvalDerivative(first.end_time(), 1))) > 0.1
    # Up to half of its height, the hand stays on the line.
    times = np.linspace(0.0, first.end_time(), 100)
    way = moved(iiwa, [first.value(t)[:, 0] for t in times])
    low = way[:, 2] < 0.09
    assert np.any(low)
    np.testing.assert_allclose(way[low, :2], 0.0, atol=0.003)
    assert np.linalg.norm(way[-1, :2]) > 0.003


def test_rests_at_a_corner_that_cannot_be_cut(iiwa, moves, corner):
    limited = Moves(iiwa, np.zeros(3), dc.replace(CONFIG, tip_limits=TipLimits()))
    apart, motions = both_ways(limited, corner)
    assert motions is apart


def test_rests_where_no_other_motion_is_free(monkeypatch, moves, corner):
    apart = tuple(moves.timed_part(part, moves.free) for part in corner)
    blocked = NoPathError(PlanningFailure(Failure.BLOCKED, ""))
    monkeypatch.setattr(moves, "timed_part", Mock(side_effect=blocked))
    assert moves.without_rest(apart, corner, moves.free, PERIOD) is apart
