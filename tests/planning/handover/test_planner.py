"""Whose turn it is in a handover, and what its planner refuses."""

import copy
from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.math import RigidTransform

from drake_srg.common.exceptions import ScenarioError
from drake_srg.planning.handover.config import (
    HandoverMemory,
    Side,
)
from drake_srg.planning.handover.motions import HandoverMotions
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.pick_and_place.knowledge import Attempt
from drake_srg.planning.pick_and_place.task_motions import TaskMotions
from drake_srg.planning.state_machine import Moment
from drake_srg.scenario import load_scenario
from drake_srg.station.planners import MakeHandoverPlanner
from drake_srg.types import Mode


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
    """Regression: fingers that opened only on the approach were late by 0.7 s."""
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
