import numpy as np
import pytest
from helpers import fix
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.arm.driver import (
    AddLinearInterpolation,
    GravityCompensation,
    SetInterpolatedPosition,
)
from drake_srg.scenario import load_scenario
from drake_srg.station.plant import AddDirectives

COMMAND, STEP = 1 / 16, 1 / 64


class Interpolated:
    def __init__(self, start):
        builder = DiagramBuilder()
        self.system = AddLinearInterpolation(builder, np.array(start), COMMAND, STEP)
        builder.ExportInput(self.system.get_input_port(), "position")
        builder.ExportOutput(self.system.get_output_port(), "state")
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.context = self.simulator.get_mutable_context()

    def after(self, command, periods):
        """The output at every step of some periods with a command."""
        self.diagram.get_input_port().FixValue(self.context, command)
        steps, start = round(periods * COMMAND / STEP), self.context.get_time()
        rows = []
        for i in range(1, steps + 1):
            self.simulator.AdvanceTo(start + i * STEP)
            rows.append(self.diagram.get_output_port().Eval(self.context))
        return np.array(rows)


positions = st.lists(st.floats(-3.0, 3.0), min_size=2, max_size=2)


@settings(max_examples=20, deadline=None)
@given(start=positions, target=positions)
def test_it_moves_evenly_to_the_command_and_stays(start, target):
    arm = Interpolated(start)
    assert np.allclose(arm.diagram.get_output_port().Eval(arm.context)[:2], start)
    rows = arm.after(target, 3)
    assert np.allclose(rows[-1], [*target, 0.0, 0.0])
    low, high = np.minimum(start, target) - 1e-9, np.maximum(start, target) + 1e-9
    assert np.all((rows[:, :2] >= low) & (rows[:, :2] <= high))
    speed = np.diff(rows[:, :2], axis=0) / STEP
    moving = np.abs(speed).max(axis=1) > 1e-9
    assert np.allclose(speed[moving], np.subtract(target, start) / COMMAND)


def test_it_can_be_put_at_rest_anywhere():
    arm = Interpolated([0.0, 0.0])
    arm.after([1.0, 2.0], 1.5)
    SetInterpolatedPosition(arm.system, arm.context, np.array([0.5, -0.5]))
    state = arm.diagram.get_output_port().Eval(arm.context)
    assert np.array_equal(state, [0.5, -0.5, 0.0, 0.0])


@pytest.mark.parametrize(("command", "step"), [(0.05, 0.0015), (0.06, 0.004), (0.1, 1)])
def test_commands_between_steps_are_refused(command, step):
    with pytest.raises(ValueError, match=r"must be a multiple of arm\.period"):
        AddLinearInterpolation(DiagramBuilder(), np.zeros(2), command, step)


def test_the_compensation_agrees_with_the_plants_gravity():
    plant = MultibodyPlant(0.0)
    AddDirectives(plant, load_scenario("kitchen"))
    plant.Finalize()
    arm, gripper = (plant.GetModelInstanceByName(name) for name in ("arm", "gripper"))
    system = GravityCompensation(plant, ["arm", "gripper"])
    context, plant_context = system.CreateDefaultContext(), plant.CreateDefaultContext()
    generator = np.random.default_rng(0)
    for _ in range(5):
        q, fingers = generator.uniform(-1.5, 1.5, 7), generator.uniform(0, 1.5, 4)
        fix(
            system,
            context,
            arm_state=np.concatenate([q, generator.normal(size=7)]),
            gripper_state=np.concatenate([fingers, generator.normal(size=4)]),
        )
        plant.SetPositions(plant_context, arm, q)
        plant.SetPositions(plant_context, gripper, fingers)
        # The gradient of the potential energy, by central differences.
        expected = np.zeros(7)
        for i in range(7):
            energy = []
            for h in (1e-5, -1e-5):
                plant.SetPositions(plant_context, arm, q + h * np.eye(7)[i])
                energy.append(plant.CalcPotentialEnergy(plant_context))
            expected[i] = (energy[0] - energy[1]) / 2e-5
        result = system.get_output_port().Eval(context)
        np.testing.assert_allclose(result, expected, atol=1e-5)
        assert np.max(np.abs(result)) > 1.0
