"""A push with the scenario's own arm, over a made-up heap."""

import numpy as np
import pytest

from drake_srg.cell.clearing import MakeClearingPlanner
from drake_srg.planning.grasps.srg_fingers import SrgFingers
from drake_srg.scenario import load_scenario
from drake_srg.types import HeightMap

LOW, HIGH = 0.05, 0.11  # tops of the heap's two boxes [m]


def heap(*boxes):
    """Return a map of square boxes on a table: middle, side and height of each."""
    height_map = HeightMap(np.array([0.3, -0.4]), 0.005, np.zeros((160, 120)))
    for middle, side, top in boxes:
        inside = np.abs(height_map.middles() - middle).max(axis=-1) < 0.5 * side
        height_map.height[inside] = top
    return height_map


@pytest.fixture(scope="module")
def planner():
    scenario = load_scenario("clear_table", overrides=["clutter.count=1"])
    return MakeClearingPlanner(scenario).planner


def test_the_hand_goes_through_the_top_of_the_heap_and_back_over_the_bin(planner):
    middle = np.array([0.6, 0.0])
    motions, q = planner.motions, planner.motions.q_home
    height_map = heap((middle, 0.2, LOW), (middle, 0.08, HIGH))
    push, pieces = planner.pushes.plan(q, height_map)
    for piece in pieces:
        np.testing.assert_allclose(piece.value(0.0)[:, 0], q, atol=1e-6)
        q = piece.value(1e9)[:, 0]
    np.testing.assert_allclose(q, motions.q_over, atol=1e-6)
    across = pieces[2]
    times = np.linspace(0.0, across.end_time(), 7)
    poses = [motions.scene.X_WG(across.value(t)[:, 0]) for t in times]
    downwards = [X_WG.rotation().matrix()[:, 0] for X_WG in poses]
    np.testing.assert_allclose(downwards, np.tile([0.0, 0.0, -1.0], (7, 1)), atol=0.01)
    p_W = np.array([X_WG.translation() for X_WG in poses]) - [
        0.0,
        0.0,
        SrgFingers.deepest,
    ]
    assert np.all((p_W[:, 2] > LOW) & (p_W[:, 2] < HIGH))
    assert np.linalg.norm(p_W[-1] - p_W[0]) == pytest.approx(0.25, abs=0.005)
    np.testing.assert_allclose(p_W[0], push.start_W, atol=1e-3)
    way = (p_W[-1] - p_W[0])[:2] / np.linalg.norm(p_W[-1] - p_W[0])
    assert abs(way @ [-(middle - p_W[0, :2])[1], (middle - p_W[0, :2])[0]]) < 0.01


def test_an_empty_table_needs_no_push(planner):
    assert planner.pushes.plan(planner.motions.q_home, heap()) is None
