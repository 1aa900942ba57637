"""The planner's conclusions about released loads, and about things beside the bin."""

import dataclasses as dc

import numpy as np
import pytest

from drake_srg.planning.clearing.choosing import PickPlanner
from drake_srg.planning.clearing.destination import AROUND
from drake_srg.planning.clearing.knowledge import ClearingMemory, View
from drake_srg.planning.clearing.loads import Load, Loads, Verdict
from drake_srg.planning.clearing.maps import lowest
from drake_srg.types import Failure, Mode
from planning.clearing.fake_table import (
    ASIDE,
    BESIDE,
    BIN,
    CONFIG,
    HERE,
    HOME,
    IN_BIN,
    SIDE,
    TALL,
    A,
    B,
    Grasps,
    Motions,
    grasp_at,
    over_bin,
    pick,
    run,
    table,
)

FELL = (0.45, 0.2)  # beside the bin


def test_a_load_counts_once_it_is_seen_in_the_bin():
    both = run(A, B)
    both.show_bin()
    pick(both, after=table(B))
    assert both.status.cycles == 0
    both.until(Mode.GRASP)
    both.show_bin(IN_BIN)
    pick(both, after=table())
    assert both.status.cycles == 1
    both.until(Mode.VERIFY)
    both.show_bin(IN_BIN, (0.3, 0.2))
    both.until(Mode.HOME)
    arm = both.planner.GetOutputPort("position_commanded")
    np.testing.assert_allclose(arm.Eval(both.context), ASIDE, atol=0.5)
    both.until(Mode.DONE)
    assert (both.status.cycles, both.status.left) == (2, ())
    np.testing.assert_allclose(arm.Eval(both.context), HOME)


@pytest.mark.parametrize("others", [0, 1])
def test_several_things_in_one_grasp_are_told_and_count_once(others):
    near = (A[0] + 0.09, A[1])  # between the fingers, too
    two = run(A, shown=table(A, *[near] * others))
    two.show_bin()
    pick(two, after=table())
    two.until(Mode.VERIFY)
    two.show_bin(IN_BIN, *[(0.3, 0.2)] * others)
    two.until(Mode.DONE)
    assert (two.status.cycles, two.status.multi_object_picks) == (1, others)


@pytest.mark.parametrize("seen", [(), (BESIDE,)])
def test_what_is_not_seen_in_the_bin_is_told(seen):
    both = run(A, B)
    both.show_bin()
    pick(both, after=table(B))
    both.until(Mode.GRASP)
    both.show_bin(*seen)
    pick(both, after=table())
    both.until(Mode.VERIFY)
    both.show_bin(*seen, IN_BIN)
    both.until(Mode.DONE)
    assert both.status.cycles == 1
    assert [left.failure for left in both.status.left] == [Failure.DROPPED]


@pytest.mark.parametrize(("hand", "seen"), [((0.45, 0.38), 1), ((0.45, 0.2), 0)])
def test_the_hand_itself_is_no_load_beside_the_bin(hand, seen):
    """Only things away from the hand at the next grasp count as loads beside the bin.

    A load that was felt would still be in the bin.
    """
    near = (0.45, 0.38)
    both = run(A, near)
    both.show_bin()
    pick(both, after=table(near), felt=False)
    both.until(Mode.GRASP)
    both.show_bin(IN_BIN, hand)
    pick(both, after=table())
    assert both.status.cycles == seen


def test_takes_what_fell_beside_the_bin_where_the_arm_has_hidden_it():
    far = (0.45, 0.35)  # such as the arm itself
    fell = run(A, B, far, shown=table(A))
    fell.show_bin()
    hidden = table()
    hidden.height[:, 50:70] = np.nan  # the arm is above
    pick(fell, after=hidden)
    fell.until(Mode.VERIFY)
    fell.show(table(B, far))
    pick(fell, after=table())
    fell.until(Mode.VERIFY)
    fell.show_bin(IN_BIN)
    fell.until(Mode.DONE)
    assert fell.motions.taken == [A, B]
    # The load was lost for a while, and is found again.
    assert (fell.status.cycles, fell.status.left) == (1, ())


def test_nothing_is_looked_for_that_was_not_held():
    empty = run(A, config=dc.replace(CONFIG, max_attempts=1))
    empty.show_bin()
    pick(empty, after=table(A), felt=False)
    empty.until(Mode.DONE)
    assert Mode.VERIFY not in empty.modes


@pytest.mark.parametrize(("seen", "cycles"), [((IN_BIN,), 1), ((), 0)])
def test_what_the_fingers_missed_counts_once_it_is_seen_in_the_bin(seen, cycles):
    thin = run(A, B)
    thin.show_bin()
    pick(thin, after=table(B), felt=False)
    thin.until(Mode.GRASP)
    thin.show_bin(*seen)
    pick(thin, after=table())
    assert thin.status.cycles == cycles
    thin.until(Mode.VERIFY)
    thin.show_bin(*seen, (0.3, 0.2))
    thin.until(Mode.DONE)
    # A load that was never felt is not reported as lost.
    assert (thin.status.cycles, thin.status.left) == (cycles + 1, ())


