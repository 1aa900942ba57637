"""The interaction matrix and its damped inverse.

Twists of the hand and steps of the joints.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.planning.servoing.hand_motion import (
    behind,
    damped_solution,
    hand_twist,
    image_displacement,
    interaction_matrix,
    limited,
)
from planning.servoing.ideal_hand import HOME, arm

within = st.floats(-0.5, 0.5)
seeds = st.integers(0, 2**32 - 1)
CORNERS = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1.0]])


def image(p_C):
    return p_C[:, :2] / p_C[:, 2:]


def points(rng, count=4):
    return np.column_stack(
        [rng.uniform(-0.2, 0.2, (count, 2)), rng.uniform(0.2, 0.6, count)]
    )


@given(seeds)
def test_the_matrix_is_the_derivative_of_the_image(seed):
    rng = np.random.default_rng(seed)
    p_C, v = points(rng), rng.uniform(-1.0, 1.0, 3)
    step = 1e-6
    # Of points at rest, seen by a camera that moves.
    difference = image(p_C - step * v) - image(p_C + step * v)
    expected = difference.reshape(-1) / (2.0 * step)
    found = interaction_matrix(image(p_C), p_C[:, 2]) @ v
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6)


@given(seeds)
def test_a_solution_is_exact_where_nothing_is_lost_and_bounded_anywhere(seed):
    rng = np.random.default_rng(seed)
    matrix, b = rng.normal(size=(8, 3)), rng.normal(size=8)
    matrix *= 10.0 ** rng.uniform(-6, 2, 3)
    least = 10.0 ** rng.uniform(-4, 0)
    found = damped_solution(matrix, b, least)
    assert np.linalg.norm(found.x) <= np.linalg.norm(b) / least * (1 + 1e-9)
    if found.least >= least:
        exact = np.linalg.lstsq(matrix, b, rcond=None)[0]
        np.testing.assert_allclose(found.x, exact, rtol=1e-6, atol=1e-9)


def test_a_singular_matrix_gives_a_finite_solution_and_says_so():
    found = damped_solution(np.zeros((8, 3)), np.ones(8), 0.1)
    assert found.least == 0.0
    np.testing.assert_array_equal(found.x, 0.0)
    assert damped_solution(np.eye(2, 3), np.ones(2), 0.1).least == 0.0


@settings(max_examples=30)
@given(st.tuples(within, within, within))
def test_displacements_lead_to_the_goal(away):
    """From random starts, repeated displacements reach the goal."""
    goal = np.column_stack([0.05 * CORNERS, [0.30, 0.32, 0.34, 0.31]])
    p_C = goal - 0.2 * np.array(away)
    for _ in range(30):
        found = image_displacement(image(p_C), p_C[:, 2], image(goal), goal[:, 2], 1e-3)
        p_C = p_C - 0.5 * found.x
    np.testing.assert_allclose(p_C, goal, atol=1e-4)


def test_points_in_one_place_do_not_determine_the_depth():
    same = np.zeros((4, 2))
    found = image_displacement(same, np.full(4, 0.3), same, np.full(4, 0.3), 0.2)
    assert found.least < 1e-9


FUNNEL = {"standoff": 0.06, "alignment": 0.004, "funnel": 6.0}
AXIS = np.array([0.0, 0.0, -1.0])


def random_pose(rng, most=0.5):
    axis = rng.normal(size=3)
    turn = AngleAxis(rng.uniform(0, 2.0), axis / np.linalg.norm(axis))
    return RigidTransform(RotationMatrix(turn), rng.uniform(-most, most, 3))


@settings(max_examples=10)
@given(seeds)
def test_the_error_decays_in_position_and_orientation(seed):
    rng = np.random.default_rng(seed)
    X, goal = random_pose(rng), random_pose(rng)
    period, gain = 0.01, 4.0
    for _ in range(300):
        twist = hand_twist(X, goal, gain=gain, speed=10.0, turning=10.0)
        angle = np.linalg.norm(twist[3:])
        axis = twist[3:] / angle if angle else np.array([1.0, 0, 0])
        turn = RotationMatrix(AngleAxis(period * angle, axis))
        p = X.translation() + period * twist[:3]
        X = RigidTransform(turn @ X.rotation(), p)
    left = np.exp(-gain * 3.0)
    assert np.linalg.norm(X.translation() - goal.translation()) < 2.0 * left
    assert (X.rotation().inverse() @ goal.rotation()).ToAngleAxis().angle() < 4.0 * left


@given(seeds, st.floats(0.01, 1.0), st.floats(0.01, 1.0))
def test_no_limit_is_exceeded(seed, speed, turning):
    rng = np.random.default_rng(seed)
    twist = hand_twist(
        random_pose(rng), random_pose(rng), gain=5.0, speed=speed, turning=turning
    )
    assert np.linalg.norm(twist[:3]) <= speed * (1 + 1e-12)
    assert np.linalg.norm(twist[3:]) <= turning * (1 + 1e-12)
    np.testing.assert_array_equal(limited(np.ones(3), 10.0), np.ones(3))


@given(st.floats(0.0, 0.1), st.floats(-0.1, 0.1))
def test_the_hand_stays_behind_until_it_is_aligned(aside, ahead):
    back = behind(np.array([aside, 0.0, ahead]), AXIS, **FUNNEL)
    assert 0.0 <= back <= FUNNEL["standoff"]
    assert (back == 0.0) == (aside <= FUNNEL["alignment"])
    # The farther aside, the farther behind, whatever the distance to the goal.
    assert back <= behind(np.array([aside + 0.01, 0.0, 0.0]), AXIS, **FUNNEL)


def test_the_jacobian_is_the_derivative_of_the_hand_pose():
    rng = np.random.default_rng(3)
    for _ in range(5):
        q, dq = rng.uniform(-1, 1, 7), 1e-6 * rng.normal(size=7)
        before, after = arm().X_WG(q - dq), arm().X_WG(q + dq)
        twist = arm().jacobian(q) @ dq
        move = 0.5 * (after.translation() - before.translation())
        np.testing.assert_allclose(twist[:3], move, atol=1e-11)
        turn = (after.rotation() @ before.rotation().inverse()).ToAngleAxis()
        half_turn = 0.5 * turn.angle() * turn.axis()
        np.testing.assert_allclose(twist[3:], half_turn, atol=1e-9)


def step(q, twist):
    return arm().step(q, twist, 0.01, 0.05)


@settings(max_examples=50)
@given(seeds)
def test_joints_keep_their_limits_whatever_the_twist(seed):
    rng = np.random.default_rng(seed)
    q = rng.uniform(arm().lower, arm().upper)
    made = step(q, 10.0 ** rng.uniform(-3, 3) * rng.normal(size=6))
    assert np.all(np.abs(made.q - q) <= 0.01 * arm().speed * (1 + 1e-9))
    assert np.all((arm().lower <= made.q) & (made.q <= arm().upper))


def test_a_twist_within_the_limits_is_made_in_full():
    twist = np.array([0.1, -0.05, 0.08, 0.0, 0.1, 0.0])
    made = step(HOME, twist)
    assert made.achieved == pytest.approx(1.0, abs=1e-9)
    moved = arm().jacobian(HOME) @ (made.q - HOME)
    np.testing.assert_allclose(moved, 0.01 * twist, atol=1e-12)


def test_a_stretched_arm_says_that_it_gets_no_further():
    outwards = np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0])
    made = step(np.zeros(7), outwards)  # straight up
    assert made.achieved < 0.1
    assert np.max(np.abs(made.q)) < 0.01
