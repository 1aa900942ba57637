"""Dropped loads on maps of a bin, and the criterion for their arrival."""

import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.planning.clearing.destination import Destination
from drake_srg.planning.clearing.loads import Load, Loads, Risen, Verdict
from drake_srg.types import HeightMap
from planning.clearing.fake_table import BIN, SIDE, TALL, crossing, table
from planning.clearing.test_maps import noisy

LOAD = Load(destination=BIN, volume=SIDE**2 * TALL, height=TALL)
BEFORE = (0.15, 0.15)  # place of an earlier load
seeds = st.integers(0, 2**32 - 1)
inside = st.tuples(st.floats(0.25, 0.38), st.floats(0.12, 0.28))


def has_received(destination, before, after, load):
    return Risen.between(destination, before, after).shows(load)


def has_missed(destination, before, after, load):
    return Risen.between(destination, before, after).shows_beside(load)


@given(seeds, inside)
def test_a_load_in_the_bin_is_seen(seed, place):
    before, after = noisy(table(BEFORE), seed), noisy(table(BEFORE, place), seed + 1)
    assert has_received(BIN, before, after, LOAD)


@given(seeds, st.floats(0.03, 0.08))
def test_a_load_beside_the_bin_is_not_in_it(seed, far):
    before = noisy(table(BEFORE), seed)
    for place in ((0.4 + far, 0.2), (0.2, 0.3 + far), (0.1 - far, 0.2)):
        after = noisy(table(BEFORE, place), seed + 1)
        assert not has_received(BIN, before, after, LOAD)


def test_a_load_that_hangs_over_the_rim_may_fall_out():
    assert not has_received(BIN, table(), table((0.4, 0.2)), LOAD)


@pytest.mark.parametrize(
    ("x", "tall", "seen"),
    [(0.36, TALL, False), (0.36, 0.03, True), (0.25, TALL, True)],
)
def test_a_load_that_leans_on_the_rim_may_hang_over_it_unseen(x, tall, seen):
    deep = Destination(BIN.low, BIN.high, rim=0.02)
    before, after = table(), table((x, 0.2), tall=tall)
    assert has_received(deep, before, after, LOAD)  # nothing is beyond the rim
    after.height[after.centers()[..., 0] > 0.405] = np.nan
    assert has_received(deep, before, after, LOAD) == seen


@given(st.sampled_from([0, 1]), st.booleans())
def test_only_the_rim_beside_an_unseen_place_hides_things(axis, low):
    deep = Destination(BIN.low, BIN.high, rim=0.02)
    after = table((0.36, 0.2))
    places = after.centers()[..., axis]
    unseen = places < BIN.low[axis] if low else places > BIN.high[axis]
    after.height[unseen] = np.nan
    near = not low and axis == 0  # to the load
    assert has_received(deep, table(), after, LOAD) != near


@pytest.mark.parametrize(("beyond", "seen"), [(0.0075, True), (0.04, False)])
def test_the_edge_of_the_wall_may_be_seen_anywhere_near_it(beyond, seen):
    deep = Destination(BIN.low, BIN.high, rim=0.12)
    before, after = table(), table((0.25, 0.2), tall=0.02)
    x, y = np.moveaxis(after.centers(), -1, 0)
    near = (x > 0.4) & (x < 0.4 + beyond) & (y > 0.1) & (y < 0.3)
    after.height[near] = 0.12
    load = dc.replace(LOAD, volume=0.02 * SIDE**2, height=0.02, felt=False)
    assert has_received(deep, before, after, load) == seen


@given(seeds)
def test_a_bin_that_has_not_changed_has_received_nothing(seed):
    before, after = noisy(table(BEFORE), seed), noisy(table(BEFORE), seed + 1)
    for share in (0.05, 1.0):
        load = dc.replace(LOAD, volume=share * LOAD.volume, height=TALL)
        assert not has_received(BIN, before, after, load)


@given(seeds)
def test_what_is_in_a_bin_may_lean_a_little_over_its_rim(seed):
    deep = Destination(BIN.low, BIN.high, rim=0.02)
    before, after = table((0.36, 0.2), tall=0.2), table((0.385, 0.2), tall=0.2)
    after.height[:, :60] = table((0.2, 0.2)).height[:, :60]  # the load
    assert has_received(deep, noisy(before, seed), noisy(after, seed + 1), LOAD)


