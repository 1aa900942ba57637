"""The transitions of a handover, whose turn it is, and what it refuses."""

import copy
import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.common.yaml import yaml_dump_typed
from pydrake.math import RigidTransform

from drake_srg.common.exceptions import ScenarioError
from drake_srg.planning.handover.config import (
    Handover,
    HandoverMemory,
    HandoverMode,
    Side,
)
from drake_srg.planning.handover.motions import HandoverMotions
from drake_srg.planning.handover.planner import (
    HANDOVER_TRANSITIONS,
    handover_transition,
)
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.pick_and_place.knowledge import Attempt
from drake_srg.planning.pick_and_place.task_motions import TaskMotions
from drake_srg.planning.planner_machine import Observation
from drake_srg.planning.state_machine import Moment
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.scenario.typed_yaml import read_typed
from drake_srg.station.planners import MakeHandoverPlanner
from drake_srg.types import Failure, Mode

CONFIG = Handover()
GOES_WELL = Observation(
    ready=True, arrived=True, holding=True, still=True, clear=True, at_goal=True
)
ORDER = (
    *(Mode.IDLE, Mode.PRE_GRASP, Mode.GRASP, Mode.CLOSE, Mode.VERIFY, Mode.LIFT),
    *(HandoverMode.CARRY, HandoverMode.PRESENT, HandoverMode.APPROACH),
    *(HandoverMode.REACH, HandoverMode.TAKE, HandoverMode.PULL),
    *(HandoverMode.LET_GO, HandoverMode.WITHDRAW, HandoverMode.CLEAR),
    *(HandoverMode.SECURE, HandoverMode.RAISE, Mode.TRANSFER, Mode.PLACE),
    *(Mode.RELEASE, Mode.RETREAT, Mode.HOME, Mode.DONE),
)


def following(mode, observation, t=1.0):
    return handover_transition(mode, observation, t, CONFIG)


def test_modes_follow_one_another_if_all_goes_well():
    for mode, next_mode in itertools.pairwise(ORDER):
        assert following(mode, GOES_WELL) is next_mode


def test_every_mode_waits_for_its_end():
    for mode in ORDER:
        if mode is not Mode.VERIFY:
            assert following(mode, Observation(holding=True), t=0.0) is mode


@pytest.mark.parametrize("mode", [Mode.VERIFY, Mode.LIFT, *ORDER[6:8]])
def test_a_giver_that_loses_the_object_opens_its_hand(mode):
    assert following(mode, Observation(arrived=True)) is HandoverMode.LET_GO


@pytest.mark.parametrize(
    "mode", [*ORDER[8:10], HandoverMode.PULL, *ORDER[15:18], Mode.TRANSFER]
)
def test_a_receiver_without_the_object_opens_its_hand(mode):
    assert following(mode, Observation(arrived=True)) is Mode.RELEASE


def test_a_receiver_that_feels_nothing_opens_its_hand():
    nothing = Observation(still=True)
    late = CONFIG.gripper_timeout
    assert following(HandoverMode.TAKE, nothing, 0.9 * late) is HandoverMode.TAKE
    assert following(HandoverMode.TAKE, nothing, late) is Mode.RELEASE


def test_the_receiver_tries_again_while_the_giver_holds_on():
    again = Observation(arrived=True, moved=True)
    assert following(Mode.HOME, again) is HandoverMode.APPROACH
    dropped = Observation(arrived=True, stuck=True)
    assert following(Mode.HOME, dropped) is HandoverMode.LET_GO
    enough = Observation(arrived=True, failure=Failure.NOT_TAKEN)
    assert following(Mode.HOME, enough) is Mode.FAILED


@pytest.mark.parametrize("failure", [Failure.TIME_BUDGET, Failure.STOPPED])
def test_reasons_to_give_up_end_every_mode(failure):
    for mode in HANDOVER_TRANSITIONS:
        ended = mode in (Mode.DONE, Mode.FAILED)
        expected = mode if ended else Mode.FAILED
        assert following(mode, Observation(failure=failure)) is expected


def make_memory():
    giver, receiver = Motion(np.zeros(7)), Motion(np.ones(7))
    return HandoverMemory(giver, 0.25, other=Side(receiver, 0.75))


def test_turns_change_no_commands():
    memory = make_memory()
    before = [memory.commands(name) for name in memory.arms]
    for receiver in (True, True, False, True):
        memory.turn_to(receiver=receiver)
        assert [memory.commands(name) for name in memory.arms] == before
        assert memory.motion is before[receiver][0]
        assert memory.closure == before[receiver][1]


def test_a_draft_shares_nothing_that_modes_change():
    memory = make_memory()
    draft = copy.copy(memory)
    draft.turn_to(receiver=True)
    draft.closure, draft.attempt.lost, draft.other.closure = 0.9, True, 0.1
    assert memory.commands("left")[1] == 0.25
    assert memory.commands("right")[1] == 0.75
    assert not memory.other.attempt.lost


def test_the_receivers_fingers_open_as_soon_as_there_is_a_plan():
    """The arm waits for seconds then; on the approach, fingers were late by 0.7 s."""
    begin = MakeHandoverPlanner(load_scenario("handover"))._modes[Mode.IDLE]
    grasp = SimpleNamespace(closure_open=0.47)
    plan = HandoverMotions(grasp, {}, TaskMotions(grasp, {}), RigidTransform())
    memory = make_memory()
    memory.attempt = Attempt(motions=plan, next_look=np.inf)
    nothing = SimpleNamespace(external_torque=None)
    after = begin.update(memory, Moment(0.0, nothing))
    assert after.commands("right")[1] == 0.47
    assert after.commands("left")[1] == 0.25


def test_only_cylinders_are_handed_over():
    box = "objects.bottle.shape=!Box {size: [0.04, 0.04, 0.2]}"
    with pytest.raises(ScenarioError, match=r"objects\.bottle: must be a cylinder"):
        MakeHandoverPlanner(load_scenario("handover", overrides=[box]))


def test_the_planner_commands_each_arm_by_its_name():
    planner = MakeHandoverPlanner(load_scenario("handover"))
    context = planner.CreateDefaultContext()
    for name in ("left", "right"):
        home = load_scenario("handover").arms[name].arm.home
        port = planner.GetOutputPort(f"{name}.position_commanded")
        np.testing.assert_array_equal(port.Eval(context), home)
        assert planner.GetOutputPort(f"{name}.closure_commanded").Eval(context) == [0]
    assert planner.task.goal.translation()[0] == pytest.approx(1.1)


def test_the_configuration_is_sent_to_other_processes():
    """As the process that renders the video gets it."""
    scenario = load_scenario("handover")
    text = yaml_dump_typed(scenario)
    again = read_typed(Scenario, text)
    assert again.planner == scenario.planner
    assert again.arms == scenario.arms
