"""Boxes around what a map shows."""

import dataclasses as dc

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.planning.clearing.columns import columns, highest_near, thing_at
from planning.clearing.fake_table import RESOLUTION, SIDE, TALL, table

places = st.tuples(st.floats(0.05, 0.4), st.floats(0.05, 0.3))


@given(places, st.floats(0.02, 0.1))
def test_columns_hold_whatever_stands(place, size):
    height_map = table(place)
    boxes = columns(height_map, 0.0, size)
    for p in height_map.middles()[height_map.height > 0.0]:
        top = np.array([*p, TALL])
        inside = [
            np.all(np.abs(X.inverse() @ top) <= 0.5 * np.array(box.size) + 1e-9)
            for box, X in boxes
        ]
        assert any(inside)
    assert columns(table(), 0.0, size) == []


def test_a_low_edge_counts_and_a_corner_adds_nothing():
    edge = table()
    edge.height[40, 20:60] = 0.008  # one cell wide
    assert len(columns(edge, 0.0, 0.05)) == 4
    corner = table()
    corner.height[:20, :40] = TALL
    corner.height[20:40, :20] = TALL
    assert len(columns(corner, 0.0, 20 * RESOLUTION)) == 3
    assert columns(dc.replace(edge, height=np.zeros((0, 0))), 0.0) == []


@given(places)
def test_highest_thing_counts_within_the_radius(place):
    height_map = table(place)
    assert highest_near(height_map, np.array(place), 0.05) == TALL
    far = np.array([place[0], place[1] + 0.5 * SIDE + 0.03])
    assert highest_near(height_map, far, 0.02) <= 0.0


@given(places)
def test_a_thing_is_all_that_touches(place):
    other = (place[0], place[1] + 0.1)
    cells = thing_at(table(place, other), 0.0, np.array([*place, TALL]))
    np.testing.assert_allclose(cells.mean(axis=0), place, atol=RESOLUTION)
    assert np.all(np.abs(cells - place) < 0.5 * SIDE)


def test_noise_does_not_break_a_low_thing_apart():
    low = table(*((x, 0.1) for x in np.arange(0.1, 0.3, 0.02)), tall=0.01)
    low.height[:, 30:34] = 0.0
    cells = thing_at(low, 0.0, np.array([0.1, 0.1]))
    assert cells[:, 0].max() > 0.28
    low.height[:, 30:36] = 0.0
    cells = thing_at(low, 0.0, np.array([0.1, 0.1]))
    assert cells[:, 0].max() < 0.15


def test_the_thing_around_a_gap_between_the_pads():
    fork = table((0.1, 0.1), (0.2, 0.1), (0.15, 0.12))
    cells = thing_at(fork, 0.0, np.array([0.15, 0.09]))
    assert cells[:, 0].min() < 0.1
    assert cells[:, 0].max() > 0.2


def test_where_nothing_is_the_place_counts():
    cells = thing_at(table(), 0.0, np.array([0.1, 0.1, 0.0]))
    np.testing.assert_allclose(cells, [[0.1, 0.1]])


def test_a_step_parts_things_that_touch():
    touching = table((0.1, 0.1), tall=0.03)
    higher = table((0.14, 0.1), tall=0.06)
    both = dc.replace(touching, height=np.fmax(touching.height, higher.height))
    p_W = np.array([0.1, 0.1])
    whole, part = (thing_at(both, 0.0, p_W, step) for step in (np.inf, 0.015))
    assert whole[:, 0].max() > 0.15
    assert part[:, 0].max() < 0.125
    assert part[:, 0].min() < 0.095


def test_where_there_is_only_a_step_the_place_is_all():
    wall = table()
    wall.height[:, 20] = 0.05
    p_W = np.array([0.1, 0.1])
    assert thing_at(wall, 0.0, p_W, 0.015).tolist() == [[0.1, 0.1]]
