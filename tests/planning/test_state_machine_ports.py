"""Machines with ports of their own: a gripper that opens and closes."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from helpers import fix, read
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from drake_srg.planning.state_machine import ModeActions, StateMachine, next_mode

PERIOD = 0.125  # a binary fraction, so that times of updates are exact


def advance(simulator, time):
    """Advance to a time, and do what is due then."""
    simulator.AdvanceTo(time)
    simulator.AdvancePendingEvents()


class Open(ModeActions):
    def enter(self, memory, entry):
        return 0.0

    def observe(self, memory, now):
        return now.senses


class Shut(Open):
    def enter(self, memory, entry):
        return 1.0


class GripperCycle(StateMachine):
    """Closes until something is grasped, then opens for a second; remembers closure."""

    def __init__(self):
        table = {
            "open": [(lambda grasped, t: t >= 1.0, "shut")],
            "shut": [(lambda grasped, t: grasped, "open")],
        }
        super().__init__(
            {"open": Open(), "shut": Shut()},
            initial="open",
            memory=0.5,
            transition=lambda mode, o, t: next_mode(table, mode, o, t),
            period=PERIOD,
        )
        self._grasped = self.DeclareVectorInputPort("grasped", 1)
        self.calculations = 0
        self.DeclareVectorOutputPort(
            "closure", 1, self._calc_closure, {self.state_ticket}
        )

    def sense(self, context):
        return bool(self._grasped.Eval(context)[0])

    def _calc_closure(self, context, output):
        self.calculations += 1
        output[0] = self.state(context).memory


def test_a_derived_machine_reads_its_inputs_and_calculates_outputs():
    cycle = GripperCycle()
    simulator = Simulator(cycle)
    context = simulator.get_mutable_context()
    fix(cycle, context, grasped=0.0)
    assert read(cycle, context, "closure") == [0.5]
    simulator.Initialize()
    assert read(cycle, context, "closure") == [0.0]
    advance(simulator, 1.0)
    assert read(cycle, context, "closure") == [1.0]
    advance(simulator, 5.0)
    assert read(cycle, context, "mode") == "shut"
    fix(cycle, context, grasped=1.0)
    advance(simulator, 5.0 + PERIOD)
    assert read(cycle, context, "mode") == "open"
    assert read(cycle, context, "closure") == [0.0]
    advance(simulator, 6.0 + PERIOD)
    assert read(cycle, context, "mode") == "shut"


def test_outputs_of_the_state_are_calculated_only_when_it_changes():
    cycle = GripperCycle()
    context = cycle.CreateDefaultContext()
    for time, grasped in ((0.0, 0.0), (0.0, 1.0), (3.0, 1.0)):
        context.SetTime(time)
        fix(cycle, context, grasped=grasped)
        np.testing.assert_array_equal(read(cycle, context, "closure"), [0.5])
    assert cycle.calculations == 1


@pytest.mark.slow
def test_the_documented_machine_grasps_the_can():
    program = Path(__file__).parents[2] / "examples/extending/grasp_cycle.py"
    modes = runpy.run_path(program)["main"]()
    assert list(dict.fromkeys(modes)) == ["open", "close", "hold"]
    # It holds the can for two seconds, and opens again.
    assert modes.count("hold") == pytest.approx(20, abs=1)
    assert modes[-8] == "open"


def test_machines_are_freed_with_their_diagram(leaked):
    def run():
        builder = DiagramBuilder()
        cycle = builder.AddSystem(GripperCycle())
        source = builder.AddSystem(ConstantVectorSource([1.0]))
        builder.Connect(source.get_output_port(), cycle.get_input_port())
        simulator = Simulator(builder.Build())
        simulator.AdvanceTo(1.0)
        mode = cycle.GetOutputPort("mode").Eval(
            cycle.GetMyContextFromRoot(simulator.get_context().Clone())
        )
        assert mode == "open"

    run()
    assert leaked() == []
