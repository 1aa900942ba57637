import numpy as np
import pytest
from helpers import port_table, read
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.tree import BodyIndex, SpatialInertia
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.cell import AddCell, MakeCell
from drake_srg.common.exceptions import ScenarioError
from drake_srg.lifetime import my_context
from drake_srg.objects.disturbance_forces import Target
from drake_srg.objects.disturbances import Force, Push, Topple
from drake_srg.objects.disturber import Disturber
from drake_srg.planning.script.scripted import ScriptedPlanner, ScriptStep
from drake_srg.scenario import load_scenario
from drake_srg.simulation.flat import MakeRoot
from drake_srg.types import Cylinder, Sphere

RADIUS, LENGTH, MASS = 0.0125, 0.05, 0.02
GRAVITY = 9.81


def disturber(*disturbances, shape=Cylinder(RADIUS, LENGTH)):  # noqa: B008 # not changed
    inertia = SpatialInertia.SolidCylinderWithMass(MASS, RADIUS, LENGTH, [0, 0, 1])
    target = Target("thing", BodyIndex(7), inertia, shape)
    return Disturber([(d, target) for d in disturbances], 0.01)


def forces(script, *disturbances, X_WO=RigidTransform()):  # noqa: B008 # not changed
    """Return the forces on an object at rest: a list per 10 ms, after the update."""
    builder = DiagramBuilder()
    planner = builder.AddSystem(ScriptedPlanner(np.zeros(0), script))
    system = builder.AddSystem(disturber(*disturbances))
    builder.Connect(planner.GetOutputPort("mode"), system.GetInputPort("mode"))
    simulator = Simulator(builder.Build())
    context = system.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    system.GetInputPort("object_poses").FixValue(
        context, AbstractValue.Make({"thing": X_WO})
    )
    result = []
    for i in range(round(100 * sum(step.duration for step in script))):
        simulator.AdvanceTo(0.01 * i + 0.005)
        result.append(read(system, context, "object_forces"))
    return result


def steps(*modes):
    return [ScriptStep(mode=mode, duration=0.2) for mode in modes]


def when(script, *disturbances):
    """Return the indices of the periods in which a force acts."""
    acting = forces(script, *disturbances)
    return [i for i, applied in enumerate(acting) if applied]


def test_ports():
    assert port_table(disturber()) == (
        {"mode": None, "object_poses": None},
        {"object_forces": None},
    )


def test_a_disturbance_waits_for_its_mode():
    script = steps("pre_grasp", "lift", "transfer")
    assert when(script, Force(at="lift", duration=0.05)) == list(range(20, 25))
    late = Force(at="lift", after=0.1, duration=0.05)
    assert when(script, late) == list(range(30, 35))
    # The mode is over by then, which does not matter.
    later = Force(at="lift", after=0.25, duration=0.05)
    assert when(script, later) == list(range(45, 50))
    assert when(script, Force(at="grasp")) == []
    assert when(script, Force(at="pre_grasp", duration=0.05)) == list(range(5))


def test_a_disturbance_happens_as_often_as_configured():
    script = steps("grasp", "lift", "grasp", "lift", "grasp")
    once = Force(at="grasp", duration=0.02)
    assert when(script, once) == [0, 1]
    assert when(script, Force(at="grasp", duration=0.02, times=2)) == [0, 1, 40, 41]
    always = Force(at="grasp", duration=0.02, times=9)
    assert when(script, always) == [0, 1, 40, 41, 80, 81]


def test_consecutive_steps_of_one_mode_trigger_once():
    script = steps("grasp", "grasp")
    assert when(script, Force(at="grasp", duration=0.02, times=2)) == [0, 1]


def test_a_disturbance_under_way_does_not_restart():
    script = steps("grasp", "lift", "grasp", "lift")
    long = Force(at="grasp", duration=0.5, times=2)
    assert when(script, long) == list(range(50))


