"""What counts as arrived, map by map."""

import pytest

from drake_srg.planning.clearing.arriving import look_for_load
from drake_srg.planning.clearing.clearing_memory import ClearingMemory, Drop, Received
from drake_srg.planning.clearing.receiving import SeenLoad
from drake_srg.planning.motion.arm_motion import Motion
from planning.clearing.fake_table import BIN, HOME, SIDE, TALL, table

FIRST, ELSEWHERE, SECOND = (0.2, 0.2), (0.25, 0.15), (0.32, 0.25)
FLAT = 0.01


def with_first():
    """Return a memory of a tall load in the bin, and of a flat one let go there."""
    seen = table(FIRST)
    drop = Drop(BIN, SeenLoad(volume=FLAT * SIDE**2, height=FLAT))
    received = (Received(TALL * SIDE**2, table(), seen),)
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
