import numpy as np
import pytest
from helpers import port_table
from pydrake.systems.analysis import Simulator

from drake_srg.cell import (
    MakeCell,
    MakePlanner,
    MakeScriptedPlanner,
    MakeTaskPlanner,
)
from drake_srg.common.exceptions import ScenarioError
from drake_srg.planning.script.scripted import ScriptedPlanner
from drake_srg.scenario import load_scenario
from drake_srg.types import Mode

MUG = "objects.mug={model: package://drake_srg/sdf/mug.sdf, position: [0.6, 0.1]}"


def test_the_planner_has_the_goal_and_settings_of_the_scenario():
    scenario = load_scenario("kitchen", seed=1)
    planner = MakePlanner(scenario)
    # Half the can's height, 101.8 mm, above the table.
    p_WO = planner.goal.translation()
    assert p_WO == pytest.approx([0.55, -0.42, 0.0509], abs=1e-4)
    assert planner.tolerance == scenario.task.place.tolerance
    assert planner.config is scenario.planner


def test_other_known_objects_are_obstacles():
    ball = "objects.ball={shape: !Sphere {radius: 0.03}, mass: 0.1, friction: 1}"
    scenario = load_scenario("kitchen", seed=1, overrides=[ball])
    shape = scenario.objects["ball"].shape
    assert MakePlanner(scenario).obstacles == {"ball": shape}


@pytest.mark.slow
def test_an_object_without_a_simple_shape_is_neither_located_nor_avoided():
    overrides = [MUG, "object.position=[0.5, -0.1]"]
    scenario = load_scenario("kitchen", seed=1, overrides=overrides)
    assert MakePlanner(scenario).obstacles == {}
    cell = MakeCell(scenario)
    blobs = cell.GetOutputPort("localizer.blobs").Eval(cell.CreateDefaultContext())
    assert {blob.object_name for blob in blobs} == {"soup_can"}


def test_an_object_without_a_simple_shape_cannot_be_picked():
    scenario = load_scenario("kitchen", overrides=[MUG, "task.pick=mug"])
    with pytest.raises(ScenarioError, match=r"objects\.mug\.model: .* must have one"):
        MakePlanner(scenario)


def test_planners_do_not_share_their_models():
    scenario = load_scenario("kitchen")
    first, second = (MakeTaskPlanner(scenario).scene for _ in range(2))
    second.fingers = second.fingers + 0.1
    assert not np.any(first.fingers == second.fingers)


def test_a_script_is_played_by_a_scripted_planner():
    assert isinstance(
        MakeScriptedPlanner(load_scenario("gripper_bench")), ScriptedPlanner
    )


@pytest.mark.parametrize("repeat", [1, 2, 3])
@pytest.mark.parametrize("name", ["gripper_bench", "thesis_kitchen"])
def test_a_script_is_played_as_often_as_the_task_says(name, repeat):
    scenario = load_scenario(name, overrides=[f"task.repeat={repeat}"])
    planner = MakeScriptedPlanner(scenario)
    context = planner.CreateDefaultContext()
    mode = planner.GetOutputPort("mode")
    once = sum(step.duration for step in scenario.script)
    for k in range(repeat):
        context.SetTime(once * k + 0.5 * scenario.script[0].duration)
        assert mode.Eval(context).value == scenario.script[0].mode
    context.SetTime(once * repeat - 0.1)
    assert mode.Eval(context) != Mode.DONE
    context.SetTime(once * repeat)
    assert mode.Eval(context) == Mode.DONE


def test_targets_in_messages_are_reached_with_limited_jerk():
    scenario = load_scenario("thesis_kitchen")
    planner = MakeScriptedPlanner(scenario)
    assert port_table(planner)[1].keys() == {
        *("position_commanded", "closure_commanded", "closure_messages"),
        *("force_limit", "mode", "status"),
    }
    simulator = Simulator(planner)
    simulator.AdvanceTo(20.0 + 1.0)  # the first 500 messages are for home
    q = planner.GetOutputPort("position_commanded").Eval(simulator.get_context())
    target = scenario.script[1].arm
    # Half a second at 80 degrees/s³, then half a second at 40 degrees/s².
    ahead = np.deg2rad(80.0 * 0.5**3 / 6.0 + 10.0 * 0.5 + 40.0 * 0.5**2 / 2.0)
    assert q[3] == pytest.approx(ahead)
    assert 0.0 < q[3] < target[3]