def test_several_disturbances_act_at_once():
    one = Force(at="grasp", force=[1.0, 0.0, 0.0], torque=[0.0, 2.0, 0.0])
    two = Force(at="grasp", force=[0.0, 0.0, 3.0])
    applied, *_ = forces(steps("grasp"), one, two)
    np.testing.assert_array_equal(applied[0].F_Bq_W.translational(), one.force)
    np.testing.assert_array_equal(applied[0].F_Bq_W.rotational(), one.torque)
    np.testing.assert_array_equal(applied[1].F_Bq_W.translational(), two.force)
    assert [a.body_index for a in applied] == [BodyIndex(7)] * 2
    for a in applied:
        np.testing.assert_array_equal(a.p_BoBq_B, np.zeros(3))


@settings(max_examples=20)
@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.05, 1.0))
def test_a_push_on_a_blocked_object_is_at_most_three_weights(x, y, duration):
    push = Push(at="grasp", displacement=[x, y, 0.0], duration=duration)
    script = [ScriptStep(mode="grasp", duration=2.0)]
    sizes = [
        np.linalg.norm(applied.F_Bq_W.translational())
        for period in forces(script, push)
        for applied in period
    ]
    assert max(sizes) <= 3.0 * MASS * GRAVITY * (1.0 + 1e-9)


def test_an_object_that_does_not_topple_is_released():
    # The force grows by one weight per second, for two seconds.
    script = [ScriptStep(mode="grasp", duration=3.0)]
    acting = forces(script, Topple(at="grasp", direction=[0.0, -2.0]))
    push = np.array([a.F_Bq_W.translational() for period in acting for a in period])
    assert len(push) == 200
    weights = push[:, 1] / (-MASS * GRAVITY)
    assert weights == pytest.approx(0.01 * np.arange(200), abs=1e-6)
    assert not np.any(push[:, [0, 2]])
    np.testing.assert_allclose(acting[0][0].p_BoBq_B, [0.0, 0.0, LENGTH / 2])


# In a cell.


@pytest.mark.slow
def test_a_cell_has_a_disturber_only_if_it_is_needed():
    def has(*overrides):
        bench = load_scenario("gripper_bench", overrides=overrides)
        bench.cameras.clear()
        return MakeCell(bench).HasSubsystemNamed("disturber")

    assert not has()
    assert has("disturbances=[!Push {at: lift}]")
    assert not has("disturbances=[!Push {at: lift}]", "object.present=false")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["kitchen", "kitchen_fast"])
def test_a_cell_with_a_planner_is_disturbed(name):
    scenario = load_scenario(name, overrides=["disturbances=[!Push {at: idle}]"])
    builder, cell = MakeRoot("cell", MakeCell, AddCell, scenario, name)
    simulator = Simulator(builder.Build())
    ApplySimulatorConfig(scenario.simulator_config, simulator)
    port = cell.GetOutputPort("object_poses_cheat")
    context = my_context(cell, simulator.get_context())
    before = port.Eval(context)["soup_can"].translation()
    simulator.AdvanceTo(0.7)
    moved = port.Eval(context)["soup_can"].translation() - before
    assert moved == pytest.approx([0.03, 0.0, 0.0], abs=2e-3)


@pytest.mark.slow
def test_a_cell_with_a_disturber_is_freed(leaked):
    push = "disturbances=[!Push {at: grasp}]"
    simulator = Simulator(MakeCell(load_scenario("kitchen", overrides=[push])))
    simulator.AdvanceTo(0.02)
    assert "Disturber" in leaked()
    del simulator
    assert leaked() == []


@pytest.mark.slow
def test_only_cylinders_and_boxes_can_be_toppled():
    with pytest.raises(ValueError, match=r"needs .* one cylinder or box, got 'thing'"):
        disturber(Topple(), shape=Sphere(0.03))
    mug = "objects.mug={model: package://drake_srg/sdf/mug.sdf, position: [0.9, 0.5]}"
    topple = "disturbances=[!Topple {object: mug}]"
    with pytest.raises(ScenarioError, match=r"^disturbances: !Topple .* 'mug'$"):
        MakeCell(load_scenario("kitchen", overrides=[mug, topple]))
