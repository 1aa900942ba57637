"""The outputs of planners and the senses of their hands, on made-up planners."""

import dataclasses as dc

import numpy as np
import pytest
from helpers import port_table, read
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.lifetime import LeafSystem
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.planner_machine import (
    AddCommandOutputs,
    AddStatusOutput,
    HandSenses,
    PlannerConfig,
    PlannerMachine,
)
from drake_srg.planning.state_machine import ModeActions
from drake_srg.types import Mode, PlannerStatus


@dc.dataclass(frozen=True)
class Memory:
    motion: Motion
    closure: float

    def status(self, mode):
        return PlannerStatus(mode=mode, attempts=3)


class Wait(ModeActions):
    def observe(self, memory, now):
        return None


@given(st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=7), st.floats(0.0, 1.0))
def test_outputs_are_what_the_memory_says(q, closure):
    planner = PlannerMachine(
        {Mode.IDLE: Wait()},
        memory=Memory(Motion(np.array(q)), closure),
        transition=lambda mode, observation, t, config: mode,
        config=PlannerConfig(),
    )
    context = planner.CreateDefaultContext()
    np.testing.assert_array_equal(read(planner, context, "position_commanded"), q)
    assert read(planner, context, "closure_commanded") == closure
    assert read(planner, context, "mode") is Mode.IDLE
    status = read(planner, context, "status")
    assert (status.mode, status.attempts) == (Mode.IDLE, 3)


class Counting(LeafSystem):
    """A planner whose commands are the numbers of their calculations."""

    def __init__(self):
        super().__init__()
        self.count = {"position": 0, "closure": 0, "status": 0}
        state = self.DeclareDiscreteState(1)
        tickets = {self.discrete_state_ticket(state)}
        AddCommandOutputs(
            self,
            3,
            position=lambda _, output: output.SetFromVector(
                [self._next("position")] * 3
            ),
            closure=lambda _, output: output.SetFromVector([self._next("closure")]),
            prerequisites=tickets,
        )
        AddStatusOutput(self, self._calc_status, tickets)

    def _next(self, name):
        self.count[name] += 1
        return self.count[name]

    def _calc_status(self, context, output):
        output.set_value(PlannerStatus(mode=Mode.HOME, attempts=self._next("status")))


@pytest.fixture
def planner():
    return Counting()


def test_the_ports_are_those_of_a_planner(planner):
    _, outputs = port_table(planner)
    assert outputs == {"position_commanded": 3, "closure_commanded": 1, "status": None}


def test_only_positions_change_with_time_alone(planner):
    context = planner.CreateDefaultContext()

    def outputs():
        names = ("position_commanded", "closure_commanded", "status")
        position, closure, status = (read(planner, context, name) for name in names)
        return int(np.max(position)), int(np.max(closure)), status.attempts

    assert outputs() == (1, 1, 1)
    context.SetTime(1.0)
    assert outputs() == (2, 1, 1)
    context.SetDiscreteState([1.0])
    assert outputs() == (3, 2, 2)


def senses(speeds=(0.0, 0.0), proximity=(1.0, 1.0)):
    speeds, proximity = np.array(speeds), np.array(proximity)
    return HandSenses(np.zeros(6), np.zeros(2), speeds, False, proximity, list)


@given(st.permutations([0.0, 0.01, -0.2, 0.03]))
def test_one_finger_that_moves_is_enough_not_to_be_still(speeds):
    assert not senses(speeds=speeds).still
    assert senses(speeds=np.array(speeds) * 0.1).still


@given(st.permutations([0.01, 0.02, 0.0, np.inf]))
def test_one_sensor_that_touches_is_enough_not_to_be_clear(proximity):
    assert not senses(proximity=proximity).clear
    assert senses(proximity=np.array(proximity) + 0.002).clear
