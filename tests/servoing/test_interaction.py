"""The interaction matrix and its damped inverse."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.servoing.interaction import (
    damped_solution,
    image_displacement,
    interaction_matrix,
)

within = st.floats(-0.5, 0.5)
seeds = st.integers(0, 2**32 - 1)
CORNERS = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1.0]])


def image(p_C):
    return p_C[:, :2] / p_C[:, 2:]


def moved(p_C, displacement):
    """Points at rest, seen by a camera that has moved."""
    turn = displacement[3:]
    angle = np.linalg.norm(turn)
    axis = turn / angle if angle else np.array([0.0, 0.0, 1.0])
    X = RigidTransform(RotationMatrix(AngleAxis(angle, axis)), displacement[:3])
    return (X.inverse() @ p_C.T).T


def points(rng, count=4):
    return np.column_stack(
        [rng.uniform(-0.2, 0.2, (count, 2)), rng.uniform(0.2, 0.6, count)]
    )


@given(seeds)
def test_the_matrix_is_the_derivative_of_the_image(seed):
    rng = np.random.default_rng(seed)
    p_C, twist = points(rng), rng.uniform(-1.0, 1.0, 6)
    step = 1e-6
    difference = image(moved(p_C, step * twist)) - image(moved(p_C, -step * twist))
    expected = difference.reshape(-1) / (2.0 * step)
    found = interaction_matrix(image(p_C), p_C[:, 2]) @ twist
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
@given(st.tuples(within, within, within), st.floats(0.0, 0.4), seeds)
def test_displacements_lead_to_the_goal(away, angle, seed):
    """From random starts, some displacements in a row reach the goal."""
    rng = np.random.default_rng(seed)
    goal = np.column_stack([0.05 * CORNERS, [0.30, 0.32, 0.34, 0.31]])
    turn = rng.normal(size=3)
    turn *= angle / np.linalg.norm(turn)
    start = np.concatenate([0.2 * np.array(away), turn])
    p_C = moved(goal, start)
    for _ in range(30):
        found = image_displacement(
            image(p_C), p_C[:, 2], image(goal), goal[:, 2], turns=True, least=1e-3
        )
        p_C = moved(p_C, 0.5 * found.x)
    np.testing.assert_allclose(p_C, goal, atol=1e-4)


@given(st.tuples(within, within, within))
def test_a_camera_that_only_moves_never_turns(away):
    goal = np.column_stack([0.05 * CORNERS, np.full(4, 0.3)])
    p_C = goal + 0.2 * np.array(away)
    found = image_displacement(
        image(p_C), p_C[:, 2], image(goal), goal[:, 2], turns=False, least=0.1
    )
    np.testing.assert_array_equal(found.x[3:], 0.0)


def test_points_in_one_place_do_not_determine_the_depth():
    same = np.zeros((4, 2))
    found = image_displacement(
        same, np.full(4, 0.3), same, np.full(4, 0.3), turns=False, least=0.2
    )
    assert found.least < 1e-9