@pytest.mark.parametrize(("seen", "cycles"), [((IN_BIN,), 1), ((), 0)])
def test_what_the_map_missed_counts_once_it_is_seen_in_the_bin(seen, cycles):
    """The map hides the loss: a thing that touched the load has moved and rises."""
    touching = run(A, B)
    touching.show_bin()
    pick(touching, after=table(B, (0.45, 0.05), (0.45, 0.35)))
    touching.until(Mode.GRASP)
    touching.show_bin(*seen)
    pick(touching, after=table())
    assert touching.status.cycles == cycles
    touching.until(Mode.VERIFY)
    touching.show_bin(*seen, (0.3, 0.2))
    touching.until(Mode.DONE)
    assert (touching.status.cycles, touching.status.left) == (cycles + 1, ())


def test_a_load_in_the_hand_is_no_thing_beside_the_bin():
    far = (0.45, 0.05)
    before = table(A, B)
    beside = (BIN.high[0] + 0.03, 0.35)
    seen = over_bin(before).without_load(table(B, beside))
    np.testing.assert_array_equal(seen.height, table(B).height)
    # Falls show even beside the bin, and so do rises far from it.
    small = dc.replace(BIN, low=np.zeros(2), high=np.full(2, 0.02), rim=0.12)
    seen = over_bin(before, small).without_load(table(far))
    np.testing.assert_array_equal(seen.height, table(far).height)


def test_the_end_of_the_hand_over_the_bin_is_no_thing_on_the_table():
    """Regression: an end beyond the region near the bin was taken for a thing."""
    before = table(A)
    small = dc.replace(
        BIN, low=np.array([0.35, 0.3]), high=np.array([0.4, 0.35]), rim=0.12
    )
    limit, after = small.low[0] - AROUND, table()
    x, y = np.moveaxis(after.centers(), -1, 0)
    after.height[(x > limit - 0.02) & (x < limit + 0.15) & (y > 0.3)] = TALL
    seen = over_bin(before, small).without_load(after)
    np.testing.assert_array_equal(seen.height, table().height)


def test_what_was_pushed_towards_the_bin_shows_as_a_whole():
    """Regression: a wide box at the edge of that region looked narrow enough."""
    before, after = table(A), table()
    small = dc.replace(
        BIN, low=np.array([0.35, 0.3]), high=np.array([0.4, 0.35]), rim=0.12
    )
    limit = small.low[0] - AROUND  # edge of the region near the bin
    middles = after.centers()
    pushed = (np.abs(middles[..., 0] - limit) < 0.06) & (middles[..., 1] > 0.3)
    after.height[pushed] = TALL
    seen = over_bin(before, small).without_load(after)
    np.testing.assert_array_equal(seen.height, after.height)


def test_what_is_hidden_beside_something_leaves_with_the_rest():
    before, after = table(A, (0.3, 0.1)), table((0.3, 0.1))
    gap = after.centers()[..., 0] > 0.3
    gap &= after.centers()[..., 0] < 0.32
    after.height[gap] = np.nan
    strip = np.abs(after.centers() - A).max(axis=-1) < 0.5 * SIDE
    strip &= after.centers()[..., 0] > A[0] + 0.3 * SIDE
    after.height[strip] = np.nan
    seen = over_bin(before).without_load(after)
    assert not np.any(seen.height[strip] > 0.0)
    np.testing.assert_array_equal(seen.height[gap], before.height[gap])


class Watched(Grasps):
    """Remembers the last map."""

    def plan(self, height_map, **rest):
        self.seen = height_map
        return super().plan(height_map, **rest)


@pytest.mark.parametrize("crosses", [True, False])
def test_what_sticks_out_of_the_bin_stays_there(crosses):
    """Regression: a hammer was picked out of the bin by its handle seven times."""
    low = dc.replace(BIN, rim=0.6 * TALL)
    middle = 0.5 * (BIN.low + BIN.high)[1]
    out, on_rim, in_bin = ((BIN.low[0] + x, middle) for x in (-0.03, 0.0, 0.03))
    grasps, motions = Watched([A]), Motions()
    motions.destination = low
    seen = table(A, out, *[on_rim, in_bin] * crosses)
    memory = ClearingMemory(HERE, loads=Loads(seen=seen))
    PickPlanner(grasps, motions, CONFIG).plan(memory, table(A, out), 0.0)
    cells = grasps.seen.cells(np.array([A, out]))
    shown = grasps.seen.height[tuple(cells.T)] > 0.0
    assert shown.tolist() == [True, not crosses]


def test_things_that_are_set_down_show():
    before, after = table(A), table((0.45, 0.35))
    assert over_bin(before, BIN).without_load(after) is after


def with_one_beside(*seen):
    """Return a run in which, after two releases, a thing lies beside the bin.

    Args:
        seen: Place in the bin at which the first one is seen.
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
    """Regression: a brick that had rolled there was never counted."""
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
    """Return whether the target of a pick fell out earlier, by the map after it."""
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
    # Regression: a bowl that was pushed by 15 mm was taken for a fallen box.
    assert not has_come(table((FELL[0] + 0.015, FELL[1]), A))


def test_what_fell_where_another_thing_was_taken_has_fallen_out():
    """The lowest heights of all maps decide, not those of the first map."""
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
    """Regressions: a pitcher that leaned on the rim fell out, and counted twice.

    Two wrenches from a heap beside the bin were taken for one load.
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
    """Regression: it was not felt, and was taken for a load that had counted."""
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
    """Regression: a load that rolled within the bin was reported as dropped."""
    empty = with_one_beside(IN_BIN)
    empty.show_bin((0.15, 0.25), (0.35, 0.25), tall=1.5 * TALL)  # the first rolled
    pick(empty, after=table(FELL), felt=False)
    assert (empty.status.cycles, empty.status.left) == (2, ())
