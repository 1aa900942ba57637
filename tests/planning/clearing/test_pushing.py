"""Pushes of heaps on made-up maps, and with the scenario's own arm."""

import dataclasses as dc

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg.planning.clearing.pushing import best_push
from drake_srg.planning.grasps.segmentation import Segmentation
from drake_srg.planning.grasps.srg_hand import SrgFingers
from drake_srg.planning.grasps.top_grasps import Reach
from drake_srg.scenario import load_scenario
from drake_srg.station.clearing import MakeClearingPlanner
from drake_srg.types import HeightMap

LOW, HIGH = 0.05, 0.11  # of a flat thing and of one that lies on it [m]
_SIZE = (0.2, 0.08)  # sides of the lower one and of the upper one [m]


def segmented(*boxes):
    """Return a map of square boxes: middle, side and height of their tops."""
    height_map = HeightMap(np.zeros(2), 0.01, np.zeros((80, 80)))
    for middle, side, top in boxes:
        apart = np.abs(height_map.centers() - middle).max(axis=-1)
        inside = apart < 0.5 * side
        height_map.height[inside] = np.maximum(height_map.height[inside], top)
    return Segmentation.of(height_map, 0.0, least_height=0.004, least_area=1e-4)


def heap(middle, shift=(0.0, 0.0)):
    return [(middle, _SIZE[0], LOW), (np.add(middle, shift), _SIZE[1], HIGH)]


middles = st.tuples(st.floats(0.3, 0.5), st.floats(0.3, 0.5))
shifts = st.tuples(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05))


@given(middles, shifts)
def test_pushes_the_upper_thing_from_free_air_and_above_the_lower_one(middle, shift):
    push = best_push(segmented(*heap(middle, shift)), 0.0, None)
    upper = np.add(middle, shift)
    start, end = push.start_W[:2] - upper, push.end_W[:2] - upper
    assert LOW < push.start_W[2] == push.end_W[2] < HIGH
    assert np.abs(start).max() > 0.5 * _SIZE[1]
    way = (end - start) / np.linalg.norm(end - start)
    assert abs(way @ [-start[1], start[0]]) < 0.02  # through its middle
    assert start @ way < 0.0 < end @ way
    assert np.isclose(push.yaw, np.arctan2(way[1], way[0]))


@settings(max_examples=15)
@given(middles, shifts)
def test_pushes_in_another_way_after_each_that_did_not_help(middle, shift):
    segments, tried = segmented(*heap(middle, shift)), []
    while (push := best_push(segments, 0.0, None, tried)) is not None:
        assert not any(push.is_like(other) for other in tried)
        tried.append(push)
        assert len(tried) < 20
    assert len(tried) > 3
    # What has moved since may be pushed in the same way again.
    there = np.add(middle, (0.1, 0.0))
    assert best_push(segmented(*heap(there, shift)), 0.0, None, tried) is not None


@settings(max_examples=15)
@given(middles)
def test_does_not_push_towards_other_things(middle):
    others = [
        (np.add(middle, (0.2 * x, 0.2 * y)), 0.15, LOW)
        for x, y in ((1, 0), (-1, 0), (0, 1), (1, 1), (-1, -1), (1, -1), (-1, 1))
    ]
    push = best_push(segmented(*heap(middle), *others), 0.0, None)
    assert push.end_W[1] - push.start_W[1] < -0.15


def fine(*bars):
    """Return a map of bars, with edges as rounded as those of smoothed maps."""
    height_map = HeightMap(np.zeros(2), 0.002, np.zeros((400, 400)))
    for low, high, top in bars:
        p_W = height_map.centers()
        inside = np.all((p_W > low) & (p_W < high), axis=-1)
        height_map.height[inside] = top
    rounded = cv2.GaussianBlur(height_map.height, (0, 0), 1.5)
    height_map = dc.replace(height_map, height=rounded)
    return Segmentation.of(height_map, 0.0, least_height=0.004, least_area=1e-4)


def test_what_lies_close_to_something_too_wide_is_freed():
    """A wrench lay along a lying box, and was left there."""
    box = ((0.3, 0.3), (0.46, 0.51), 0.06)
    wrench = ((0.46, 0.35), (0.477, 0.52), 0.012)
    elsewhere = ((0.5, 0.35), (0.517, 0.52), 0.012)
    assert best_push(fine(box), 0.0, None) is None
    assert best_push(fine(box, elsewhere), 0.0, None) is None
    push = best_push(fine(box, wrench), 0.0, None)
    assert push.start_W[2] > wrench[-1]
    assert push.end_W[0] - push.start_W[0] < 0.1  # not over the wrench


@given(middles, st.floats(0.05, 0.3))
def test_flat_things_are_not_pushed(middle, side):
    assert best_push(segmented((middle, side, LOW)), 0.0, None) is None


def test_what_is_out_of_reach_is_not_pushed():
    segments = segmented(*heap((0.4, 0.4)))
    assert best_push(segments, 0.0, Reach((0.0, 0.0), 0.9, 1.0)) is None


@given(st.floats(-np.pi, np.pi))
def test_a_heap_at_the_edge_of_reach_is_pushed_inwards(azimuth):
    out = np.array([np.cos(azimuth), np.sin(azimuth)])
    middle = np.array([0.4, 0.4])
    reach = Reach(tuple(middle - 0.7 * out), 0.3, 0.8)
    push = best_push(segmented(*heap(middle)), 0.0, reach)
    # A push of 0.25 m has one of 16 directions, so it is up to pi/16 off the best one.
    assert (push.end_W - push.start_W)[:2] @ out < 0.25 * np.sin(np.pi / 16)


def heap_of_boxes(*boxes):
    """Return a map of square boxes on a table: middle, side and height of each."""
    height_map = HeightMap(np.array([0.3, -0.4]), 0.005, np.zeros((160, 120)))
    for middle, side, top in boxes:
        inside = np.abs(height_map.centers() - middle).max(axis=-1) < 0.5 * side
        height_map.height[inside] = top
    return height_map


@pytest.fixture(scope="module")
def planner():
    scenario = load_scenario("clear_table", overrides=["clutter.count=1"])
    return MakeClearingPlanner(scenario).planner


def test_the_hand_goes_through_the_top_of_the_heap_and_back_over_the_bin(planner):
    middle = np.array([0.6, 0.0])
    motions, q = planner.motions, planner.motions.q_home
    height_map = heap_of_boxes((middle, 0.2, LOW), (middle, 0.08, HIGH))
    push = planner.pushes.plan(q, height_map)
    pieces = push.motions
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
    assert planner.pushes.plan(planner.motions.q_home, heap_of_boxes()) is None
