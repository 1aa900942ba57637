"""What the planner does, over tables that change as the test wants."""

import dataclasses as dc

import numpy as np
import pytest

from drake_srg.types import Mode
from planning.clearing.fake_table import (
    CONFIG,
    HELD,
    HOME,
    SIDE,
    A,
    B,
    pick,
    run,
    table,
)


def test_empty_table_is_done():
    empty = run()
    empty.until(Mode.DONE)
    assert empty.status.left == ()
    assert empty.status.attempts == 0


def test_clears_one_thing_after_the_other():
    both = run(A, B)
    pick(both, after=table(B))
    pick(both, after=table())
    both.until(Mode.DONE)
    assert both.motions.taken == [A, B]
    assert (both.status.attempts, both.status.cycles) == (2, 2)
    assert both.status.left == ()
    end = both.planner.GetOutputPort("position_commanded").Eval(both.context)
    np.testing.assert_allclose(end, HOME)


@pytest.mark.parametrize(
    ("felt", "after"),
    [
        (True, table(A)),  # felt in the hand, and still on the table
        (False, table()),  # gone, but not felt in the hand
        (True, table((0.2, 0.1))),  # felt, but only pushed aside
    ],
)
def test_counts_only_what_is_felt_and_gone(felt, after):
    one = run(A)
    pick(one, after=after, felt=felt)
    assert one.status.cycles == 0


@pytest.mark.parametrize(("width", "counted"), [(SIDE, 1), (0.002, 0)])
def test_notices_fingers_that_close_further_on_the_way(width, counted):
    # A load that turns in the hand lets them close too; but for thin ones, the angles
    # still differ from those of an empty hand.
    one = run(A, width=width)
    one.until(Mode.CLOSE)
    one.feel(True)
    one.until(Mode.TRANSFER)
    one.fix("gripper_state", [*(HELD[:4] + CONFIG.slip_closing + 0.01), *np.zeros(4)])
    one.show(table())
    one.until(Mode.RELEASE)
    assert one.status.cycles == counted


def test_waits_until_nothing_moves():
    pouring = run(A)
    for x in (0.1, 0.14, 0.18):
        pouring.show(table((x, 0.1)))
        pouring.simulator.AdvanceTo(pouring.context.get_time() + CONFIG.search_period)
        assert pouring.status.mode is Mode.IDLE
    pouring.show(table(A))
    pouring.until(Mode.PRE_GRASP)
    assert pouring.status.looks > 3


def test_goes_back_when_a_thing_falls_over_while_the_hand_is_coming():
    falling = run(A)
    falling.until(Mode.PRE_GRASP)
    falling.show(table((A[0] + 0.03, A[1])))
    assert falling.until(Mode.RETREAT, Mode.GRASP) is Mode.RETREAT
    assert falling.status.attempts == 0
    falling.show(table(A))
    pick(falling, after=table())
    falling.until(Mode.DONE)
    assert falling.status.attempts == falling.status.cycles == 1


def test_goes_back_only_once_for_a_pick():
    rocking = run(A)
    for end in (Mode.RETREAT, Mode.GRASP):
        rocking.show(table(A))
        rocking.until(Mode.PRE_GRASP)
        rocking.show(table((A[0] + 0.03, A[1])))
        assert rocking.until(Mode.RETREAT, Mode.GRASP) is end


@pytest.mark.parametrize(("home_wait", "longer"), [(0.5, False), (30.0, True)])
def test_waits_at_home_until_the_last_load_has_settled(home_wait, longer):
    one = run(A, config=dc.replace(CONFIG, home_wait=home_wait))
    pick(one, after=table())
    released = one.context.get_time()
    one.until(Mode.HOME)
    gone = one.context.get_time()
    one.until(Mode.DONE, limit=60.0)
    done = one.context.get_time()
    if longer:
        assert done == pytest.approx(released + home_wait, abs=0.15)
    else:  # the way home alone takes longer
        assert done - gone < 1.0 + 0.15


def test_closes_where_something_stops_the_fingers():
    shallow = run(A)
    shallow.until(Mode.GRASP)
    shallow.follow = lambda: None
    assert shallow.until(Mode.CLOSE, Mode.FAILED) is Mode.CLOSE
