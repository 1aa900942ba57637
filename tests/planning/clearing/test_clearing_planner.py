"""The planner over tables that change: its picks, pushes, and giving up."""

import dataclasses as dc

import numpy as np
import pytest

from drake_srg.planning.planner_machine import SEARCH_PERIOD, SLIP_CLOSING
from drake_srg.types import Failure, Mode
from planning.clearing.fake_table import (
    BIN,
    CONFIG,
    HELD,
    HOME,
    OUT,
    OVER,
    SIDE,
    A,
    B,
    Grasps,
    Motions,
    Pushes,
    Run,
    grasp_at,
    pick,
    run,
    table,
)

BETWEEN = np.arange(0.1, 0.4, 0.03)  # x of squares that touch each other [m]


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
    # Fingers also close if a load turns in the hand. Unless the load is thin, their
    # angles still differ from those of an empty hand.
    one = run(A, width=width)
    one.until(Mode.CLOSE)
    one.feel(True)
    one.until(Mode.TRANSFER)
    one.fix("gripper_state", [*(HELD[:4] + SLIP_CLOSING + 0.01), *np.zeros(4)])
    one.show(table())
    one.until(Mode.RELEASE)
    assert one.status.cycles == counted


def test_waits_until_nothing_moves():
    pouring = run(A)
    for x in (0.1, 0.14, 0.18):
        pouring.show(table((x, 0.1)))
        pouring.simulator.AdvanceTo(pouring.context.get_time() + SEARCH_PERIOD)
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


@pytest.mark.parametrize(("mode", "cycles"), [(Mode.TRANSFER, 0), (Mode.PLACE, 1)])
def test_a_load_that_stands_early_is_placed(mode, cycles):
    early = run(A)
    early.motions.places = True
    early.until(Mode.CLOSE)
    early.feel(True)
    early.until(mode)
    follow, early.follow = early.follow, lambda: None
    early.show(table())
    early.until(Mode.RELEASE)
    q = early.planner.GetInputPort("arm_state").Eval(early.context)[:2]
    commanded = early.planner.GetOutputPort("position_commanded").Eval(early.context)
    np.testing.assert_allclose(commanded, q)  # the arm stops pressing
    early.feel(False)
    early.until(Mode.RETREAT)
    early.follow = follow
    early.until(Mode.DONE)
    assert early.status.cycles == cycles


@pytest.mark.parametrize(("tolerance", "early"), [(0.5, True), (None, False)])
def test_presses_a_load_no_further_than_it_may(tolerance, early):
    """Regression: loads were pressed on others in the bin with up to 700 N."""
    pressed = run(A, config=dc.replace(CONFIG, path_tolerance=tolerance))
    pressed.motions.places = True
    pressed.until(Mode.CLOSE)
    pressed.feel(True)
    pressed.until(Mode.PLACE)
    start = pressed.context.get_time()
    pressed.follow = lambda: None
    pressed.until(Mode.RELEASE)
    assert (pressed.context.get_time() - start < 1.0) == early  # a fake motion's second


@pytest.mark.parametrize("places", [False, True])
def test_opens_fully_where_nothing_stands_beside_the_load(places):
    """An object that has slipped up in the hand needs a wider opening."""
    only = run(A)
    only.motions.places = places
    pick(only, after=table())
    closure = only.planner.GetOutputPort("closure_commanded").Eval(only.context)
    assert closure == (grasp_at(A).closure_open if places else 0.0)


def test_retreats_with_the_hand_as_open_as_it_is():
    given = []
    wide = run(A, B)
    wide.motions.places = True
    retreat = wide.motions.plan_retreat
    wide.motions.plan_retreat = lambda q, fingers: (
        given.append(fingers) or retreat(q, fingers)
    )
    for half_gap, after, felt in ((0.05, table(A, B), False), (0.03, table(B), True)):
        wide.grasps.half_gap = half_gap
        wide.until(Mode.IDLE, Mode.PRE_GRASP)
        pick(wide, after=after, felt=felt)
        wide.until(Mode.RETREAT)
    assert given == [grasp_at(A, half_gap=gap).fingers_open for gap in (0.05, 0.03)]


def in_a_bin(way_out=OUT):
    """Return a run that lays loads down in a bin with a rim."""
    deep = run(A, B)
    deep.motions.places, deep.motions.way_out = True, way_out
    deep.motions.destination = dc.replace(BIN, rim=0.1)
    return deep


