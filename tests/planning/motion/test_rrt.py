"""RRT-Connect with a point and a wall in the plane."""

from __future__ import annotations

import numpy as np
import pytest

from drake_srg.planning.motion.rrt import rrt_connect, shortcut_path

LOWER, UPPER = np.array([-1.0, -1.0]), np.array([1.0, 1.0])
START, GOAL = np.array([-0.8, 0.0]), np.array([0.8, 0.0])


def wall(gap: float):
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
    return rrt_connect(
        START,
        GOAL,
        lower=LOWER,
        upper=UPPER,
        weights=np.ones(2),
        is_edge_free=wall(gap),
        step=0.3,
        max_iterations=500,
        rng=np.random.default_rng(seed),
    )


@pytest.mark.parametrize("seed", range(10))
def test_the_search_goes_around_the_wall(seed):
    path = search(0.3, seed)
    assert path is not None
    np.testing.assert_array_equal(path[0], START)
    np.testing.assert_array_equal(path[-1], GOAL)
    assert all(map(wall(0.3), path[:-1], path[1:]))
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
        path, is_edge_free=wall(0.3), attempts=50, rng=np.random.default_rng(seed)
    )
    assert all(map(wall(0.3), short[:-1], short[1:]))
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
