import dataclasses as dc

import numpy as np
import pytest
from helpers import break_camera, port_table
from pydrake.systems.analysis import Simulator

from drake_srg.common.exceptions import ScenarioError
from drake_srg.planning.planner_machine import PlannerConfig
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeCell, MakeStation, register_planner
from drake_srg.station import cell as module
from drake_srg.theses.script import Script, ScriptedPlanner, ScriptStep
from drake_srg.types import Mode


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("kitchen", seed=1)


@pytest.fixture(scope="module")
def cell(scenario):
    return MakeCell(scenario)


@pytest.mark.slow
def test_a_cell_exports_the_stations_ports_and_its_own(cell, scenario):
    inputs, outputs = port_table(cell)
    assert inputs == {}
    _, of_station = port_table(MakeStation(scenario))
    assert outputs == {
        **of_station,
        "localizer.blobs": None,
        "planner.mode": None,
        "planner.status": None,
        "arm.position_commanded": 7,
        "gripper.closure_commanded": 1,
    }


@pytest.mark.slow
def test_objects_that_look_alike_are_refused():
    ball = "{shape: !Sphere {radius: 0.03}, mass: 0.1, friction: 1, position: "
    balls = [f"objects.a={ball}[0.5, 0.5]}}", f"objects.b={ball}[0.8, 0.5]}}"]
    with pytest.raises(ScenarioError, match=r"objects\.b: looks like a;"):
        MakeCell(load_scenario("kitchen", overrides=balls))
    MakeCell(load_scenario("kitchen", overrides=[*balls, "objects.b.color=[0, 0, 1]"]))


def test_the_localizer_sees_the_object(cell, scenario):
    context = cell.CreateDefaultContext()
    (blob,) = cell.GetOutputPort("localizer.blobs").Eval(context)
    truth = cell.GetOutputPort("object_poses_cheat").Eval(context)["soup_can"]
    assert blob.object_name == "soup_can"
    assert blob.camera == "ceiling"
    # The project's limit for the localizer: 0.5 mm on each axis.
    assert blob.position == pytest.approx(truth.translation(), abs=5e-4)


@pytest.mark.slow
def test_the_planner_looks_and_then_moves(cell):
    simulator = Simulator(cell)
    context = simulator.get_mutable_context()
    assert cell.GetOutputPort("planner.mode").Eval(context) is Mode.IDLE
    simulator.AdvanceTo(0.2)  # the planner's latency is 0.1 s
    assert cell.GetOutputPort("planner.mode").Eval(context) is Mode.PRE_GRASP
    assert cell.GetOutputPort("planner.status").Eval(context).looks == 1


@pytest.mark.slow
def test_images_are_rendered_only_when_the_planner_looks(scenario):
    cell = MakeCell(scenario)
    simulator = Simulator(cell)
    context = simulator.get_mutable_context()
    simulator.AdvanceTo(0.2)
    sensor = cell.GetSubsystemByName("station").GetSubsystemByName(
        "rgbd_sensor_ceiling"
    )
    break_camera(sensor, sensor.GetMyMutableContextFromRoot(context))
    with pytest.raises(RuntimeError, match="broken"):
        cell.GetOutputPort("localizer.blobs").Eval(context)
    simulator.AdvanceTo(0.3)
    assert cell.GetOutputPort("planner.status").Eval(context).looks == 1


# With a script.


@pytest.fixture(scope="module")
def scripted():
    bench = load_scenario("gripper_bench")
    bench.cameras.clear()
    return bench


@pytest.mark.slow
def test_a_scripted_cell_has_the_same_ports_but_no_localizer(scripted):
    cell = MakeCell(scripted)
    inputs, outputs = port_table(cell)
    assert inputs == {}
    _, of_station = port_table(MakeStation(scripted))
    assert outputs == {
        **of_station,
        "planner.mode": None,
        "planner.status": None,
        "arm.position_commanded": 3,
        "gripper.closure_commanded": 1,
    }
    assert not cell.HasSubsystemNamed("localizer")


@pytest.mark.slow
def test_a_gripper_that_waits_for_messages_needs_somebody_who_sends_them():
    evaluate = "gripper.underactuation.evaluate=per_message"
    cell = MakeCell(load_scenario("thesis_kitchen", overrides=[evaluate]))
    assert "gripper.closure_messages" not in port_table(cell)[0]
    with pytest.raises(ScenarioError, match=r"per_message needs planner: !Script"):
        MakeCell(load_scenario("kitchen", overrides=[evaluate]))


def test_a_script_drives_the_station(scripted):
    cell = MakeCell(scripted)
    simulator = Simulator(cell)
    context = simulator.get_mutable_context()
    simulator.AdvanceTo(0.5)  # half of the first step, from 0.4 m down to 0.22 m
    q = cell.GetOutputPort("arm.state_measured").Eval(context)[:3]
    assert q == pytest.approx([0.0, 0.0, 0.31], abs=2e-3)
    assert cell.GetOutputPort("planner.mode").Eval(context) is Mode.GRASP


@pytest.mark.slow
@pytest.mark.parametrize("limit", [None, 0.3])
def test_a_script_limits_the_force_only_if_it_says_so(scripted, limit):
    script = [ScriptStep(closure=1.0, force_limit=limit)]
    cell = MakeCell(dc.replace(scripted, planner=Script(steps=script)))
    port = cell.GetSubsystemByName("station").GetInputPort("gripper.force_limit")
    station_context = cell.GetSubsystemByName("station").GetMyContextFromRoot(
        cell.CreateDefaultContext()
    )
    assert port.HasValue(station_context) == (limit is not None)


@dc.dataclass(kw_only=True)
class Close(PlannerConfig):
    """A planner of one's own, which closes the hand."""

    closure: float = 0.5


def AddClose(builder, scenario, station):
    step = ScriptStep(closure=scenario.planner.closure)
    planner = ScriptedPlanner(np.array(scenario.arm.home), [step])
    return builder.AddNamedSystem("planner", planner)


@pytest.mark.slow
def test_a_planner_of_ones_own_is_added_by_its_tag(scripted, monkeypatch):
    monkeypatch.setattr(module, "_PLANNERS", dict(module._PLANNERS))
    monkeypatch.setattr(module, "accept_planner", lambda config: None)
    own = dc.replace(scripted, planner=Close(closure=0.25))
    with pytest.raises(ScenarioError, match=r"^planner: a cell does not know !Close"):
        MakeCell(own)
    register_planner(Close, AddClose)
    cell = MakeCell(own)
    port = cell.GetOutputPort("gripper.closure_commanded")
    assert port.Eval(cell.CreateDefaultContext()) == 0.25
