"""Single modes: what they command as they begin, and what they observe."""

import copy
import dataclasses as dc

import numpy as np
import pytest

from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.pick_and_place.knowledge import (
    Attempt,
    Cycle,
    PlannerMemory,
    Senses,
    Totals,
)
from drake_srg.planning.pick_and_place.modes import task_modes
from drake_srg.planning.pick_and_place.sightings import View
from drake_srg.planning.planner_machine import Observation, PlannerConfig
from drake_srg.planning.state_machine import Entry, Moment
from drake_srg.types import Failure, Mode
from planning.planning_world import MODES, MOVING, FakeTaskPlanner

PLANNER = FakeTaskPlanner()
TASK = PLANNER.plan(PLANNER.q_home, None, None, None)
GRASP = TASK.grasp
ENDS = [Mode.DONE, Mode.FAILED]
UNDER_WAY = [mode for mode in MODES if mode not in ENDS]
NOW = 7.0  # s


class NoReplanner:
    """Finds no escape, and must not be asked for anything else."""

    def escape(self, memory, time):
        memory.attempt.trapped = True


def modes(repeat=1, **config):
    return task_modes(PlannerConfig(**config), NoReplanner(), repeat)


def senses(q=PLANNER.q_home, **changes):
    """Return the senses of an arm at home with open fingers."""
    measured = Senses(
        q=np.array(q),
        fingers=np.zeros(4),
        finger_speeds=np.zeros(4),
        grasped=False,
        proximity=np.full(4, 0.05),
        see=lambda: View([]),
    )
    return dc.replace(measured, **changes)


def begin(mode, memory, previous=Mode.IDLE, **config):
    entry = Entry(NOW, senses(), previous, Observation())
    return modes(**config)[mode].enter(copy.copy(memory), entry)


def observe(mode, memory, time=NOW, felt=None, **config):
    return modes(**config)[mode].observe(memory, Moment(time, felt or senses()))


@pytest.fixture
def memory():
    """Return the memory of an arm at home with a plan, one attempt under way."""
    return PlannerMemory(
        Motion(PLANNER.q_home),
        attempt=Attempt(motions=TASK, ready_at=0.0),
        cycle=Cycle(started=NOW, attempts=1),
        totals=Totals(attempts=1),
    )


def test_there_is_one_object_per_mode():
    made = modes()
    assert list(made) == MODES
    assert all(actions.mode is mode for mode, actions in made.items())


@pytest.mark.parametrize("mode", MODES)
def test_only_three_modes_command_the_fingers_as_they_begin(memory, mode):
    commanded = {
        Mode.PRE_GRASP: GRASP.closure_open,
        Mode.CLOSE: GRASP.closure_closed,
        Mode.RELEASE: GRASP.closure_open,
    }
    memory.closure = 0.123
    after = begin(mode, memory, Mode.PLACE)
    assert after.closure == commanded.get(mode, 0.123)


@pytest.mark.parametrize("mode", UNDER_WAY[1:])
def test_a_mode_begins_its_own_motion_from_where_the_arm_is(memory, mode):
    motion = begin(mode, memory, Mode.PLACE).motion
    assert motion.trajectory is TASK.motions.get(mode)
    assert (motion.trajectory is None) == (mode not in MOVING)
    np.testing.assert_array_equal(motion.q_rest, PLANNER.q_home)
    assert motion.departed == NOW


def test_only_grasp_counts_attempts(memory):
    for mode in MODES:
        after = begin(mode, memory, Mode.VERIFY)
        expected = 2 if mode is Mode.GRASP else 1
        assert after.totals.attempts == after.cycle.attempts == expected


@pytest.mark.parametrize("mode", UNDER_WAY)
def test_a_spent_time_budget_and_a_touch_are_observed_in_every_mode(memory, mode):
    late = observe(mode, memory, NOW + 10.01, time_budget=10.0)
    assert late == Observation(failure=Failure.TIME_BUDGET)
    memory.trouble.touched = "a wall"
    assert observe(mode, memory) == Observation(failure=Failure.STOPPED)


