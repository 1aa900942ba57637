"""Maps of the same table, before and after, and what stands there."""

import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.planning.clearing.maps import (
    completed,
    has_gone,
    has_moved,
    highest_near,
    is_still,
    obstacle_boxes,
    thing_at,
    volume_taken,
)
from drake_srg.types import HeightMap, LabeledHeightMap
from planning.clearing.fake_table import RESOLUTION, SIDE, TALL, table

A, B = (0.1, 0.1), (0.3, 0.2)
NOISE = 1e-3  # of heights, standard deviation [m]
seeds = st.integers(0, 2**32 - 1)
places = st.tuples(st.floats(0.05, 0.4), st.floats(0.05, 0.3))


def noisy(height_map, seed, noise=NOISE):
    """Return the map with noise, and holes in one cell of a hundred."""
    rng = np.random.default_rng(seed)
    height = height_map.height + rng.normal(0.0, noise, height_map.height.shape)
    height[rng.random(height.shape) < 0.01] = np.nan
    return dc.replace(height_map, height=height)


@given(seeds, places)
def test_noise_is_still(seed, place):
    assert is_still(noisy(table(place), seed), noisy(table(place), seed + 1))


@given(seeds, st.floats(0.03, 0.2))
def test_what_moves_is_not_still(seed, step):
    before, after = table(A), table((A[0] + step, A[1]))
    assert not is_still(noisy(before, seed), noisy(after, seed + 1))


@given(seeds, st.floats(0.03, 0.2))
def test_edges_of_tall_things_flicker(seed, tall):
    """Regression: because of flicker, heaps seemed to move without end."""
    rng = np.random.default_rng(seed)
    shown = HeightMap(np.zeros(2), 0.002, np.zeros((100, 120)))
    x = shown.centers()[..., 0]

    def look(edge):
        """Return a look at an edge, near which cells may show their neighbours."""
        near = x + rng.uniform(-0.004, 0.004, x.shape)
        return dc.replace(shown, height=np.where(near > edge, tall, 0.0))

    before = look(0.1)
    assert is_still(noisy(before, seed), noisy(look(0.1), seed + 1))
    assert not has_moved(before, look(0.1), np.array([0.1, 0.1]))
    pushed = look(0.115)
    assert not is_still(noisy(before, seed), noisy(pushed, seed + 1))
    assert has_moved(before, pushed, np.array([0.1, 0.1]))


def test_what_passes_above_the_map_is_not_still():
    maps = [table(), table()]
    for height_map, column in zip(maps, (10, 40), strict=True):
        height_map.height[20:40, column : column + 20] = np.nan
    assert not is_still(*maps)


@given(seeds, st.floats(0.03, 0.2))
def test_only_what_is_near_counts_as_moved(seed, step):
    before = noisy(table(A, B), seed)
    pushed = noisy(table((A[0] + step, A[1]), B), seed + 1)
    assert has_moved(before, pushed, np.array(A))
    assert not has_moved(before, pushed, np.array([B[0] + 0.1, B[1]]))
    assert not has_moved(before, noisy(table(A, B), seed + 1), np.array(A))


@given(seeds)
def test_tells_gone_from_pushed_and_from_untouched(seed):
    before = noisy(table(A, B), seed)
    for after, gone in (
        (table(B), True),
        (table((A[0] + 0.05, A[1]), B), False),
        (table(A, B), False),
        (table(A), False),
    ):
        assert has_gone(before, noisy(after, seed + 1), np.array(A)) == gone


@given(seeds, st.floats(0.0, 0.05), st.booleans())
def test_what_slides_elsewhere_is_not_taken(seed, sinks, noise):
    """Regression: when a plate slid down a wall, a marker seemed too large."""
    amount = NOISE if noise else 0.0
    before, after = table(A), table()
    slides = np.linalg.norm(before.centers() - B, axis=-1) < 0.08
    before.height[slides], after.height[slides] = 0.1, 0.1 - sinks
    volume = volume_taken(
        noisy(before, seed, amount), noisy(after, seed + 1, amount), np.array(A)
    )
    assert volume == pytest.approx(SIDE**2 * TALL, rel=0.15)


