"""Objects on a table move as their disturbances demand."""

import numpy as np
import pytest
from helpers import read
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.tree import BodyIndex, SpatialInertia
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.exceptions import ScenarioError
from drake_srg.lifetime import my_context
from drake_srg.objects.disturber import Disturber, Force, Push, Target, Topple
from drake_srg.scenario import load_scenario
from drake_srg.simulation.flat import MakeRoot
from drake_srg.station import AddCell, AddDisturber, MakeCell, MakeStation
from drake_srg.theses.script import ScriptedPlanner, ScriptStep
from drake_srg.types import Cylinder, Sphere


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("!Pusch {}", r"disturbances\[0\]: unknown tag !Pusch \(did you mean '!Push'"),
        ("{at: lift}", r"\[0\]: needs a tag \(allowed: !Force, !Push, !Topple\)"),
        ("!Push {at: flight}", r"\[0\]\.at: must be one of .*close, grasp.* 'flight'"),
        ("!Push {at: failed}", r"\[0\]\.at: must be one of"),
        ("!Push {after: -1}", r"\[0\]\.after: must be at least 0"),
        ("!Push {times: 0}", r"\[0\]\.times: must be at least 1"),
        ("!Push {duration: 0}", r"\[0\]\.duration: must be greater than 0"),
        (
            "!Push {displacement: [1, 2]}",
            r"\[0\]\.displacement: needs 3 numbers, got 2",
        ),
        ("!Push {direction: [1, 2]}", r"\[0\]: unknown key 'direction'"),
        ("!Topple {direction: [0, 0]}", r"\[0\]\.direction: must not be \[0, 0\]"),
        ("!Force {force: 3}", r"\[0\]\.force: must be a list, got 3"),
        (
            "!Force {object: can}",
            r"\[0\]\.object: must be a rigid object, got 'can' \(allowed: thing\)$",
        ),
    ],
)
def test_bad_entries_are_reported_in_one_line(table, entry, message):
    with pytest.raises(ScenarioError, match=message) as error:
        table(f"[{entry}]")
    assert "\n" not in str(error.value)


def test_soft_objects_cannot_be_disturbed(table):
    soft = "objects.thing={soft: {}, shape: !Box {size: [0.05, 0.05, 0.05]}}"
    with pytest.raises(
        ScenarioError, match=r"\[0\]\.object: must be a rigid .* \(allowed: none\)$"
    ):
        table("[!Push {}]", soft)


def test_the_mode_must_be_one_of_the_script():
    push = "disturbances=[!Push {at: verify}]"
    message = r"\[0\]\.at: must be a mode of the script, got 'verify' \(allowed: close,"
    with pytest.raises(ScenarioError, match=message):
        load_scenario("gripper_bench", overrides=[push])


RADIUS, LENGTH, MASS = 0.0125, 0.05, 0.02  # of the scenario `table`
GRAVITY = 9.81
CENIC = [
    "plant_config.time_step=0",
    "simulator_config.integration_scheme=cenic",
    "simulator_config.max_step_size=0.0078125",
    # CENIC needs periods that are exact in binary, even for systems that do not exist.
    "planner.period=0.015625",
    "recording={period: 0.03125, video_fps: 16, bag_camera_period: 0.5}",
]
BOX = "objects.thing.shape=!Box {size: [0.04, 0.05, 0.06]}"


def poses(scenario, duration):
    """Return the object's poses, every 1/128 s, while the mode is pre_grasp."""

    def add_table(builder, scenario, make_station=MakeStation):
        station = builder.AddNamedSystem("station", make_station(scenario))
        script = [ScriptStep(mode="pre_grasp", duration=duration + 1.0)]
        planner = builder.AddNamedSystem(
            "planner", ScriptedPlanner(np.zeros(0), script)
        )
        AddDisturber(builder, scenario, station, planner)
        builder.ExportOutput(station.GetOutputPort("object_poses_cheat"), "poses")

    def make_table(scenario):
        builder = DiagramBuilder()
        add_table(builder, scenario)
        return builder.Build()

    builder, table = MakeRoot("table", make_table, add_table, scenario, "")
    simulator = Simulator(builder.Build())
    ApplySimulatorConfig(scenario.simulator_config, simulator)
    port = table.GetOutputPort("poses")
    context = my_context(table, simulator.get_context())
    simulator.Initialize()
    result = [port.Eval(context)["thing"]]
    for time in np.arange(1.0 / 128.0, duration, 1.0 / 128.0):
        simulator.AdvanceTo(time)
        result.append(port.Eval(context)["thing"])
    return result


def tilt(X_WO):
    return np.arccos(np.clip(X_WO.rotation().matrix()[2, 2], -1.0, 1.0))