@pytest.mark.parametrize(("outside", "lies"), [(0.04, True), (0.09, False)])
def test_a_bar_over_the_rim_is_in_the_bin_with_both_its_ends(outside, lies):
    deep, after, bar = crossing(0.1, outside)
    hidden = deep.contains(after, 0.02) & ~deep.contains(after)  # by the wall
    after.height[hidden & ~bar] = np.nan
    walls = np.where(deep.contains(after), deep.rim, 0.0)
    floor = np.where(deep.contains(after, -0.02), 0.02, walls)
    before = dc.replace(after, height=np.where(hidden, np.nan, floor))
    for felt in (True, False):
        load = dc.replace(LOAD, volume=2e-4, height=0.025, felt=felt)
        assert has_received(deep, before, after, load) == lies


@pytest.mark.parametrize(
    ("felt", "now", "comes"),
    [
        (True, [BEFORE, (0.3, 0.2)], True),
        (False, [BEFORE, (0.3, 0.2)], False),
        (True, [(0.2, 0.2)], False),  # something else has moved
        (True, [BEFORE], False),
        (True, [BEFORE, (0.45, 0.2)], False),
        (True, [BEFORE, (0.3, 0.2), (0.45, 0.2)], False),
    ],
)
def test_more_may_be_gone_from_a_heap_than_the_load(felt, now, comes):
    """Regression: an object that settled with a load counted as a lost part of it."""
    heap = dc.replace(
        LOAD, volume=6.0 * LOAD.volume, height=TALL, felt=felt, core=LOAD.volume
    )
    risen = Risen.between(BIN, table(BEFORE), table(*now))
    assert risen.shows(risen.without_settled(heap)) == comes


@given(seeds)
def test_noise_is_no_load_of_a_heap(seed):
    before, after = noisy(table(BEFORE), seed), noisy(table(BEFORE), seed + 1)
    risen = Risen.between(BIN, before, after)
    heap = dc.replace(LOAD, volume=6.0 * LOAD.volume)
    assert not risen.shows(risen.without_settled(heap))


def test_a_heap_loses_at_least_half_of_what_was_at_the_grasp():
    """An object that a bouncing box displaces in the bin is not taken for the box."""
    heap = dc.replace(
        LOAD, volume=6.0 * LOAD.volume, height=TALL, core=2.5 * LOAD.volume
    )
    risen = Risen.between(BIN, table(BEFORE), table(BEFORE, (0.3, 0.2)))
    assert not risen.shows(risen.without_settled(heap))


@pytest.mark.parametrize(("into", "comes"), [([(0.3, 0.2)], True), ([], False)])
def test_what_is_pushed_beside_the_bin_is_not_the_load_in_it(into, comes):
    before, after = table((0.2, 0.2)), table((0.25, 0.2), (0.45, 0.2), *into)
    assert has_received(BIN, before, after, LOAD) == comes
    missed = dc.replace(LOAD, felt=False)
    assert not has_received(BIN, before, after, missed)


def test_what_lies_over_the_rim_may_be_pushed_along_it():
    deep, after, bar = crossing(0.1, 0.09)
    walls = np.where(deep.contains(after), deep.rim, 0.0)
    floor = np.where(deep.contains(after, -0.02), 0.02, walls)
    moved = np.where(np.roll(bar, 3, axis=0), 0.15, floor)
    before = dc.replace(after, height=moved)
    assert not has_received(deep, before, after, LOAD)
    load = np.abs(after.centers() - (0.3, 0.15)).max(axis=-1) < 0.5 * SIDE
    after.height[load] = 0.02 + TALL
    assert has_received(deep, before, after, LOAD)
    missed = dc.replace(LOAD, felt=False)
    assert not has_received(deep, before, after, missed)


@pytest.mark.parametrize("place", [(0.45, 0.2), (0.2, 0.2), None])
def test_tells_a_load_beside_the_bin_from_one_that_is_unseen(place):
    after = table() if place is None else table(place)
    assert has_missed(BIN, table(), after, LOAD) == (place == (0.45, 0.2))


def test_what_is_pushed_beside_the_bin_is_no_load_that_missed():
    before, after = table((0.45, 0.2)), table((0.45, 0.25))
    assert not has_missed(BIN, before, after, dc.replace(LOAD, felt=False))
    assert not has_missed(BIN, table(), before, dc.replace(LOAD, volume=0.0))


