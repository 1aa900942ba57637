"""The outputs that planners share, on a planner that only counts."""

import numpy as np
import pytest
from helpers import port_table, read

from drake_srg.lifetime import LeafSystem
from drake_srg.planning.planner_machine import AddPlannerOutputs
from drake_srg.types import Mode, PlannerStatus


class Counting(LeafSystem):
    """Its commands are the number of times that each was calculated."""

    def __init__(self):
        super().__init__()
        self.count = {"position": 0, "closure": 0, "status": 0}
        state = self.DeclareDiscreteState(1)
        AddPlannerOutputs(
            self,
            3,
            position=lambda _, output: output.SetFromVector(
                [self._next("position")] * 3
            ),
            closure=lambda _, output: output.SetFromVector([self._next("closure")]),
            status=self._calc_status,
            prerequisites={self.discrete_state_ticket(state)},
        )

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