def test_plans_the_next_pick_before_it_leaves_the_bin():
    deep = in_a_bin()
    pick(deep, after=table(B), felt=True)
    deep.until(Mode.RETREAT)
    looks = deep.status.looks
    deep.until(Mode.PRE_GRASP)
    assert deep.status.looks == looks
    np.testing.assert_allclose(deep.motions.starts[-1], OUT)
    deep.until(Mode.GRASP)


@pytest.mark.parametrize("rim", [0.1, None])
def test_goes_up_all_the_way_out_of_a_row_or_where_it_must(rim):
    deep = in_a_bin(way_out=None)
    deep.motions.destination = dc.replace(BIN, rim=rim)
    pick(deep, after=table(B), felt=True)
    deep.until(Mode.RETREAT)
    deep.until(Mode.PRE_GRASP)
    np.testing.assert_allclose(deep.motions.starts[-1], OVER)


@pytest.mark.parametrize(
    ("rim", "felt", "placed"),
    [(0.1, True, True), (0.1, False, False), (None, False, True)],
)
def test_an_empty_hand_does_not_go_down_in_a_bin(rim, felt, placed):
    """Over a row, where nothing may fall, the hand always goes down."""
    deep = in_a_bin()
    deep.motions.destination = dc.replace(BIN, rim=rim)
    pick(deep, after=table(B), felt=felt)
    assert (Mode.PLACE in deep.modes) == placed
    closure = deep.planner.GetOutputPort("closure_commanded").Eval(deep.context)
    assert closure == (grasp_at(A).closure_open if placed else 0.0)
    deep.until(Mode.RETREAT if placed else Mode.PRE_GRASP)


def test_bent_tips_are_stretched_on_the_way_to_the_next_grasp():
    """Regression: a tip that was still bent stood on a hammer and missed it."""
    run = Run(Grasps([A], width=0.06), Motions(), table(A))
    closure = run.planner.GetOutputPort("closure_commanded")
    bent = np.array([0.5, 0.5, 0.0, 0.4, 0.0, 0.0, 0.0, 0.0])
    run.fix("gripper_state", bent)
    run.until(Mode.PRE_GRASP)
    assert closure.Eval(run.context) == 0.0
    run.simulator.AdvanceTo(run.context.get_time() + 0.1)
    assert closure.Eval(run.context) == 0.0
    run.fix("gripper_state", np.zeros(8))
    run.simulator.AdvanceTo(run.context.get_time() + 0.1)
    assert closure.Eval(run.context) == grasp_at(A).closure_open > 0.0
    # Tips that are still bent over the thing do not delay the grasp for ever.
    run = Run(Grasps([A], width=0.06), Motions(), table(A))
    run.fix("gripper_state", bent)
    run.until(Mode.GRASP)
    closure = run.planner.GetOutputPort("closure_commanded")
    assert closure.Eval(run.context) == grasp_at(A).closure_open


def test_fingers_that_are_still_opening_are_waited_for():
    """Until the pads have left the load, fingers touch it, and may briefly rest."""
    held = run(A, config=dc.replace(CONFIG, gripper_timeout=2.0))
    held.motions.places = True
    closure = held.planner.GetOutputPort("closure_commanded")
    pick(held, after=table())
    start = held.context.get_time()
    held.fix("proximity", np.zeros(4))
    held.simulator.AdvanceTo(start + 0.5)
    assert closure.Eval(held.context) == grasp_at(A).closure_open
    held.feel(False)
    held.until(Mode.RETREAT)
    assert closure.Eval(held.context) == grasp_at(A).closure_open


@pytest.mark.parametrize(
    ("tip", "near"), [(0.6, 0.01), (0.0, 0.0)], ids=["bent", "wedged"]
)
def test_opens_fully_where_it_would_lift_what_it_has_set_down(tip, near):
    """Regression: boxes on bent tips, or turned between the bases, came up again."""
    held = run(A, config=dc.replace(CONFIG, gripper_timeout=2.0))
    held.motions.places = True
    closure = held.planner.GetOutputPort("closure_commanded")
    pick(held, after=table())
    start = held.context.get_time()
    held.fix("gripper_state", [0.3, 0.1, 0.0, tip, 0.0, 0.0, 0.0, 0.0])
    held.fix("proximity", [near, 0.01, 0.01, 0.01])
    held.simulator.AdvanceTo(start + 0.9)
    assert closure.Eval(held.context) == grasp_at(A).closure_open
    held.simulator.AdvanceTo(start + 1.5)
    assert held.status.mode is Mode.RELEASE
    assert closure.Eval(held.context) == 0.0
    held.feel(False)
    held.until(Mode.RETREAT)
    assert held.context.get_time() < start + 2.0


