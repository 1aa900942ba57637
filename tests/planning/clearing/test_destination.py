"""Destinations of loads: overhang, lanes for long loads, places for tall ones."""

import dataclasses as dc

import numpy as np
import pytest

from planning.clearing.fake_table import BIN, SIDE, TALL, crossing, table

BEFORE = (0.15, 0.15)  # place of an earlier load


def test_the_top_of_what_is_in_a_bin_leaves_out_its_walls():
    height_map = table(BEFORE)
    height_map.height[~BIN.contains(height_map, -0.01)] = 0.12
    assert BIN.top(height_map) == TALL
    height_map.height[:] = np.nan
    assert BIN.top(height_map) == -np.inf


def test_the_emptier_lane_of_a_bin_comes_first():
    deep = dc.replace(BIN, rim=0.12, floor=0.01)
    across = 0.2 * (BIN.high - BIN.low)[1]
    for side in (-1.0, 1.0):
        shown = table((BIN.middle[0], BIN.middle[1] + side * 0.08))
        empty, full = deep.spots(shown).long
        np.testing.assert_allclose(empty.aside_W, [0.0, -side * across, 0.0])
        assert (empty.ground, full.ground) == (0.01, TALL)


@pytest.mark.parametrize(("away", "below"), [(0.06, TALL), (0.08, TALL), (0.1, 0.01)])
def test_what_the_open_hand_may_reach_is_below_a_lane(away, below):
    """Regression: a finger went down in a mug beside a lane, and lifted it out."""
    deep = dc.replace(BIN, high=np.add(BIN.low, [0.3, 0.25]), rim=0.12, floor=0.01)
    lane = deep.middle[1] - 0.2 * 0.25
    shown = table((deep.middle[0], lane + away + 0.5 * SIDE))
    first, *_ = deep.spots(shown).long
    assert first.aside_W[1] < 0.0
    assert first.ground == below


def test_the_lanes_of_a_bin_that_was_not_seen_are_empty():
    deep = dc.replace(BIN, rim=0.12, floor=0.01)
    unseen = dc.replace(table(), height=np.full((80, 100), np.nan))
    for spots in (deep.spots(None), deep.spots(unseen)):
        assert [spot.ground for spot in spots.long + spots.tall] == 5 * [0.01]


@pytest.mark.parametrize(
    ("inside", "outside", "height", "sticks_out"),
    [
        (0.1, 0.06, 0.15, True),
        (0.1, 0.06, 0.125, False),  # not over the rim
        (0.01, 0.06, 0.15, False),  # not inside
        (0.1, 0.095, 0.15, False),  # too far
    ],
)
def test_what_reaches_over_the_rim_from_inside(inside, outside, height, sticks_out):
    """Regression: a hammer was picked out of the bin by its handle seven times."""
    deep, shown, bar = crossing(inside, outside, height)
    expected = bar & ~deep.contains(shown, 0.01) if sticks_out else np.zeros_like(bar)
    np.testing.assert_array_equal(deep.overhang(shown), expected)
    assert not dc.replace(deep, rim=None).overhang(shown).any()


def test_tall_things_are_set_down_in_the_middle_or_along_it_where_nothing_is():
    deep = dc.replace(BIN, rim=0.12, floor=0.01)
    asides = [0.0, -0.25 * 0.3, 0.25 * 0.3]
    for taken in asides:
        shown = table((BIN.middle[0] + taken, BIN.middle[1]))
        *free, full = deep.spots(shown).tall
        np.testing.assert_allclose(full.aside_W, [taken, 0.0, 0.0])
        others = [a for a in asides if a != taken]
        assert [spot.aside_W[0] for spot in free] == pytest.approx(others)
