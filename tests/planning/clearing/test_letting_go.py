"""How the hand lets go of a load, and what it does with its fingers then."""

import dataclasses as dc

import numpy as np
import pytest

from drake_srg.types import Mode
from planning.clearing.fake_table import (
    BIN,
    CONFIG,
    OUT,
    OVER,
    A,
    B,
    Grasps,
    Motions,
    Run,
    grasp_at,
    pick,
    run,
    table,
)


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
    np.testing.assert_allclose(commanded, q)  # the arm presses no further
    early.feel(False)
    early.until(Mode.RETREAT)
    early.follow = follow
    early.until(Mode.DONE)
    assert early.status.cycles == cycles


@pytest.mark.parametrize(("tolerance", "early"), [(0.5, True), (None, False)])
def test_presses_a_load_no_further_than_it_may(tolerance, early):
    """Loads were pressed on what lay in the bin with up to 700 N."""
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
    """What has slipped up in the hand fits through less than it came in by."""
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
    """What stands in a row, and may not fall, is never let go above it."""
    deep = in_a_bin()
    deep.motions.destination = dc.replace(BIN, rim=rim)
    pick(deep, after=table(B), felt=felt)
    assert (Mode.PLACE in deep.modes) == placed
    closure = deep.planner.GetOutputPort("closure_commanded").Eval(deep.context)
    assert closure == (grasp_at(A).closure_open if placed else 0.0)
    deep.until(Mode.RETREAT if placed else Mode.PRE_GRASP)


def test_bent_tips_are_stretched_on_the_way_to_the_next_grasp():
    """A tip still bent from letting go stood on a hammer, and the hand closed above."""
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
    # What is still bent above the thing closes all the same.
    run = Run(Grasps([A], width=0.06), Motions(), table(A))
    run.fix("gripper_state", bent)
    run.until(Mode.GRASP)
    closure = run.planner.GetOutputPort("closure_commanded")
    assert closure.Eval(run.context) == grasp_at(A).closure_open


def test_fingers_that_are_still_opening_are_waited_for():
    """They touch the load until the pads have left it, and may rest meanwhile."""
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
    """Boxes came up again that stood on bent tips, or had turned between the bases."""
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