@pytest.mark.parametrize("mode", ENDS)
def test_the_ends_observe_nothing_and_stop_nothing(memory, mode):
    touched = senses(external_torque=np.full(2, 99.0))
    moving = begin(Mode.HOME, memory)
    made = modes(time_budget=0.1, max_external_torque=[1.0, 1.0])[mode]
    after = made.update(copy.copy(moving), Moment(99.0, touched))
    assert after.motion is moving.motion
    assert not after.trouble.touched
    assert made.observe(moving, Moment(99.0, touched)) == Observation()


@pytest.mark.parametrize("mode", MOVING)
def test_an_arm_that_does_not_follow_is_stopped_by_something(memory, mode):
    moving = begin(mode, memory)
    away = senses(q=[9.0, 9.0])
    for delay, failure in ((0.4, None), (0.6, Failure.STOPPED)):
        time = moving.motion.due + delay
        observed = observe(mode, moving, time, away, arrival_timeout=0.5)
        assert observed == Observation(failure=failure)
    there = senses(q=moving.motion.destination)
    assert observe(mode, moving, moving.motion.due, there).arrived


@pytest.mark.parametrize(
    ("previous", "lost", "failure"),
    [
        (Mode.VERIFY, False, Failure.NO_GRASP),
        (Mode.LIFT, False, Failure.DROPPED),
        (Mode.TRANSFER, True, Failure.DROPPED),
        (Mode.PLACE, True, Failure.DROPPED),
        (Mode.PLACE, False, None),
    ],
)
def test_releasing_an_object_that_was_lost_is_a_failure(
    memory, previous, lost, failure
):
    memory.attempt.lost = lost
    after = begin(Mode.RELEASE, memory, previous)
    assert after.trouble.failure is failure
    assert after.cycle.tried == ((GRASP.name,) if failure else ())
    # Without an escape, the mode ends at once.
    expected = Observation(failure=failure) if failure else None
    assert modes()[Mode.RELEASE].observe_entry(after) == expected


@pytest.mark.parametrize(
    ("at_goal", "before", "after"),
    [
        (True, None, None),
        (True, Failure.DROPPED, None),  # onto its goal
        (False, None, Failure.MISPLACED),
        (False, Failure.DROPPED, Failure.DROPPED),
        (None, Failure.NO_GRASP, Failure.NO_GRASP),
    ],
)
def test_the_end_of_an_attempt_judges_it_and_forgets_its_plan(
    memory, at_goal, before, after
):
    memory.attempt.at_goal, memory.trouble.failure = at_goal, before
    ended = begin(Mode.IDLE, memory, Mode.HOME)
    assert ended.trouble.failure is after
    assert bool(ended.trouble.message) == (after is not None)
    assert ended.totals.cycles == (1 if at_goal else 0)
    assert ended.cycle.attempts == (0 if at_goal else 1)
    assert ended.attempt == Attempt(began=NOW, next_look=NOW)


def test_the_last_attempt_and_the_last_cycle_are_observed_at_home(memory):
    home = begin(Mode.HOME, memory)
    there, due = senses(q=home.motion.destination), home.motion.due
    for attempts, failure in ((1, Failure.MISPLACED), (2, None)):
        observed = observe(Mode.HOME, home, due, there, max_attempts=attempts)
        assert observed.failure is failure
    for repeat, last in ((1, True), (2, False)):
        observed = observe(Mode.HOME, home, due, there, repeat=repeat)
        assert observed.last_cycle == last


def test_copies_of_the_memory_share_what_never_changes(memory):
    assert copy.deepcopy(memory) is memory


def test_a_failure_is_reported_when_the_task_has_failed(memory):
    memory.trouble.failure, memory.trouble.message = Failure.DROPPED, "lost"
    assert memory.status(Mode.FAILED).failure is Failure.DROPPED
    assert memory.status(Mode.RETREAT).failure is None
    assert memory.status(Mode.RETREAT).message == "lost"
