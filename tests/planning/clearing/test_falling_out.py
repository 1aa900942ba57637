"""What the planner makes of things that come to lie beside the bin."""

import dataclasses as dc

import numpy as np
import pytest

from drake_srg.planning.clearing.knowledge import ClearingMemory, View
from drake_srg.planning.clearing.loads import Load, Loads, Verdict
from drake_srg.planning.clearing.maps import lowest
from drake_srg.types import Mode
from planning.clearing.fake_table import (
    BIN,
    HERE,
    IN_BIN,
    SIDE,
    TALL,
    A,
    B,
    grasp_at,
    over_bin,
    pick,
    run,
    table,
)

FELL = (0.45, 0.2)  # beside the bin


def with_one_beside(*seen):
    """Return a run in which a thing lies beside the bin after two were let go there.

    Args:
        seen: Where the first one is seen in the bin.
    """
    result = run(A, B, FELL, shown=table(A, B))
    result.show_bin()
    pick(result, after=table(B))
    result.until(Mode.GRASP)
    result.show_bin(*seen)
    pick(result, after=table(FELL))
    result.until(Mode.GRASP)
    return result


@pytest.mark.parametrize("seen_before", [True, False])
@pytest.mark.parametrize("seen_again", [True, False])
@pytest.mark.parametrize("other", [(0.35, 0.25), IN_BIN])
def test_what_fell_out_of_the_bin_counts_once(seen_before, seen_again, other):
    fell = with_one_beside(*[IN_BIN] * seen_before)
    higher = 2 * TALL  # so the bin holds no less than before
    fell.show_bin(other, tall=higher)
    pick(fell, after=table())
    fell.until(Mode.VERIFY)
    fell.show_bin(other, *[(0.15, 0.25)] * seen_again, tall=higher)
    fell.until(Mode.DONE)
    assert fell.motions.taken == [A, B, FELL]
    assert fell.status.cycles == 1 + seen_again
    assert len(fell.status.left) == (not seen_again)


@pytest.mark.parametrize("seen", [True, False])
def test_what_rolled_beside_the_bin_counts_where_no_load_is_missed(seen):
    """A brick that had come to lie there was never counted."""
    rolled = with_one_beside(IN_BIN)
    both = IN_BIN, (0.35, 0.25)
    rolled.show_bin(*both)
    pick(rolled, after=table())
    rolled.until(Mode.VERIFY)
    rolled.show_bin(*both, *[(0.15, 0.25)] * seen)
    rolled.until(Mode.DONE)
    assert rolled.motions.taken == [A, B, FELL]
    assert (rolled.status.cycles, len(rolled.status.left)) == (2 + seen, not seen)


def fell_out(memory, there, after):
    """Return whether what a pick takes fell out, by the map after it."""
    volume = there.load(after, felt=True).volume
    return memory.fell_out(there, volume, after)


def test_what_lay_beside_the_bin_from_the_first_has_not_fallen_out():
    def has_come(first):
        pick_there = dc.replace(over_bin(table(FELL), BIN), grasp=grasp_at(FELL))
        memory = ClearingMemory(HERE, view=View(lowest=first))
        return fell_out(memory, pick_there, table())

    assert not has_come(None)
    assert not has_come(table(FELL, A))
    assert has_come(table(A))
    # Pushed by 15 mm, a bowl was once taken for a box that had toppled in the bin.
    assert not has_come(table((FELL[0] + 0.015, FELL[1]), A))


def test_what_fell_where_another_thing_was_taken_has_fallen_out():
    """The lowest heights of all maps count, not those of the first."""
    maps = table(FELL, A), table(A), table(FELL)
    least = None
    for seen in maps:
        least = lowest(seen, least)
    pick_there = dc.replace(over_bin(table(FELL), BIN), grasp=grasp_at(FELL))
    memory = ClearingMemory(HERE, view=View(lowest=least))
    assert fell_out(memory, pick_there, table())
    np.testing.assert_array_equal(
        least.height, np.minimum(*(m.height for m in maps[1:]))
    )


@pytest.mark.parametrize(
    ("received", "left", "expected"),
    [
        ((), True, False),
        ((1.0,), True, True),
        ((1.0,), False, False),
        ((0.5, 2.0), True, False),
    ],
)
def test_what_rolled_away_is_known_by_its_volume(received, left, expected):
    """A pitcher that leaned on the rim fell out later, and was counted twice.

    Two wrenches from a heap beside the bin were taken for one.
    """
    bin_ = dc.replace(BIN, low=np.array([0.3, 0.1]), rim=0.12)
    far = (bin_.low[0] - 0.25, 0.2)
    there = dc.replace(over_bin(table(far), bin_), grasp=grasp_at(far))
    loads = [
        Load(
            destination=bin_,
            volume=share * SIDE**2 * TALL,
            height=TALL,
            verdict=Verdict.ARRIVED,
            before=table(B),
            after=table(B, IN_BIN),
        )
        for share in received
    ]
    memory = ClearingMemory(
        HERE,
        view=View(lowest=table(A)),
        loads=Loads(tuple(loads), table() if left else table(IN_BIN)),
    )
    assert fell_out(memory, there, table()) == expected


def test_what_slipped_out_of_the_hand_beside_the_bin_counts_once_it_is_in_it():
    """As it had not been felt, it was taken for a load that had counted before."""
    slipped = run(A, FELL, shown=table(A))
    slipped.show_bin()
    pick(slipped, after=table(), felt=False)
    slipped.until(Mode.VERIFY)
    slipped.show(table(FELL))
    slipped.show_bin(FELL)
    pick(slipped, after=table())
    slipped.until(Mode.VERIFY)
    slipped.show_bin(IN_BIN)
    slipped.until(Mode.DONE)
    assert slipped.motions.taken == [A, FELL]
    assert slipped.status.cycles == 1
    assert slipped.status.left == ()


def test_an_empty_hand_beside_the_bin_has_found_no_load():
    """A load that had only rolled within the bin was reported as dropped."""
    empty = with_one_beside(IN_BIN)
    empty.show_bin((0.15, 0.25), (0.35, 0.25), tall=1.5 * TALL)  # the first rolled
    pick(empty, after=table(FELL), felt=False)
    assert (empty.status.cycles, empty.status.left) == (2, ())