def test_leaves_what_fails_too_often():
    config = dc.replace(CONFIG, max_attempts=2)
    stuck = run(A, config=config)
    for _ in range(2):
        pick(stuck, after=table(A), felt=False)
    stuck.until(Mode.DONE)
    (left,) = stuck.status.left
    assert left.failure is Failure.NO_GRASP
    np.testing.assert_allclose(left.p_W[:2], A)


@pytest.mark.parametrize(("joined", "attempts"), [(True, 2), (False, 8)])
def test_grasps_that_are_alike_count_together_on_one_thing(joined, attempts):
    # Alike are, for example, all grasps around the rim of a plate.
    places = [(x, 0.2) for x in (0.1, 0.2, 0.3, 0.4)]
    shown = table(*places, *((x, 0.2) for x in BETWEEN if joined))
    tried = run(*places, shown=shown, config=dc.replace(CONFIG, max_attempts=2))
    for _ in range(attempts):
        pick(tried, after=shown, felt=False)
    tried.until(Mode.DONE)
    assert tried.status.attempts == attempts
    assert {left.failure for left in tried.status.left} == {Failure.NO_GRASP}


@pytest.mark.parametrize("wider", [0.005, 0.02])
def test_grasps_of_another_width_are_tried_on_what_failed(wider):
    places = [(0.1, 0.2), (0.2, 0.2)]
    shown = table(*places, *((x, 0.2) for x in BETWEEN))
    tried = run(*places, shown=shown, config=dc.replace(CONFIG, max_attempts=1))
    tried.until(Mode.CLOSE)
    tried.grasps.width += wider
    tried.until(Mode.DONE)
    assert tried.status.attempts == (2 if wider > 0.01 else 1)


def test_grasps_of_what_is_given_up_leave_room_for_others():
    # One thing has as many grasps as the planner plans motions for, another has one.
    many = run(*[A] * 40, B, config=dc.replace(CONFIG, max_attempts=1))
    pick(many, after=table(A, B), felt=False)
    pick(many, after=table(A))
    many.until(Mode.DONE)
    assert many.motions.taken == [A, B]


@pytest.mark.parametrize("failure", [Failure.TOO_WIDE, Failure.BLOCKED])
def test_says_why_a_thing_stays(failure):
    wide = run(A, B, refused={B: failure})
    pick(wide, after=table(B))
    wide.until(Mode.DONE)
    assert [thing.failure for thing in wide.status.left] == [failure]


def test_names_every_part_of_what_stays():
    # A heap counts as one thing; another one is far away.
    heap, far = [(x, 0.1) for x in (0.1, 0.135, 0.17, 0.205, 0.24)], (0.4, 0.3)
    failures = {A: Failure.TOO_WIDE, far: Failure.OUT_OF_REACH}
    stays = run(A, far, shown=table(*heap, far), refused=failures)
    stays.until(Mode.DONE)
    for place in heap:
        assert any(
            np.linalg.norm(left.p_W[:2] - place) < 0.06
            and left.failure is Failure.TOO_WIDE
            for left in stays.status.left
        )
    assert len(stays.status.left) < 6


def test_passes_over_what_is_out_of_reach():
    far = run(A, B, unreachable=[A])
    pick(far, after=table(A))
    far.until(Mode.DONE)
    assert far.motions.taken == [B]
    assert [thing.failure for thing in far.status.left] == [Failure.OUT_OF_REACH]


def test_gives_up_when_the_time_is_over():
    slow = run(A, config=dc.replace(CONFIG, time_budget=3.0))
    slow.until(Mode.FAILED)
    assert slow.status.failure is Failure.TIME_BUDGET
    assert slow.status.message == "the time budget is used up"


@pytest.mark.parametrize("mode", [Mode.PRE_GRASP, Mode.LIFT, Mode.TRANSFER])
def test_goes_back_and_on_when_something_stops_the_arm(mode):
    stuck = run(A, B)
    stuck.until(mode)
    follow, stuck.follow = stuck.follow, lambda: None
    q_stuck = stuck.planner.GetInputPort("arm_state").Eval(stuck.context)[:2]
    stuck.until(Mode.RELEASE)
    stuck.until(Mode.RETREAT)
    commanded = stuck.planner.GetOutputPort("position_commanded").Eval(stuck.context)
    assert stuck.planner.GetOutputPort("closure_commanded").Eval(stuck.context) < 0.5
    assert np.linalg.norm(commanded - q_stuck) < 0.5
    stuck.follow = follow
    stuck.until(Mode.IDLE)
    pick(stuck, after=table(B))
    pick(stuck, after=table())
    stuck.until(Mode.DONE)
    assert stuck.motions.taken == [A, A, B]
    assert stuck.status.cycles == 2


