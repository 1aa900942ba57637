"""What the planner claims of loads that it has dropped, and what it sees of them."""

import dataclasses as dc

import numpy as np
import pytest

from drake_srg.planning.clearing.choosing import PickPlanner
from drake_srg.planning.clearing.destination import AROUND
from drake_srg.planning.clearing.knowledge import ClearingMemory
from drake_srg.planning.clearing.loads import Loads
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
    over_bin,
    pick,
    run,
    table,
)


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
    """It is where the next grasp is; what the camera sees elsewhere counts.

    A load that was felt would be in the bin all the same.
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
    # It had been lost, and is no longer.
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
    # It may never have been in the hand, so nothing has been lost.
    assert (thin.status.cycles, thin.status.left) == (cycles + 1, ())


@pytest.mark.parametrize(("seen", "cycles"), [((IN_BIN,), 1), ((), 0)])
def test_what_the_map_missed_counts_once_it_is_seen_in_the_bin(seen, cycles):
    """More rises elsewhere, because what touched the load has moved."""
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
    # What leaves its place shows, beside the bin, too, and so does what rises far off.
    small = dc.replace(BIN, low=np.zeros(2), high=np.full(2, 0.02), rim=0.12)
    seen = over_bin(before, small).without_load(table(far))
    np.testing.assert_array_equal(seen.height, table(far).height)


def test_the_end_of_the_hand_over_the_bin_is_no_thing_on_the_table():
    """It was cut off at the limit of what is left out, and picked."""
    before = table(A)
    small = dc.replace(
        BIN, low=np.array([0.35, 0.3]), high=np.array([0.4, 0.35]), rim=0.12
    )
    limit, after = small.low[0] - AROUND, table()
    x, y = np.moveaxis(after.middles(), -1, 0)
    after.height[(x > limit - 0.02) & (x < limit + 0.15) & (y > 0.3)] = TALL
    seen = over_bin(before, small).without_load(after)
    np.testing.assert_array_equal(seen.height, table().height)


def test_what_was_pushed_towards_the_bin_shows_as_a_whole():
    """Cut off at the limit of what is left out, a wide box looked narrow enough."""
    before, after = table(A), table()
    small = dc.replace(
        BIN, low=np.array([0.35, 0.3]), high=np.array([0.4, 0.35]), rim=0.12
    )
    limit = small.low[0] - AROUND  # of what is near the bin
    middles = after.middles()
    pushed = (np.abs(middles[..., 0] - limit) < 0.06) & (middles[..., 1] > 0.3)
    after.height[pushed] = TALL
    seen = over_bin(before, small).without_load(after)
    np.testing.assert_array_equal(seen.height, after.height)


def test_what_is_hidden_beside_something_leaves_with_the_rest():
    before, after = table(A, (0.3, 0.1)), table((0.3, 0.1))
    gap = after.middles()[..., 0] > 0.3
    gap &= after.middles()[..., 0] < 0.32
    after.height[gap] = np.nan
    strip = np.abs(after.middles() - A).max(axis=-1) < 0.5 * SIDE
    strip &= after.middles()[..., 0] > A[0] + 0.3 * SIDE
    after.height[strip] = np.nan
    seen = over_bin(before).without_load(after)
    assert not np.any(seen.height[strip] > 0.0)
    np.testing.assert_array_equal(seen.height[gap], before.height[gap])


class Watched(Grasps):
    """Remembers the map that it was given last."""

    def plan(self, height_map, **rest):
        self.seen = height_map
        return super().plan(height_map, **rest)


@pytest.mark.parametrize("crosses", [True, False])
def test_what_sticks_out_of_the_bin_stays_there(crosses):
    """A hammer in the bin was picked up by its handle seven times."""
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
