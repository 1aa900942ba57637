"""The hardware station's limits of what the arm feels."""

import dataclasses as dc

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from drake_srg.arm.safety.config import BodyRegionLimits, ForceLimitConfig, SafetyConfig
from drake_srg.arm.safety.limits import Tool
from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.safety_states import SafetyState, StopReason, state_indices
from drake_srg.robot.drive.opening import Hardware
from drake_srg.robot.drive.station import HandHold, MakeHardwareStation
from drake_srg.station.plant import MakeModelsPlant
from robot.drive.stand import HOME, FakeArm, FakeGripper, Stand, kitchen

PERIOD = 0.01


def test_commands_pass_only_while_the_arm_runs():
    system = HandHold(PERIOD)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    steps = [
        (SafetyState.RUNNING, 0.2, 0.2, 0.0),
        (SafetyState.RUNNING, 0.6, 0.6, 0.0),
        (SafetyState.BRAKING, 0.6, 0.6, 1.0),
        (SafetyState.BRAKING, 0.0, 0.6, 1.0),
        (SafetyState.PROTECTIVE_STOP, 1.0, 0.6, 1.0),
        (SafetyState.EMERGENCY_STOP, 0.0, 0.6, 1.0),
        (SafetyState.RUNNING, 0.3, 0.3, 0.0),
    ]
    for k, (state, commanded, allowed, hold) in enumerate(steps):
        system.GetInputPort("closure_commanded").FixValue(context, [commanded])
        indices = state_indices(state, StopReason.STALE)
        system.GetInputPort("safety_state").FixValue(context, np.array(indices))
        assert system.GetOutputPort("closure_allowed").Eval(context) == [allowed]
        assert system.GetOutputPort("hold").Eval(context) == [hold]
        simulator.AdvanceTo((k + 1) * PERIOD)


PUSH = np.array([0.0, 60.0, 0.0])  # at the tool [N]
HAND = {"hand": BodyRegionLimits(transient=50.0, quasi_static=50.0)}
FORCE = SafetyConfig(force=ForceLimitConfig(profile=HAND, regions=["hand"]))
TORQUE = SafetyConfig(external_torque=[12.0])


class FeelingArm(FakeArm):
    """An arm that tells what it feels."""

    def __init__(self):
        super().__init__()
        self.outputs = {**self.outputs, "arm.external_torque": 7}
        self.torque = np.zeros(7)

    def take(self):
        return {**super().take(), "arm.external_torque": self.torque}


def torque_of(force):
    """Torques at home of a force on the tool, J(q)ᵀ f [N m]."""
    plant = MakeModelsPlant(kitchen())
    tool = Tool(plant, "arm", SafetyConfig().tool)
    steps = 1e-6 * np.eye(7)
    J = [(tool.position(HOME + d) - tool.position(HOME - d)) / 2e-6 for d in steps]
    return np.array(J) @ force


@pytest.mark.parametrize(
    ("safety", "reason"),
    [(FORCE, StopReason.FORCE), (TORQUE, StopReason.EXTERNAL_TORQUE)],
)
def test_a_push_that_the_arm_tells_of_stops_it(safety, reason):
    arm = FeelingArm()
    stand = Stand(arm, scenario=dc.replace(kitchen(), safety=safety))
    arm.torque = torque_of(0.5 * PUSH)
    assert stand.run(0.1)
    arm.torque = torque_of(PUSH)
    assert not stand.run(1.0)
    assert stand.loop.safety[1] is reason


def with_torque_limits_of_the_planner():
    limits = [20.0] * 7
    planner = dc.replace(kitchen().planner, max_external_torque=limits)
    return dc.replace(kitchen(), planner=planner)


@pytest.mark.parametrize(
    "scenario",
    [
        dc.replace(kitchen(), safety=FORCE),
        dc.replace(kitchen(), safety=TORQUE),
        with_torque_limits_of_the_planner(),
    ],
)
def test_limits_of_what_the_arm_does_not_tell_are_refused(scenario):
    hardware = Hardware([FakeArm(), FakeGripper()], {}, {})
    with pytest.raises(ScenarioError, match="does not tell external torques"):
        MakeHardwareStation(scenario, hardware)


def test_a_planner_gets_the_torques_for_its_own_limits():
    arm = FeelingArm()
    stand = Stand(arm, scenario=with_torque_limits_of_the_planner())
    arm.torque = torque_of(PUSH)
    assert stand.run(0.1)  # the monitor has no limits of them
    tick = stand.planner.ticks[-1]
    np.testing.assert_array_equal(tick.values["arm.external_torque"], arm.torque)
