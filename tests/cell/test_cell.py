import dataclasses as dc

import numpy as np
import pytest
from helpers import port_table
from pydrake.systems.analysis import Simulator

from drake_srg.cell import MakeCell, MakePlanner, MakeScriptedPlanner
from drake_srg.cell.perception import _targets
from drake_srg.common.exceptions import ScenarioError
from drake_srg.planning.script.scripted import ScriptStep
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeStation
from drake_srg.types import Mode
from drake_srg.vision.blob_localizer import BlobLocalizer


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("kitchen", seed=1)


@pytest.fixture(scope="module")
def cell(scenario):
    return MakeCell(scenario)


def test_it_exports_the_stations_ports_and_its_own(cell, scenario):
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


def test_objects_that_look_alike_are_refused():
    ball = "{shape: !Sphere {radius: 0.03}, mass: 0.1, friction: 1, position: "
    balls = [f"objects.a={ball}[0.5, 0.5]}}", f"objects.b={ball}[0.8, 0.5]}}"]
    with pytest.raises(ScenarioError, match=r"objects\.b: cannot be told from a;"):
        MakeCell(load_scenario("kitchen", overrides=balls))
    MakeCell(load_scenario("kitchen", overrides=[*balls, "objects.b.color=[0, 0, 1]"]))


def test_its_parts_have_names(cell):
    for name in ("station", "localizer", "planner"):
        assert cell.HasSubsystemNamed(name)


def test_the_localizer_sees_the_object(cell, scenario):
    context = cell.CreateDefaultContext()
    (blob,) = cell.GetOutputPort("localizer.blobs").Eval(context)
    truth = cell.GetOutputPort("object_poses_cheat").Eval(context)["soup_can"]
    assert blob.object_name == "soup_can"
    assert blob.camera == "ceiling"
    # The project's own limit, 0.5 mm on each axis.
    assert blob.position == pytest.approx(truth.translation(), abs=5e-4)


def test_the_goal_is_on_the_table(scenario):
    planner = MakePlanner(scenario)
    # Half the can's height, 101.8 mm, above the table's top.
    p_WO = planner.goal.translation()
    assert p_WO == pytest.approx([0.55, -0.42, 0.0509], abs=1e-4)
    assert planner.tolerance == scenario.task.place.tolerance
    assert planner.config is scenario.planner


def test_it_looks_and_then_moves(cell):
    simulator = Simulator(cell)
    context = simulator.get_mutable_context()
    assert cell.GetOutputPort("planner.mode").Eval(context) is Mode.IDLE
    simulator.AdvanceTo(0.2)  # the planner's latency is 0.1 s
    assert cell.GetOutputPort("planner.mode").Eval(context) is Mode.PRE_GRASP
    assert cell.GetOutputPort("planner.status").Eval(context).looks == 1


def test_images_are_searched_only_when_the_planner_looks(scenario, monkeypatch):
    searched = []
    locate = BlobLocalizer._locate

    def count(self, context):
        searched.append(context.get_time())
        return locate(self, context)

    monkeypatch.setattr(BlobLocalizer, "_locate", count)
    cell = MakeCell(scenario)
    simulator = Simulator(cell)
    simulator.AdvanceTo(0.3)
    assert searched == [0.0]


# With a script.


@pytest.fixture(scope="module")
def scripted():
    bench = load_scenario("gripper_bench")
    bench.cameras.clear()
    return bench


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


def test_a_script_drives_the_station(scripted):
    cell = MakeCell(scripted)
    simulator = Simulator(cell)
    context = simulator.get_mutable_context()
    simulator.AdvanceTo(0.5)  # half of the first step, from 0.4 m down to 0.22 m
    q = cell.GetOutputPort("arm.state_measured").Eval(context)[:3]
    assert q == pytest.approx([0.0, 0.0, 0.31], abs=2e-3)
    assert cell.GetOutputPort("planner.mode").Eval(context) is Mode.GRASP


@pytest.mark.parametrize("limit", [None, 0.3])
def test_a_script_limits_the_force_only_where_it_says_so(scripted, limit):
    script = [ScriptStep(closure=1.0, force_limit=limit)]
    cell = MakeCell(dc.replace(scripted, script=script))
    port = cell.GetSubsystemByName("station").GetInputPort("gripper.force_limit")
    station_context = cell.GetSubsystemByName("station").GetMyContextFromRoot(
        cell.CreateDefaultContext()
    )
    assert port.HasValue(station_context) == (limit is not None)


def test_objects_that_nobody_knows_the_shape_of_are_not_looked_for(scenario):
    mug = "objects.mug={model: package://drake_srg/sdf/mug.sdf, position: [0.9, 0.5]}"
    busy = load_scenario("kitchen", seed=1, overrides=[mug])
    assert [target.name for target in _targets(busy)] == ["soup_can"]
    assert MakePlanner(busy).obstacles == {}
    with pytest.raises(ScenarioError, match=r"objects\.mug\.model: .* must have one"):
        MakeCell(
            load_scenario("kitchen", overrides=[mug, "task.pick=mug"]),
        )


def test_cells_are_freed(leaked, scenario):
    simulator = Simulator(MakeCell(scenario))
    simulator.AdvanceTo(0.02)
    assert len(leaked()) > 6  # otherwise this would test nothing
    del simulator
    assert leaked() == []


def test_targets_in_messages_are_reached_with_limited_jerk():
    scenario = load_scenario("thesis_kitchen")
    planner = MakeScriptedPlanner(scenario)
    assert port_table(planner)[1].keys() == {
        *("position_commanded", "closure_commanded", "force_limit", "mode", "status"),
    }
    simulator = Simulator(planner)
    simulator.AdvanceTo(20.0 + 1.0)  # the first 500 messages are for home
    q = planner.GetOutputPort("position_commanded").Eval(simulator.get_context())
    target = scenario.script[1].arm
    # Half a second at 80 degrees/s³, then half a second at 40 degrees/s².
    ahead = np.deg2rad(80.0 * 0.5**3 / 6.0 + 10.0 * 0.5 + 40.0 * 0.5**2 / 2.0)
    assert q[3] == pytest.approx(ahead)
    assert 0.0 < q[3] < target[3]
