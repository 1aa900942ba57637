"""Properties of the transitions for any observation; the table itself is data."""

import dataclasses as dc
import functools
import itertools

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from drake_srg.planning.pick_and_place.knowledge import TRANSITIONS, transition
from drake_srg.planning.planner_machine import Observation, PlannerConfig
from drake_srg.types import Failure, Mode
from planning.planning_world import CYCLE, MODES, MOVING

ENDS = {Mode.DONE, Mode.FAILED}
FINAL = {Failure.STOPPED, Failure.TIME_BUDGET}
# The facts that the table depends on.
FLAGS = (
    *("ready", "stuck", "moved", "arrived", "still", "holding", "clear", "at_goal"),
    "last_cycle",
)
LONG = 1e6  # s

failures = st.none() | st.sampled_from(Failure)
observations = st.builds(
    Observation, failure=failures, **{name: st.booleans() for name in FLAGS}
)
waits = st.floats(0.0, 3.0)
configs = st.builds(
    PlannerConfig,
    **dict.fromkeys(
        ("gripper_reaction", "verify_time", "grip_wait", "release_wait"), waits
    ),
    gripper_timeout=st.floats(0.1, 3.0),
)
times = st.floats(0.0, 4.0)
modes = st.sampled_from(MODES)
under_way = st.sampled_from([mode for mode in MODES if mode not in ENDS])


@functools.cache
def all_observations():
    return [
        Observation(failure=failure, **dict(zip(FLAGS, flags, strict=True)))
        for failure in (None, *Failure)
        for flags in itertools.product([False, True], repeat=len(FLAGS))
    ]


@functools.cache
def successors(mode):
    """Modes that may follow a mode, by any observation, at once or after long."""
    observed = itertools.product(all_observations(), (0.0, LONG))
    config = PlannerConfig()
    return {transition(mode, o, t, config) for o, t in observed} - {mode}


def reachable(mode, avoiding=()):
    reached, edge = set(), {mode}
    while edge:
        reached |= edge
        edge = {m for e in edge for m in successors(e)} - reached - set(avoiding)
    return reached


# The graph.


def test_every_mode_has_its_row():
    assert TRANSITIONS.keys() == set(MODES)


@pytest.mark.slow
def test_every_mode_can_be_reached():
    assert reachable(Mode.IDLE) == set(MODES)


@pytest.mark.parametrize("mode", [mode for mode in MODES if mode not in ENDS])
def test_from_every_mode_the_task_can_be_done_and_can_fail(mode):
    assert Mode.DONE in reachable(mode, avoiding=[Mode.FAILED])
    assert Mode.FAILED in successors(mode)


@pytest.mark.parametrize("mode", MODES)
def test_no_row_of_the_table_is_hidden_by_those_above_it(mode):
    assert {following for _, following in TRANSITIONS[mode]} <= successors(mode)


@given(configs)
def test_a_cycle_goes_through_its_modes_in_order_when_all_goes_well(config):
    well = dc.replace(
        Observation(**dict.fromkeys(FLAGS, True)), moved=False, stuck=False
    )
    for mode, following in itertools.pairwise(CYCLE):
        assert transition(mode, well, LONG, config) is following


# Single transitions.


@given(modes, observations, times, times, configs)
def test_a_transition_stays_as_it_is_as_time_goes_on(mode, o, t, later, config):
    following = transition(mode, o, t, config)
    if following is not mode:
        assert transition(mode, o, t + later, config) is following


@given(st.sampled_from(sorted(ENDS, key=str)), observations, times)
def test_the_end_is_the_end(mode, o, t):
    assert transition(mode, o, t) is mode


@given(under_way, observations, times, st.sampled_from(sorted(FINAL, key=str)))
def test_a_stop_and_a_spent_budget_end_every_mode(mode, o, t, failure):
    assert transition(mode, dc.replace(o, failure=failure), t) is Mode.FAILED


@given(under_way, observations, times)
def test_nothing_fails_without_a_failure(mode, o, t):
    assert transition(mode, dc.replace(o, failure=None), t) is not Mode.FAILED