@pytest.mark.parametrize(
    ("displacement", "overrides"),
    [
        ((0.0, 0.03, 0.0), ()),
        ((-0.02, -0.01, 0.0), (BOX,)),
        ((-0.02, -0.01, 0.0), CENIC),
    ],
    ids=["", "box", "cenic"],
)
def test_a_pushed_object_stands_farther_on_by_the_displacement(
    table, displacement, overrides
):
    push = f"[!Push {{after: 0.1, displacement: {list(displacement)}, duration: 0.4}}]"
    before, *_, after = poses(table(push, *overrides), 1.0)
    moved = after.translation() - before.translation()
    assert moved == pytest.approx(displacement, abs=2e-3)
    assert tilt(after) < np.deg2rad(1.0)


def test_a_push_begins_and_ends_on_time(table):
    push = "[!Push {after: 0.3, displacement: [0.03, 0, 0], duration: 0.3}]"
    x = np.array([X.translation()[0] - 0.5 for X in poses(table(push), 1.2)])
    time = np.arange(len(x)) / 128.0
    assert np.all(np.abs(x[time < 0.3]) < 1e-4)
    # Halfway, up to the stretch of the spring: the path's acceleration, at most
    # 5.77 d / T², over 25² rad²/s².
    (half,) = np.interp([0.45], time, x)
    assert half == pytest.approx(0.015, abs=5.77 * 0.03 / 0.3**2 / 25.0**2)
    assert np.ptp(x[time > 0.9]) < 1e-4


@pytest.mark.parametrize(
    ("direction", "overrides"),
    [((0.0, 1.0), ()), ((-3.0, 1.0), CENIC)],
    ids=["", "cenic"],
)
def test_a_toppled_cylinder_lies(table, direction, overrides):
    topple = f"[!Topple {{after: 0.1, direction: {list(direction)}}}]"
    X_WO = poses(table(topple, *overrides), 1.5)[-1]
    assert tilt(X_WO) == pytest.approx(np.pi / 2, abs=np.deg2rad(1.0))
    assert X_WO.translation()[2] == pytest.approx(RADIUS, abs=5e-4)
    # It falls in the direction of the push and lands on its side, near its old place.
    axis = X_WO.rotation().matrix()[:2, 2]
    assert axis @ direction / np.linalg.norm(direction) > 0.95
    assert np.linalg.norm(X_WO.translation()[:2] - [0.5, 0.0]) < 2.0 * LENGTH


def test_a_toppled_box_lies_on_its_side(table):
    X_WO = poses(table("[!Topple {direction: [1.0, 0.0]}]", BOX), 1.5)[-1]
    assert tilt(X_WO) == pytest.approx(np.pi / 2, abs=np.deg2rad(1.0))
    assert X_WO.translation()[2] == pytest.approx(0.02, abs=5e-4)


def test_a_lying_object_is_not_toppled(table):
    lying = "objects.thing={position: null, pose: {translation: [0.5, 0, 0.0125], "
    lying += "rotation: !Rpy {deg: [90, 0, 0]}}}"
    first, *_, last = poses(table("[!Topple {}]", lying), 0.5)
    assert np.linalg.norm(last.translation() - first.translation()) < 1e-3


def test_a_force_throws_the_object(table):
    # Upwards with g for 0.1 s, then ballistic: 0.05 m and another 0.05 m.
    force = f"[!Force {{force: [0, 0, {2 * MASS * GRAVITY}], duration: 0.1}}]"
    z = max(X.translation()[2] for X in poses(table(force), 0.5)) - LENGTH / 2
    assert z == pytest.approx(2 * 0.5 * GRAVITY * 0.1**2, rel=0.05)  # steps of 2 ms


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
def test_a_cell_with_a_planner_is_disturbed():
    push = "disturbances=[!Push {at: idle}]"
    scenario = load_scenario("kitchen_fast", overrides=[push])
    builder, cell = MakeRoot("cell", MakeCell, AddCell, scenario, "kitchen_fast")
    simulator = Simulator(builder.Build())
    ApplySimulatorConfig(scenario.simulator_config, simulator)
    port = cell.GetOutputPort("object_poses_cheat")
    context = my_context(cell, simulator.get_context())
    before = port.Eval(context)["soup_can"].translation()
    simulator.AdvanceTo(0.7)
    moved = port.Eval(context)["soup_can"].translation() - before
    assert moved == pytest.approx([0.03, 0.0, 0.0], abs=2e-3)


@pytest.mark.slow
def test_only_cylinders_and_boxes_can_be_toppled():
    with pytest.raises(ValueError, match=r"needs .* one cylinder or box, got 'thing'"):
        disturber(Topple(), shape=Sphere(0.03))
    mug = "objects.mug={model: package://drake_srg/sdf/mug.sdf, position: [0.9, 0.5]}"
    topple = "disturbances=[!Topple {object: mug}]"
    with pytest.raises(ScenarioError, match=r"^disturbances: !Topple .* 'mug'$"):
        MakeCell(load_scenario("kitchen", overrides=[mug, topple]))
