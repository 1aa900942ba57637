"""The outputs of a planner's state machine, from a memory of made-up commands."""

import dataclasses as dc

import numpy as np
from helpers import read
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.planner_machine import PlannerConfig, PlannerMachine
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
