import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.planning.grasps.segmentation import Segmentation
from drake_srg.types import HeightMap

TABLE = 0.5


def segmentation(height, origin=(0.0, 0.0)):
    """Return the segmentation of heights in cells of 2 mm [m]."""
    map_ = HeightMap(np.array(origin), 0.002, height)
    return Segmentation.of(map_, TABLE, least_height=0.004, least_area=6e-5)


def segmented(*boxes, noise=0.0):
    """Return a map with boxes (x0, x1, y0, y1, height) in cells of 2 mm [m]."""
    height = np.full((80, 100), TABLE)
    height += np.random.default_rng(0).normal(0.0, noise, height.shape)
    for x0, x1, y0, y1, tall in boxes:
        height[y0:y1, x0:x1] += tall
    return segmentation(height, (1.0, 2.0))


def test_things_and_their_sizes():
    found = segmented((10, 40, 20, 30, 0.05), (60, 70, 40, 60, 0.03))
    big, small = found.things
    assert big.size == pytest.approx((0.06, 0.02), abs=1e-6)
    assert big.top == pytest.approx(0.05, abs=1e-6)
    np.testing.assert_allclose(big.middle, [1.0 + 0.049, 2.0 + 0.049], atol=1e-6)
    assert len(small.cells) == 200
    assert set(np.unique(found.labels)) == {0, big.label, small.label}


def test_specks_and_flat_things_are_none():
    assert segmented((10, 12, 20, 22, 0.05), (60, 70, 40, 60, 0.003)).things == ()


def test_what_noise_may_have_raised_is_a_speck():
    """Regression: the hand tried twice to grasp a speck of 16 x 8 mm."""
    speck = (40, 46, 40, 44, 0.009)
    assert len(segmented(speck).things) == 1
    assert segmented(speck, noise=0.001).things == ()


def test_noise_raises_what_counts():
    quiet, noisy = segmented(), segmented(noise=0.003)
    assert quiet.noise == pytest.approx(0.0, abs=1e-6)
    # The median of nine values has two fifths of their noise.
    assert 0.0008 < noisy.noise < 0.003
    assert noisy.least > 3.5 * noisy.noise
    assert noisy.things == ()


def test_heights_at_points():
    found = segmented((10, 40, 20, 30, 0.05))
    points = np.array([[1.03, 2.045], [1.1, 2.1], [0.9, 2.0], [5.0, 5.0], [-9.0, 2.0]])
    np.testing.assert_allclose(found.lookup(points), [0.05, 0, 0, 0, 0], atol=1e-6)


def test_one_thing_alone():
    found = segmented((10, 40, 20, 30, 0.05), (60, 70, 40, 60, 0.03))
    only = found.only(found.things[1])
    assert only.above.max() == pytest.approx(0.03, abs=1e-6)
    assert only.things == (found.things[1],)


def test_the_unknown_is_level():
    found = segmentation(np.full((20, 20), np.nan))
    assert found.unknown.all()
    np.testing.assert_array_equal(found.above, 0.0)
    assert found.things == ()


def test_a_long_thin_part_has_a_middle_of_its_own():
    found = segmented((60, 98, 10, 60, 0.04), (2, 60, 30, 38, 0.02))
    (thing,) = found.things
    on_bar, on_plate, beside = (
        found.thing_middles[34, 10],
        found.thing_middles[34, 80],
        (5, 5),
    )
    np.testing.assert_allclose(on_bar, [1.0 + 0.062, 2.0 + 0.068], atol=3e-3)
    np.testing.assert_array_equal(on_plate, thing.middle)
    assert np.isnan(found.thing_middles[beside]).all()


def discs(*circles):
    """Return a map with discs (x, y, radius, height) in cells of 2 mm [m]."""
    y, x = np.mgrid[:160, :200]
    height = np.full(x.shape, TABLE)
    for x0, y0, radius, tall in circles:
        height[np.hypot(x - x0, y - y0) < radius] = TABLE + tall
    return segmentation(height)


def test_a_ball_beside_a_plate_has_a_middle_of_its_own():
    found = discs((70, 80, 60, 0.03), (144, 80, 16, 0.06))
    (thing,) = found.things
    np.testing.assert_allclose(found.thing_middles[80, 144], [0.288, 0.16], atol=4e-3)
    np.testing.assert_array_equal(found.thing_middles[80, 70], thing.middle)


@pytest.mark.parametrize(
    "circles",
    [
        [(70, 80, 60, 0.03)],  # a plate alone
        [(70, 80, 60, 0.03), (132, 80, 6, 0.03)],  # its handle
        [(60, 80, 20, 0.03), (98, 80, 20, 0.06)],  # neither is wide
    ],
)
def test_a_handle_or_a_narrow_neighbour_shares_the_common_middle(circles):
    found = discs(*circles)
    (thing,) = found.things
    np.testing.assert_array_equal(
        found.thing_middles[tuple(thing.cells.T)],
        np.broadcast_to(thing.middle, (len(thing.cells), 2)),
    )


def test_the_corners_of_a_lying_box_share_its_middle():
    (thing,) = (found := segmented((4, 96, 2, 76, 0.06))).things
    apart = found.thing_middles[tuple(thing.cells.T)] - thing.middle
    np.testing.assert_array_equal(apart, 0.0)


def test_a_short_part_and_a_thin_thing_share_the_common_middle():
    for boxes in (
        [(60, 98, 10, 60, 0.04), (30, 60, 30, 38, 0.02)],
        [(2, 90, 30, 50, 0.02)],
    ):
        found = segmented(*boxes)
        (thing,) = found.things
        np.testing.assert_allclose(
            found.thing_middles[tuple(thing.cells.T)] - thing.middle, 0.0, atol=1e-9
        )


def test_places_beside_the_same_thing():
    found = segmented((10, 40, 20, 30, 0.05), (60, 70, 10, 60, 0.03))
    middles = found.map.centers()
    one, another = (middles[tuple(thing.cells.T)] for thing in found.things)
    table, outside = middles[2, 2], np.array([9.0, 9.0])
    assert found.beside_same(one[0], one[-1], 0.0)
    assert found.beside_same(one[0], one[-1] + [0.0, 0.02], 0.021)
    for place in (another[0], table, outside):
        assert not found.beside_same(one[0], place, 0.02)
        assert not found.beside_same(table, place, 0.02)
        assert not found.beside_same(outside, place, 0.02)


@given(st.integers(0, 99), st.floats(0.006, 0.007))
def test_noise_does_not_break_low_things_apart(seed, tall):
    height = np.random.default_rng(seed).normal(TABLE, 0.003, (80, 100))
    height[30:42, 10:90] += tall
    found = segmentation(height)
    assert np.count_nonzero(found.above[30:42, 10:90] < found.least) > 50
    whole = max(found.things, key=lambda thing: len(thing.cells))
    assert whole.size == pytest.approx((0.16, 0.024), abs=0.015)


@given(st.floats(0.005, 0.1))
def test_places_are_on_things_and_near_every_part_of_them(apart):
    found = segmented((10, 40, 20, 30, 0.05), (60, 70, 10, 60, 0.03))
    places = np.array(found.places(apart))
    heights = found.map.height[tuple(found.map.cells(places[:, :2]).T)]
    np.testing.assert_allclose(places[:, 2], heights)
    assert np.all(heights > TABLE)
    for thing in found.things:
        iy, ix = thing.cells.T
        parts = found.map.centers()[iy, ix]
        away = np.linalg.norm(parts[:, None] - places[None, :, :2], axis=-1)
        assert away.min(axis=1).max() <= apart
    assert segmented().places(apart) == []
