"""Properties of every planner for one object: its transitions and its commands."""

import itertools

import numpy as np
import pytest
from helpers import read
from pydrake.common.yaml import yaml_dump_typed

from drake_srg.planning.carrying.config import CarryMode, CarryTogether
from drake_srg.planning.carrying.planner import carry_transition
from drake_srg.planning.clearing.knowledge import transition as clearing_transition
from drake_srg.planning.handover.config import Handover, HandoverMode
from drake_srg.planning.handover.planner import handover_transition
from drake_srg.planning.insertion.config import Insert, InsertMode
from drake_srg.planning.insertion.planner import NOT_INSERTED, insert_transition
from drake_srg.planning.pick_and_place.knowledge import FATAL, transition
from drake_srg.planning.planner_machine import Observation, PlannerConfig
from drake_srg.planning.servoing.planner import servo_transition
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.scenario.typed_yaml import read_typed
from drake_srg.station.planners import MakeCarryPlanner, MakeHandoverPlanner
from drake_srg.types import Failure, Mode

GOES_WELL = Observation(
    ready=True, arrived=True, holding=True, still=True, clear=True, at_goal=True
)
TO_VERIFY = (Mode.IDLE, Mode.PRE_GRASP, Mode.GRASP, Mode.CLOSE, Mode.VERIFY)
FROM_TRANSFER = (Mode.TRANSFER, Mode.PLACE)
FROM_RELEASE = (Mode.RELEASE, Mode.RETREAT, Mode.HOME, Mode.DONE)
PICK = (*TO_VERIFY, Mode.LIFT, *FROM_TRANSFER, *FROM_RELEASE)
GIVING = (HandoverMode.CARRY, HandoverMode.PRESENT)
TAKING = (HandoverMode.APPROACH, HandoverMode.REACH, HandoverMode.TAKE)
PULLING = (HandoverMode.PULL, HandoverMode.LET_GO, HandoverMode.WITHDRAW)
TAKEN = (HandoverMode.CLEAR, HandoverMode.SECURE, HandoverMode.RAISE)
INSERTING = (InsertMode.TILT, InsertMode.SEARCH, InsertMode.SLIDE)
PRESSING = (InsertMode.UPRIGHT, InsertMode.PRESS, InsertMode.RELAX)
# Transitions, configuration, and the order of modes if all goes well.
PLANNERS = {
    "pick and place": (transition, PlannerConfig(), PICK),
    "servoing": (servo_transition, PlannerConfig(), PICK),
    "carrying": (
        carry_transition,
        CarryTogether(),
        (*TO_VERIFY, CarryMode.SETTLE, *PICK[5:]),
    ),
    "handover": (
        handover_transition,
        Handover(),
        (
            *(*TO_VERIFY, Mode.LIFT, *GIVING, *TAKING, *PULLING, *TAKEN),
            *(*FROM_TRANSFER, *FROM_RELEASE),
        ),
    ),
    "insertion": (
        insert_transition,
        Insert(),
        (*PICK[:8], *INSERTING, *PRESSING, *FROM_RELEASE),
    ),
}
# For each planner, modes that open a hand, with the modes in which that hand may lose
# the object.
LOST = {
    "carrying": {Mode.RELEASE: (Mode.VERIFY, CarryMode.SETTLE, Mode.LIFT)},
    "handover": {
        HandoverMode.LET_GO: (Mode.VERIFY, Mode.LIFT, *GIVING),
        Mode.RELEASE: (*TAKING[:2], PULLING[0], *TAKEN[1:], Mode.TRANSFER),
    },
    "insertion": {Mode.RELEASE: (*InsertMode, Mode.PLACE)},
}


@pytest.fixture(params=PLANNERS)
def planner(request):
    transition, config, order = PLANNERS[request.param]
    return lambda mode, o, t=1.0: transition(mode, o, t, config), order, transition


def test_modes_follow_one_another_if_all_goes_well(planner):
    following, order, _ = planner
    for mode, next_mode in itertools.pairwise(order):
        assert following(mode, GOES_WELL) is next_mode


def test_every_mode_waits_for_its_end(planner):
    following, order, _ = planner
    for mode in order:
        if mode is not Mode.VERIFY:
            assert following(mode, Observation(holding=True), t=0.0) is mode


def test_reasons_to_give_up_end_every_mode(planner):
    following, _, transition = planner
    failures = NOT_INSERTED if transition is insert_transition else ()
    for mode, failure in itertools.product(transition.table, (*FATAL, *failures)):
        ended = mode in (Mode.DONE, Mode.FAILED)
        expected = mode if ended else Mode.FAILED
        assert following(mode, Observation(failure=failure)) is expected


