"""What counts as arrived, map by map."""

import dataclasses as dc

import pytest

from drake_srg.planning.clearing.arriving import look_for_load, match_missed_load
from drake_srg.planning.clearing.clearing_memory import ClearingMemory
from drake_srg.planning.clearing.loads import Drop, Received
from drake_srg.planning.clearing.receiving import SeenLoad
from drake_srg.planning.motion.arm_motion import Motion
from planning.clearing.fake_table import BIN, HOME, SIDE, TALL, table

FIRST, ELSEWHERE, SECOND = (0.2, 0.2), (0.25, 0.15), (0.32, 0.25)
FLAT = 0.01


def with_first():
    """Return a memory of a tall load in the bin, and of a flat one let go there."""
    seen = table(FIRST)
    drop = Drop(BIN, SeenLoad(volume=FLAT * SIDE**2, height=FLAT))
    received = (Received(TALL * SIDE**2, table(), seen, BIN),)
    return ClearingMemory(
        Motion(HOME), destinations=seen, drop=drop, arrived=1, received=received
    )


def bin_with(first):
    """Return a bin with a flat load, and a tall one at a place; None: it has left."""
    seen = table(SECOND, tall=FLAT)
    if first is not None:
        seen.height[:] += table(first).height
    return seen


@pytest.mark.parametrize(("first", "arrived"), [(FIRST, 2), (ELSEWHERE, 2), (None, 1)])
def test_what_the_hand_carries_out_of_the_bin_counts_no_more(first, arrived):
    """A mug went back to the table on the open fingers, and counted twice."""
    memory = look_for_load(with_first(), bin_with(first))
    assert memory.arrived == arrived
    assert len(memory.lost) == 2 - arrived
    again = look_for_load(memory, bin_with(first))
    assert again.arrived == arrived


def test_without_a_map_nothing_is_judged():
    memory = with_first()
    assert look_for_load(memory, None) is memory


def test_what_settles_with_a_load_of_a_heap_is_no_part_of_it():
    memory = with_first()
    load = SeenLoad(10.0 * TALL * SIDE**2, TALL, core=TALL * SIDE**2)
    memory = dc.replace(memory, drop=Drop(BIN, load))
    assert look_for_load(memory, table(FIRST, SECOND)).arrived == 2


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
    """One that fell out as another came to lie where it was counted twice."""
    memory = dc.replace(with_first(), destinations=table(*now, tall=tall))
    memory, again = match_missed_load(memory, destination, volume)
    assert again == missed
    assert (memory.arrived, len(memory.lost)) == (1 - missed, missed)
    memory, again = match_missed_load(memory, destination, volume)
    assert (memory.arrived, again) == (1 - missed, missed)


def test_without_a_map_of_the_bin_any_load_may_be_missed():
    memory = dc.replace(with_first(), destinations=None)
    assert match_missed_load(memory, BIN, VOLUME) == (memory, True)
