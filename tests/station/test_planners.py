import numpy as np
import pytest
from helpers import port_table
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.systems.analysis import Simulator

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.solids import planned_solid
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.planning.pick_and_place.knowledge import PlannerMemory
from drake_srg.planning.pick_and_place.replanning import Replanner
from drake_srg.planning.pick_and_place.sightings import (
    PickTask,
    Sightings,
    View,
    set_down_at,
)
from drake_srg.scenario import load_scenario
from drake_srg.station import (
    MakeCell,
    MakePlanner,
    MakeScriptedPlanner,
    MakeTaskPlanner,
)
from drake_srg.theses.script import ScriptedPlanner
from drake_srg.types import Blob, Mode

GRAVITY = np.array([0.0, 0.0, -1.0])
BLUE = "object.color_range={space: hsv, lower: [190, 0.4, 0.2], upper: [250, 1, 1]}"
MUG = "objects.mug={model: package://drake_srg/sdf/mug.sdf, position: [0.6, 0.1]}"


def test_the_planner_has_the_goal_and_settings_of_the_scenario():
    scenario = load_scenario("kitchen", seed=1)
    planner = MakePlanner(scenario)
    # Half the can's height, 101.8 mm, above the table.
    p_WO = planner.task.goal.translation()
    assert p_WO == pytest.approx([0.55, -0.42, 0.0509], abs=1e-4)
    assert planner.task.tolerance == scenario.task.place.tolerance
    assert planner.config is scenario.planner


def test_other_known_objects_are_obstacles():
    ball = "objects.ball={shape: !Sphere {radius: 0.03}, mass: 0.1, friction: 1}"
    scenario = load_scenario("kitchen", seed=1, overrides=[ball])
    shape = scenario.objects["ball"].shape
    assert MakePlanner(scenario).task.obstacles == {"ball": shape}


@pytest.mark.slow
def test_an_object_without_a_simple_shape_is_neither_located_nor_avoided():
    overrides = [MUG, "object.position=[0.5, -0.1]"]
    scenario = load_scenario("kitchen", seed=1, overrides=overrides)
    assert MakePlanner(scenario).task.obstacles == {}
    cell = MakeCell(scenario)
    blobs = cell.GetOutputPort("localizer.blobs").Eval(cell.CreateDefaultContext())
    assert {blob.object_name for blob in blobs} == {"soup_can"}


def test_an_object_without_a_simple_shape_is_picked_only_by_its_colours():
    scenario = load_scenario("kitchen", overrides=[MUG, "task.pick=mug"])
    with pytest.raises(ScenarioError, match=r"objects\.mug\.color_range: must be"):
        MakePlanner(scenario)


def test_another_solid_that_is_located_is_avoided():
    color = BLUE.replace("object.", "objects.mug.")
    scenario = load_scenario("kitchen", overrides=[MUG, color])
    assert set(MakePlanner(scenario).task.obstacles) == {"mug"}


def as_picked(*overrides):
    """Return `kitchen` with a blue mug to pick, which stands on the table."""
    changes = ["object.model=package://drake_srg/sdf/mug.sdf", BLUE, *overrides]
    return load_scenario("kitchen", seed=0, overrides=changes)


@pytest.mark.parametrize(("yaw", "height"), [(0.0, 0.0), (1.3, 0.1)])
def test_a_mug_is_taken_by_its_pieces_and_set_down_as_it_stood(yaw, height):
    scenario = as_picked(f"task.place.height={height}")
    planner, task = MakePlanner(scenario), MakeTaskPlanner(scenario)
    np.testing.assert_allclose(planner.task.goal.translation(), [0.55, -0.42, height])
    mug = planned_solid("soup_can", scenario.objects["soup_can"])
    X_WO = RigidTransform(RollPitchYaw(0.0, 0.0, yaw), [0.6, 0.1, 0.0])
    assert task.rests(mug, X_WO)
    assert not task.rests(mug, RigidTransform([0.6, 0.1, 0.05]))
    planned = task.plan(task.q_home, X_WO, mug, planner.task.goal)
    assert not isinstance(planned, PlanningFailure), planned.message
    ends = {
        mode: task.scene.X_WG(planned.motions[mode].value(1e9)[:, 0])
        for mode in (Mode.GRASP, Mode.PLACE)
    }
    X_GO = ends[Mode.GRASP].inverse() @ X_WO
    X_WO_placed = ends[Mode.PLACE] @ X_GO
    np.testing.assert_allclose(X_WO_placed.rotation().col(2), [0, 0, 1], atol=0.01)
    above = X_WO_placed.translation() - planner.task.goal.translation()
    np.testing.assert_allclose(above[:2], 0.0, atol=0.003)
    assert 0.0 <= above[2] < 0.01


def test_a_mug_that_lies_is_set_down_as_it_lies():
    scenario = as_picked()
    task, goal = MakeTaskPlanner(scenario), MakePlanner(scenario).task.goal
    mug = planned_solid("soup_can", scenario.objects["soup_can"])
    R_WO = RotationMatrix.MakeFromOneVector(-mug.resting[1], 2).inverse()
    X_WO = RigidTransform(R_WO, [0.6, 0.1, mug.half_extent(mug.resting[1])])
    X_WO_goal = set_down_at(goal, X_WO, mug)
    assert task.rests(mug, X_WO_goal)
    planned = task.plan(task.q_home, X_WO, mug, X_WO_goal)
    assert not isinstance(planned, PlanningFailure), planned.message
    X_WG = task.scene.X_WG(planned.motions[Mode.PLACE].value(1e9)[:, 0])
    X_WO_placed = X_WG @ planned.grasp.X_GO
    np.testing.assert_allclose(
        X_WO_placed.rotation().matrix()[2], R_WO.matrix()[2], atol=0.01
    )


def test_a_mug_that_has_toppled_is_set_down_as_it_lies_now():
    """Its goal is that of the side on which it was seen last."""
    scenario = as_picked()
    planner, task = MakePlanner(scenario), MakeTaskPlanner(scenario)
    mug = planned_solid("soup_can", scenario.objects["soup_can"])
    sightings = Sightings(PickTask("soup_can", mug, planner.task.goal), 0.1)
    replanner = Replanner(task, sightings, scenario.planner)
    memory = PlannerMemory(Motion(task.q_home))
    for down in (GRAVITY, mug.resting[1]):
        R_WO = RotationMatrix.MakeFromOneVector(-down, 2).inverse()
        X_WO = RigidTransform(R_WO, [0.6, 0.1, mug.half_extent(down)])
        blob = Blob("soup_can", "ceiling", (0.0, 0.0), X_WO, 1.0)
        replanner.plan(View([blob]), memory, 0.0)
        assert memory.attempt.motions is not None, memory.trouble
        R_goal = replanner.goal(memory).rotation().matrix()
        np.testing.assert_allclose(R_goal.T @ GRAVITY, down, atol=1e-6)


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
    once = sum(step.duration for step in scenario.planner.steps)
    for k in range(repeat):
        context.SetTime(once * k + 0.5 * scenario.planner.steps[0].duration)
        assert mode.Eval(context).value == scenario.planner.steps[0].mode
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
    target = scenario.planner.steps[1].arm
    # Half a second at 80 degrees/s³, then half a second at 40 degrees/s².
    ahead = np.deg2rad(80.0 * 0.5**3 / 6.0 + 10.0 * 0.5 + 40.0 * 0.5**2 / 2.0)
    assert q[3] == pytest.approx(ahead)
    assert 0.0 < q[3] < target[3]
