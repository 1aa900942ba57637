import numpy as np
import pytest
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.envs.hand_task import LOWEST
from drake_srg.envs.movers import MakeMover
from drake_srg.envs.physics import CONTROL_PERIOD, Physics
from drake_srg.envs.pick import STEP, pick_state
from drake_srg.learning.policy_planner import PolicyPlanner
from drake_srg.learning.rules import pick
from drake_srg.objects.models import simple_shape
from drake_srg.scenario.load import draw_scenario
from drake_srg.station import MakeStation
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Box, Mode

THING = Box([0.04, 0.05, 0.08])
HOME = [0.1, 0.0, 0.3, 0.0]


class Straight:
    """A gantry whose joints are the hand's pose."""

    def pose(self, q):
        return q

    def follow(self, q, pose):
        return pose


def made(act):
    planner = PolicyPlanner(act, Straight(), HOME, THING, 0.0)
    simulator = Simulator(planner)
    context = simulator.get_mutable_context()
    for name, value in (
        ("estimate", [0.1, 0.0, 0.04, 0.0]),
        ("arm_state", [*HOME, 0.0, 0.0, 0.0, 0.0]),
        ("gripper_state", np.zeros(8)),
        ("contact_force", np.zeros(4)),
    ):
        planner.GetInputPort(name).FixValue(context, value)
    return planner, simulator, context


def test_it_sees_what_the_environment_would_and_moves_as_it_would():
    seen = []

    def act(observation):
        seen.append(observation)
        return np.array([1.0, 0.0, -0.5, 0.0, -1.0])

    planner, simulator, context = made(act)
    simulator.AdvanceTo(2.5 * CONTROL_PERIOD)
    assert len(seen) == 3
    args = ([0.1, 0.0, 0.04, 0.0], THING, 0.0, np.zeros(8), np.zeros(4), 0.0, 0)
    np.testing.assert_array_equal(seen[0], pick_state(np.array(HOME), *args))
    q = planner.GetOutputPort("position_commanded").Eval(context)
    np.testing.assert_allclose(q, HOME + 3 * STEP * [1.0, 0.0, -0.5, 0.0])
    assert planner.GetOutputPort("mode").Eval(context) is Mode.GRASP


def test_the_hand_stays_above_the_table():
    planner, simulator, context = made(lambda _: np.array([0, 0, -1.0, 0, -1.0]))
    simulator.AdvanceTo(30 * CONTROL_PERIOD)
    assert planner.GetOutputPort("position_commanded").Eval(context)[2] == LOWEST


def test_it_is_done_once_the_closed_hand_has_risen():
    planner, simulator, context = made(lambda _: np.array([0, 0, 1.0, 0, 1.0]))
    simulator.AdvanceTo(20 * CONTROL_PERIOD)
    assert planner.GetOutputPort("mode").Eval(context) is Mode.DONE
    assert planner.GetOutputPort("status").Eval(context).mode is Mode.DONE
    q = planner.GetOutputPort("position_commanded").Eval(context)
    assert 0.12 < q[2] - HOME[2] < 0.17


@pytest.mark.slow
def test_the_rule_picks_up_an_object_in_a_diagram():
    tree = Physics("fast", "plant").scenario_tree("learn_bench")
    scenario = draw_scenario(tree, "learn_bench", 3).scenario
    name = scenario.task.pick
    thing = scenario.objects[name]
    shape = simple_shape(name, thing)
    builder = DiagramBuilder()
    station = builder.AddNamedSystem("station", MakeStation(scenario))
    mover = MakeMover(MakeModelsPlant(scenario), np.array(scenario.arm.home))
    planner = builder.AddNamedSystem(
        "planner", PolicyPlanner(pick, mover, scenario.arm.home, shape, 0.0)
    )
    for output, port in (
        ("arm.state_measured", "arm_state"),
        ("gripper.state_measured", "gripper_state"),
        ("gripper.contact_force", "contact_force"),
    ):
        builder.Connect(station.GetOutputPort(output), planner.GetInputPort(port))
    for output, port in (
        ("position_commanded", "arm.position_commanded"),
        ("closure_commanded", "gripper.closure_commanded"),
    ):
        builder.Connect(planner.GetOutputPort(output), station.GetInputPort(port))
    builder.ExportInput(planner.GetInputPort("estimate"), "estimate")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    ApplySimulatorConfig(scenario.simulator_config, simulator)
    context = simulator.get_mutable_context()
    yaw = 0.0 if thing.yaw is None else thing.yaw
    estimate = [*thing.position, 0.5 * shape.height, yaw]
    diagram.GetInputPort("estimate").FixValue(context, estimate)
    simulator.AdvanceTo(5.0)
    poses = station.GetOutputPort("object_poses_cheat")
    X_WO = poses.Eval(station.GetMyContextFromRoot(context))[name]
    own = planner.GetMyContextFromRoot(context)
    assert planner.GetOutputPort("mode").Eval(own) is Mode.DONE
    assert X_WO.translation()[2] - 0.5 * shape.height > 0.08