@pytest.mark.parametrize("tall", [0.005, TALL])
def test_flat_things_go_too(tall):
    assert has_gone(table(A, tall=tall), table(), np.array(A))


def test_a_flat_thing_that_leaves_a_noisy_table_is_gone():
    """Noise hides it in 5 of 3,000 seeds, so the test demands only a share."""
    others, gone = [(x, 0.3) for x in np.arange(0.05, 0.45, 0.06)], []
    for seed in range(100):
        before = noisy(table(*others), seed, noise=2.4e-3)
        wrench = np.abs(before.centers() - A).max(axis=-1) < 0.5 * SIDE
        before.height[wrench] += 0.01
        after = noisy(table(*others), seed + 1, noise=2.4e-3)
        gone.append(has_gone(before, after, np.array(A)))
    assert np.mean(gone) >= 0.99


@pytest.mark.parametrize(("now", "kept"), [((), False), ((A,), True)])
def test_what_has_left_is_in_no_gap_either(now, kept):
    """Regression: a strip beside a box kept a removed pitcher's height."""
    before, after = table(A), table(*now)
    x, y = np.moveaxis(after.centers(), -1, 0)
    gap = (np.abs(x - A[0]) < 0.005) & (np.abs(y - A[1]) < 0.02)
    far = (x > A[0] + 0.1) & (x < A[0] + 0.12)
    before.height[far] = TALL  # out of sight by now
    after.height[gap | far] = np.nan
    whole = completed(after, before)
    assert np.all(whole.height[far] == TALL)
    assert np.all(whole.height[gap] == TALL) == kept
    assert np.all(np.isnan(whole.height[gap])) == (not kept)
    assert completed(after, None) is after


def test_what_may_belong_to_something_that_is_still_seen_is_kept():
    close = (A[0] + SIDE + 0.01, A[1])
    before, after = table(A, close), table(close)
    x = after.centers()[..., 0]
    edge = (np.abs(x - close[0] + 0.5 * SIDE) < 0.01) & (after.height > 0.0)
    after.height[edge] = np.nan
    np.testing.assert_array_equal(completed(after, before).height, table(close).height)


def test_nothing_is_where_nothing_is_known():
    before, after = table(A), table()
    gap = np.abs(after.centers() - A).max(axis=-1) < 0.004
    after.height[gap] = np.nan
    label = np.zeros(after.height.shape, np.int8)
    labeled = [
        LabeledHeightMap(m.origin, m.resolution, m.height, label, ("a",))
        for m in (after, before)
    ]
    assert np.all(completed(*labeled).label[gap] == -1)


@given(places, st.floats(0.02, 0.1))
def test_columns_hold_whatever_stands(place, size):
    height_map = table(place)
    boxes = obstacle_boxes(height_map, 0.0, size)
    for p in height_map.centers()[height_map.height > 0.0]:
        top = np.array([*p, TALL])
        inside = [
            np.all(np.abs(X.inverse() @ top) <= 0.5 * np.array(box.size) + 1e-9)
            for box, X in boxes
        ]
        assert any(inside)
    assert obstacle_boxes(table(), 0.0, size) == []


def test_a_low_edge_counts_and_a_corner_adds_nothing():
    edge = table()
    edge.height[40, 20:60] = 0.008  # one cell wide
    assert len(obstacle_boxes(edge, 0.0, 0.05)) == 4
    corner = table()
    corner.height[:20, :40] = TALL
    corner.height[20:40, :20] = TALL
    assert len(obstacle_boxes(corner, 0.0, 20 * RESOLUTION)) == 3
    assert obstacle_boxes(dc.replace(edge, height=np.zeros((0, 0))), 0.0) == []


@given(seeds)
def test_noise_gets_no_boxes(seed):
    """Higher things get boxes, even if most of the map is unknown."""
    for things, found in ((table(), 0), (table(A, tall=0.02), 1)):
        seen = noisy(things, seed, 2e-3)
        seen.height[:, 45:] = np.nan
        assert bool(obstacle_boxes(seen, 0.0)) == found


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