def test_leaves_what_the_arm_is_stopped_at_too_often():
    stuck = run(A, config=dc.replace(CONFIG, max_attempts=2))
    for _ in range(2):
        stuck.until(Mode.LIFT)
        follow, stuck.follow = stuck.follow, lambda: None
        stuck.until(Mode.RETREAT)
        stuck.follow = follow
    stuck.until(Mode.DONE)
    assert [left.failure for left in stuck.status.left] == [Failure.STOPPED]


def test_gives_up_when_the_arm_does_not_get_back():
    blocked = run(A)
    blocked.until(Mode.LIFT)
    blocked.follow = lambda: None
    blocked.until(Mode.FAILED)
    assert blocked.modes[-2] is Mode.RETREAT
    assert blocked.status.failure is Failure.STOPPED
    assert "something blocks it" in blocked.status.message


def heap(after_push, pushes=2, path_tolerance=None):
    """Return a run with a heap at A that no grasp takes anything from."""
    config = dc.replace(CONFIG, max_attempts=pushes, path_tolerance=path_tolerance)
    grasps = Grasps((A, *after_push), refused={A: Failure.BLOCKED})
    return Run(grasps, Motions(), table(A), config, Pushes())


def test_pushes_a_heap_and_takes_what_that_frees():
    pushed = heap(after_push=[B])
    pushed.until(Mode.PUSH)
    closure = pushed.planner.GetOutputPort("closure_commanded")
    assert closure.Eval(pushed.context) == 1.0
    pushed.show(table(B))
    pushed.until(Mode.IDLE)
    arm = pushed.planner.GetOutputPort("position_commanded").Eval(pushed.context)
    np.testing.assert_allclose(arm, OVER)
    pick(pushed, after=table())
    pushed.until(Mode.DONE)
    assert pushed.modes.count(Mode.PUSH) == 1
    assert (pushed.status.attempts, pushed.status.cycles) == (1, 1)


@pytest.mark.parametrize("pushes", [1, 2])
def test_leaves_a_heap_that_pushes_do_not_change(pushes):
    stays = heap(after_push=[], pushes=pushes)
    stays.until(Mode.DONE)
    assert stays.modes.count(Mode.PUSH) == pushes
    assert stays.pushes.tried[:pushes] == list(range(pushes))
    assert [left.failure for left in stays.status.left] == [Failure.BLOCKED]


def test_a_load_that_is_seen_in_the_end_gives_no_more_pushes():
    """Pushes since the last look have not helped, and would not help again."""
    stays = heap(after_push=[])
    stays.grasps.places = (A, B)
    stays.show(table(A, B))
    stays.show_bin()
    pick(stays, after=table(A))
    stays.show_bin((0.2, 0.2))
    stays.until(Mode.DONE)
    assert stays.status.cycles == 1
    assert stays.modes.count(Mode.PUSH) == stays.config.max_attempts


def test_goes_back_when_something_stops_a_push():
    stuck = heap(after_push=[])
    stuck.until(Mode.PUSH)
    follow, stuck.follow = stuck.follow, lambda: None
    stuck.until(Mode.RETREAT)
    stuck.follow = follow
    assert stuck.until(Mode.IDLE, Mode.FAILED) is Mode.IDLE
    stuck.until(Mode.DONE)


@pytest.mark.parametrize(("tolerance", "early"), [(0.5, True), (3.0, False)])
def test_presses_no_further_than_it_may(tolerance, early):
    """Regression: a plate was pressed into a box by 500 N, and stuck there."""
    stuck = heap(after_push=[], path_tolerance=tolerance)
    stuck.until(Mode.PUSH)
    start = stuck.context.get_time()
    follow, stuck.follow = stuck.follow, lambda: None
    stuck.until(Mode.RETREAT)
    duration = 1.0  # of the fake motion
    assert (stuck.context.get_time() - start < 0.5 * duration) == early
    q = stuck.planner.GetInputPort("arm_state").Eval(stuck.context)[:2]
    commanded = stuck.planner.GetOutputPort("position_commanded").Eval(stuck.context)
    assert np.all(np.abs(commanded - q) < 0.5)  # already on its way back
    stuck.follow = follow
    assert stuck.until(Mode.IDLE, Mode.FAILED) is Mode.IDLE


def test_an_arm_that_follows_is_not_stopped():
    pushed = heap(after_push=[B], path_tolerance=0.5)
    pushed.until(Mode.PUSH)
    pushed.show(table(B))
    pushed.until(Mode.IDLE)
    assert Mode.RETREAT not in pushed.modes