def test_a_small_load_beside_the_bin_is_not_in_it_though_others_settle():
    small = dc.replace(LOAD, volume=6e-6, height=0.005)
    before, after = table((0.2, 0.2), tall=0.2), table((0.2, 0.2), tall=0.202)
    assert has_received(BIN, before, table((0.2, 0.2), (0.3, 0.2)), small)
    x, y = np.moveaxis(after.centers(), -1, 0)
    after.height[(np.abs(x - 0.45) < 0.02) & (np.abs(y - 0.2) < 0.02)] = 0.005
    settled = (np.abs(x - 0.3) < 0.02) & (np.abs(y - 0.2) < 0.02)
    after.height[settled] = 0.003  # 4.8 cm³
    assert not has_received(BIN, before, after, small)


def test_flickering_edges_are_no_load():
    before = HeightMap(np.zeros(2), 0.002, np.zeros((200, 250)))
    after = dc.replace(before, height=before.height.copy())
    for column in range(60, 190, 6):
        after.height[100:103, column : column + 3] = TALL
    assert not has_received(
        BIN, before, after, dc.replace(LOAD, volume=1e-5, height=0.01)
    )
    after.height[100:103, 60:190] = TALL
    assert has_received(BIN, before, after, dc.replace(LOAD, volume=1e-5, height=0.01))


def test_a_load_may_push_another_down():
    before, after = table(BEFORE, (0.35, 0.2)), table(BEFORE, (0.3, 0.2))
    assert has_received(BIN, before, after, LOAD)
    fell_out = table(BEFORE, (0.3, 0.2), (0.43, 0.2))
    assert not has_received(BIN, before, fell_out, LOAD)


def test_what_is_hidden_is_not_seen():
    after = table((0.3, 0.2))
    after.height[after.height > 0.0] = np.nan
    assert not has_received(BIN, table(), after.completed(table()), LOAD)


def test_far_less_than_was_taken_is_something_else():
    large = dc.replace(LOAD, volume=10.0 * LOAD.volume, height=TALL)
    assert not has_received(BIN, table(), table((0.3, 0.2)), large)


@pytest.mark.parametrize(("tall", "stands"), [(TALL, True), (0.5 * TALL, False)])
def test_what_is_set_down_must_stand(tall, stands):
    place = Destination(BIN.low, BIN.high, place=np.zeros(3))
    assert has_received(place, table(), table((0.3, 0.2), tall=tall), LOAD) == stands
    assert has_received(BIN, table(), table((0.3, 0.2), tall=tall), LOAD)


def test_where_all_moves_a_small_load_must_have_been_felt():
    before, after = table((0.2, 0.2), tall=0.2), table((0.35, 0.2), tall=0.22)
    small = dc.replace(LOAD, volume=2e-5, height=0.01)
    assert has_received(BIN, before, after, small)
    assert not has_received(BIN, before, after, dc.replace(small, felt=False))


def test_what_falls_in_small_parts_counts_too():
    """Regression: a thing that slipped counted, because others moved."""
    slipped = dc.replace(LOAD, volume=0.0, height=TALL, felt=False)
    empty, other, shifted = (
        HeightMap(np.zeros(2), 0.002, np.zeros((200, 250))) for _ in range(3)
    )
    shifted.height[100:110, 150:160] = TALL  # 4 cm² and 20 cm³
    for x in range(60, 180, 10):  # 1 cm² and 5 cm³ each
        other.height[70:75, x : x + 5] = TALL
    assert has_received(BIN, empty, shifted, slipped)
    assert not has_received(BIN, other, shifted, slipped)


def test_without_a_load_that_was_felt_more_must_rise_than_fall():
    before, after = table((0.2, 0.2), (0.3, 0.2)), table((0.2, 0.2), (0.35, 0.2))
    missed = dc.replace(LOAD, felt=False)
    assert has_received(BIN, before, after, LOAD)  # has only moved there
    assert not has_received(BIN, before, after, missed)
    both = table((0.2, 0.2), (0.35, 0.2), (0.25, 0.25))
    assert has_received(BIN, before, both, missed)


@pytest.mark.parametrize(
    ("now", "volume", "several"),
    [
        ([BEFORE, (0.3, 0.2)], 2.0, False),
        ([BEFORE, (0.3, 0.2), (0.2, 0.25)], 2.0, True),
        ([BEFORE, (0.3, 0.2), (0.2, 0.25)], 1.0, False),  # more than has left the table
        ([BEFORE, (0.3, 0.2), (0.3, 0.2 + SIDE)], 2.0, False),  # they touch
        ([(0.2, 0.25), (0.3, 0.2)], 2.0, False),  # one of them has only moved
        ([BEFORE, (0.3, 0.2), (0.45, 0.2)], 2.0, False),  # one is beside the bin
        ([BEFORE], 2.0, False),
    ],
)
def test_several_things_in_one_grasp_are_told_apart(now, volume, several):
    load = dc.replace(LOAD, volume=volume * LOAD.volume)
    risen = Risen.between(BIN, table(BEFORE), table(*now))
    assert risen.shows_several(load) == several