# For some facts in a mode, the mode that follows, whatever the other facts are.
FAILED, WELL = {"failure": Failure.DROPPED}, {"failure": None}
DECIDED = [
    # The task fails without a plan, an escape, a free goal or an attempt left.
    (Mode.IDLE, FAILED, Mode.FAILED),
    (Mode.RELEASE, FAILED, Mode.FAILED),
    (Mode.TRANSFER, {**FAILED, "arrived": True, "holding": True}, Mode.FAILED),
    (Mode.HOME, {**FAILED, "arrived": True, "at_goal": False}, Mode.FAILED),
    # An object that has left the hand is not placed, even if something else fails.
    (Mode.VERIFY, {"holding": False}, Mode.RELEASE),
    (Mode.LIFT, {"arrived": True, "holding": False}, Mode.RELEASE),
    (Mode.TRANSFER, {"arrived": True, "holding": False}, Mode.RELEASE),
    # The planner looks again for an object that has moved.
    (Mode.PRE_GRASP, {"arrived": True, "moved": True}, Mode.IDLE),
    (Mode.PRE_GRASP, {"arrived": False, "moved": True}, Mode.PRE_GRASP),
    # An idle planner waits until it has planned; a stuck arm goes home first.
    (Mode.IDLE, {**WELL, "ready": False, "stuck": False}, Mode.IDLE),
    (Mode.IDLE, {**WELL, "ready": True, "stuck": True}, Mode.PRE_GRASP),
    (Mode.IDLE, {**WELL, "ready": False, "stuck": True}, Mode.RETREAT),
    # At home, the task goes on until it is done.
    (Mode.HOME, {"arrived": True, "at_goal": True, "last_cycle": True}, Mode.DONE),
    (Mode.HOME, {"arrived": True, "at_goal": True, "last_cycle": False}, Mode.IDLE),
    (Mode.HOME, {**WELL, "arrived": True, "at_goal": False}, Mode.IDLE),
]


@pytest.mark.parametrize(("mode", "facts", "following"), DECIDED)
@given(observations, times)
def test_some_facts_decide(mode, facts, following, o, t):
    assume(o.failure not in FINAL)
    if facts.get("failure"):  # any failure
        facts = {**facts, "failure": o.failure or Failure.DROPPED}
    assert transition(mode, dc.replace(o, **facts), t) is following


def test_an_arm_that_goes_home_does_not_look_again_on_its_way():
    assert Mode.IDLE not in successors(Mode.RETREAT)


@given(st.sampled_from(MOVING), observations, times)
def test_a_motion_is_over_when_the_arm_has_arrived(mode, o, t):
    o = dc.replace(o, arrived=False)
    stopped = o.failure in FINAL
    assert transition(mode, o, t) is (Mode.FAILED if stopped else mode)


# For each mode, the one before it, and the facts that lead to it.
NEEDS = {
    Mode.PRE_GRASP: (Mode.IDLE, ["ready"]),
    Mode.LIFT: (Mode.VERIFY, ["holding"]),
    Mode.TRANSFER: (Mode.LIFT, ["holding"]),
    Mode.PLACE: (Mode.TRANSFER, ["holding", "ready"]),
    Mode.DONE: (Mode.HOME, ["at_goal", "last_cycle"]),
}


@given(modes, observations, times)
def test_a_mode_begins_only_on_its_way_and_with_what_it_needs(mode, o, t):
    following = transition(mode, o, t)
    if following is not mode and following in NEEDS:
        before, facts = NEEDS[following]
        assert mode is before
        assert all(getattr(o, fact) for fact in facts)


@given(modes, observations, times)
def test_a_held_object_is_released_only_where_it_is_placed(mode, o, t):
    following = transition(mode, o, t)
    if following is not mode and following is Mode.RELEASE:
        assert mode is Mode.PLACE or not o.holding


# Waits.


@given(observations, configs)
def test_no_mode_waits_for_the_fingers_for_ever(o, config):
    o = dc.replace(o, failure=None)
    longest = config.gripper_timeout + max(
        config.release_wait, config.grip_wait, config.verify_time
    )
    for mode in (Mode.CLOSE, Mode.VERIFY, Mode.RELEASE):
        assert transition(mode, o, longest, config) is not mode


@given(observations, times, configs)
def test_closing_ends_with_a_held_object_or_a_timeout(o, t, config):
    o = dc.replace(o, failure=None)
    following = transition(Mode.CLOSE, o, t, config)
    assert following in (Mode.CLOSE, Mode.VERIFY)
    if following is Mode.VERIFY:
        # Open fingers beside an object rest, too, before they begin to move.
        closed = t >= config.gripper_reaction and o.holding and o.still
        assert closed or t >= config.gripper_timeout


@given(observations, times, configs)
def test_the_arm_lifts_only_after_its_waits(o, t, config):
    if transition(Mode.VERIFY, o, t, config) is Mode.LIFT:
        assert t >= config.verify_time
        assert t >= config.grip_wait


@pytest.mark.slow
@given(observations, times, configs)
def test_the_hand_leaves_only_after_the_fingers_have_let_go(o, t, config):
    o = dc.replace(o, failure=None)
    following = transition(Mode.RELEASE, o, t, config)
    assert following in (Mode.RELEASE, Mode.RETREAT)
    if following is Mode.RETREAT:
        assert t >= config.release_wait
        opened = o.clear and o.still
        assert opened or t >= config.gripper_timeout + config.release_wait


@given(times, configs)
def test_no_mode_waits_for_fingers_that_are_ready(t, config):
    o = Observation(still=True, holding=True, clear=True)
    for mode, least in (
        (Mode.CLOSE, config.gripper_reaction),
        (Mode.VERIFY, max(config.verify_time, config.grip_wait)),
        (Mode.RELEASE, config.release_wait),
    ):
        assert transition(mode, o, least + t, config) is not mode