@pytest.mark.parametrize(
    ("name", "mode", "after"),
    [
        (name, mode, after)
        for name, rows in LOST.items()
        for after, modes in rows.items()
        for mode in modes
    ],
)
def test_a_hand_that_has_lost_the_object_opens(name, mode, after):
    transition, config, _ = PLANNERS[name]
    assert transition(mode, Observation(arrived=True), 1.0, config) is after


def test_the_lift_of_two_arms_waits_for_its_plan():
    settled = Observation(arrived=True, holding=True)
    assert carry_transition(CarryMode.SETTLE, settled, 1.0) is CarryMode.SETTLE
    trapped = Observation(failure=Failure.OUT_OF_REACH)
    assert carry_transition(CarryMode.SETTLE, trapped, 1.0) is Mode.FAILED


WAITING = {"grip_wait": 3.0, "release_wait": 2.0, "gripper_timeout": 1.0}


@pytest.mark.parametrize("seen", [{}, {"still": True, "clear": True}])
@pytest.mark.parametrize(
    ("transition", "kind", "mode", "wait", "after"),
    [
        (clearing_transition, PlannerConfig, Mode.CLOSE, 3.0, Mode.LIFT),
        (clearing_transition, PlannerConfig, Mode.RELEASE, 2.0, Mode.IDLE),
        (handover_transition, Handover, HandoverMode.TAKE, 3.0, HandoverMode.PULL),
    ],
)
def test_waits_that_are_longer_than_the_timeout_count(
    transition, kind, mode, wait, after, seen
):
    config = kind(**WAITING)
    held = Observation(holding=True, **seen)
    assert transition(mode, held, 0.99 * wait, config) is mode
    assert transition(mode, held, wait, config) is after


def test_a_receiver_that_feels_nothing_opens_its_hand():
    nothing, late = Observation(still=True), Handover().gripper_timeout
    for t, after in ((0.9 * late, HandoverMode.TAKE), (late, Mode.RELEASE)):
        assert handover_transition(HandoverMode.TAKE, nothing, t) is after


@pytest.mark.parametrize(
    ("seen", "after"),
    [
        (Observation(arrived=True, moved=True), HandoverMode.APPROACH),
        (Observation(arrived=True, stuck=True), HandoverMode.LET_GO),  # it fell
        (Observation(arrived=True, failure=Failure.NOT_TAKEN), Mode.FAILED),
    ],
)
def test_the_receiver_tries_again_while_the_giver_holds_on(seen, after):
    assert handover_transition(Mode.HOME, seen, 1.0) is after


HELD = Observation(arrived=True, holding=True)
STUCK = Observation(stuck=True, holding=True)


@pytest.mark.parametrize(
    ("strategy", "mode", "seen", "after"),
    [
        ("push", InsertMode.SEARCH, HELD, InsertMode.PRESS),
        ("spiral", InsertMode.SEARCH, HELD, InsertMode.SPIRAL),
        ("spiral", InsertMode.SPIRAL, HELD, InsertMode.PRESS),
        ("spiral", InsertMode.SPIRAL, STUCK, InsertMode.WITHDRAW),
        ("tilt", InsertMode.SLIDE, STUCK, InsertMode.WITHDRAW),
        ("tilt", InsertMode.PRESS, HELD, InsertMode.WITHDRAW),
        ("tilt", InsertMode.WITHDRAW, HELD, InsertMode.TILT),
    ],
)
def test_other_strategies_skip_the_wall_and_a_try_that_fails_is_repeated(
    strategy, mode, seen, after
):
    assert insert_transition(mode, seen, 1.0, Insert(strategy=strategy)) is after


@pytest.mark.parametrize("name", ["handover", "carry_together"])
def test_the_configuration_is_sent_to_other_processes(name):
    """The process that renders the video gets it that way."""
    scenario = load_scenario(name)
    again = read_typed(Scenario, yaml_dump_typed(scenario))
    assert again.planner == scenario.planner
    assert again.arms == scenario.arms


@pytest.mark.parametrize(
    ("name", "make"),
    [("handover", MakeHandoverPlanner), ("carry_together", MakeCarryPlanner)],
)
def test_a_planner_of_two_arms_commands_each_by_its_name(name, make):
    scenario = load_scenario(name)
    planner = make(scenario)
    context = planner.CreateDefaultContext()
    for arm in ("left", "right"):
        home = scenario.arms[arm].arm.home
        position = read(planner, context, f"{arm}.position_commanded")
        np.testing.assert_array_equal(position, home)
        assert read(planner, context, f"{arm}.closure_commanded") == [0.0]
