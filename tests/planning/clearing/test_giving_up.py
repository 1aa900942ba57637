"""What the planner leaves, and what it says about that."""

import dataclasses as dc

import numpy as np
import pytest

from drake_srg.types import Failure, Mode
from planning.clearing.fake_table import CONFIG, A, B, pick, run, table

BETWEEN = np.arange(0.1, 0.4, 0.03)  # x of squares that touch each other [m]


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
    # Such as all around the rim of a plate.
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
    # As many grasps of one thing as the planner plans motions for, and one of another.
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
    assert "something is in its way" in blocked.status.message