def test_a_thing_that_a_large_load_tilts_is_no_second_load():
    """A box on others seemed to be two things."""
    after = table(BEFORE, (0.3, 0.2), tall=0.2)
    after.height[table(BEFORE).height > 0.0] = TALL + 0.01
    load = dc.replace(LOAD, volume=0.2 * SIDE**2)
    assert not Risen.between(BIN, table(BEFORE), after).shows_several(load)


FIRST, ELSEWHERE, SECOND = (0.2, 0.2), (0.25, 0.15), (0.32, 0.25)
FLAT = 0.01


def with_first(load=None):
    """Return a tall load in the bin, and another one that was let go.

    Args:
        load: The other; None: a flat one.
    """
    seen = table(FIRST)
    first = dc.replace(LOAD, verdict=Verdict.ARRIVED, before=table(), after=seen)
    flat = dc.replace(LOAD, volume=FLAT * SIDE**2, height=FLAT)
    return Loads((first, load or flat), seen)


def bin_with(first):
    """Return a bin with a flat load, and a tall one at a place; None: it has left."""
    seen = table(SECOND, tall=FLAT)
    if first is not None:
        seen.height[:] += table(first).height
    return seen


@pytest.mark.parametrize(("first", "arrived"), [(FIRST, 2), (ELSEWHERE, 2), (None, 1)])
def test_what_the_hand_carries_out_of_the_bin_counts_no_more(first, arrived):
    """Regression: a mug left the bin on the open fingers, and counted twice."""
    loads = with_first()
    assert loads.look(bin_with(first))
    assert loads.arrived == arrived
    assert len(loads.lost) == 2 - arrived
    assert not loads.look(bin_with(first))
    assert loads.arrived == arrived


def test_what_settles_with_a_load_of_a_heap_is_no_part_of_it():
    load = dc.replace(LOAD, volume=10.0 * VOLUME, core=VOLUME)
    loads = with_first(load)
    loads.look(table(FIRST, SECOND))
    assert loads.arrived == 2


VOLUME = TALL * SIDE**2
OTHER_BIN = dc.replace(BIN, high=BIN.high + 1.0)


@pytest.mark.parametrize(
    ("now", "tall", "volume", "destination", "missed"),
    [
        ((), TALL, VOLUME, BIN, True),
        ((), TALL, VOLUME, OTHER_BIN, False),
        ((FIRST,), TALL, VOLUME, BIN, False),
        # Something taller is there: the load may lie below it.
        ((FIRST,), 2.0 * TALL, VOLUME, BIN, True),
        ((FIRST,), 2.0 * TALL, 3.0 * VOLUME, BIN, False),
    ],
)
def test_what_lies_beside_the_bin_may_be_a_load_that_is_gone(
    now, tall, volume, destination, missed
):
    """Regression: a load counted twice if another covered its place in the bin."""
    loads = with_first()
    loads.seen = table(*now, tall=tall)
    for _ in range(2):
        assert loads.match_missed(destination, volume) == missed
        assert (loads.arrived, len(loads.lost)) == (1 - missed, missed)


def test_without_a_map_of_the_bin_any_load_may_be_missed():
    loads = with_first()
    loads.seen = None
    assert loads.match_missed(BIN, VOLUME)
    assert loads.arrived == 1


@pytest.mark.parametrize("reported", [0, 1, 2])
def test_a_load_that_was_missed_withdraws_one_report_of_its_own_bin(reported):
    dropped = dc.replace(LOAD, verdict=Verdict.DROPPED)
    elsewhere = dc.replace(dropped, destination=OTHER_BIN)
    again = dc.replace(LOAD, again=True)
    dropped = [dc.replace(dropped) for _ in range(reported)]
    loads = Loads((*dropped, elsewhere, again), table())
    assert loads.look(table(FIRST))
    assert (loads.arrived, len(loads.lost)) == (1, max(reported, 1))


@pytest.mark.parametrize(
    ("felt", "again", "arrived"), [(True, False, 1), (True, True, 0), (False, False, 0)]
)
def test_without_a_camera_there_what_was_taken_counts_once(felt, again, arrived):
    loads = Loads()
    loads.add(dc.replace(LOAD, felt=felt, again=again))
    assert (loads.arrived, loads.pending, loads.lost) == (arrived, None, ())
