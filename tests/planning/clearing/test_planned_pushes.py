"""When the planner pushes a heap, and when it stops."""

import dataclasses as dc

import numpy as np
import pytest

from drake_srg.types import Failure, Mode
from planning.clearing.fake_table import (
    CONFIG,
    OVER,
    Grasps,
    Motions,
    Pushes,
    Run,
    pick,
    table,
)

A, B = (0.1, 0.1), (0.3, 0.2)


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
    """The pushes since then have not helped, and would not help again."""
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
    """A plate was pressed into a box by 500 N, and never came out again."""
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
