import dataclasses as dc

import numpy as np
import pytest
from helpers import port_table
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.yaml import yaml_dump_typed
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.systems.analysis import Simulator

from drake_srg.common.exceptions import ScenarioError
from drake_srg.gripper import SrgPositionDriver
from drake_srg.objects.config import ColorRangeConfig
from drake_srg.objects.solids import planned_solid
from drake_srg.planning.grasps.linkage_hand import LinkageHand
from drake_srg.planning.grasps.srg_hand import SrgHand
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.motion.planning_scene import PlanningFailure
from drake_srg.planning.pick_and_place.knowledge import PlannerMemory
from drake_srg.planning.pick_and_place.replanning import Replanner
from drake_srg.planning.pick_and_place.sightings import (
    PickTask,
    Sightings,
    View,
    lean,
    set_down_at,
    standing_at,
)
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.scenario.typed_yaml import read_typed
from drake_srg.station import (
    MakeCell,
    MakeHand,
    MakePlanner,
    MakeScriptedPlanner,
    MakeTaskPlanner,
    register_gripper,
)
from drake_srg.station.planners import final_pose, final_tilt, goal_pose
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.theses.script import Script, ScriptedPlanner, ScriptStep
from drake_srg.types import Blob, Cylinder, Mode, Sphere

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


KITCHEN = load_scenario("kitchen", seed=0)
MUG_TO_PICK = dc.replace(
    KITCHEN.objects["soup_can"],
    model="package://drake_srg/sdf/mug.sdf",
    color_range=ColorRangeConfig(),
)
CAN = Cylinder(0.0339, 0.1018)
START = RigidTransform([0.6, 0.1, 0.0509])


def with_task(**changes):
    return dc.replace(KITCHEN, task=dc.replace(KITCHEN.task, **changes))


def test_the_goal_is_on_the_table_unless_a_height_is_given():
    x, y = KITCHEN.task.place.position
    p = goal_pose(KITCHEN, CAN).translation()
    np.testing.assert_allclose(p, [x, y, 0.0509])
    place = dc.replace(KITCHEN.task.place, height=-0.005)
    p = goal_pose(with_task(place=place), CAN).translation()
    np.testing.assert_allclose(p, [x, y, 0.0459])


@pytest.mark.parametrize("repeat", [1, 2, 3, 4])
def test_every_second_cycle_returns_the_object(repeat):
    final = final_pose(with_task(repeat=repeat), START).translation()
    place = [*KITCHEN.task.place.position, 0.0509]
    there = START.translation() if repeat % 2 == 0 else place
    np.testing.assert_allclose(final, there, atol=1e-4)


def test_a_script_keeps_height_and_orientation():
    lying = RigidTransform(RollPitchYaw(0.5, 1.0, 0.2), [0.6, 0.1, 0.3])
    scripted = dc.replace(KITCHEN, planner=Script(steps=[ScriptStep()]))
    final = final_pose(scripted, lying)
    np.testing.assert_allclose(final.translation(), [*KITCHEN.task.place.position, 0.3])
    np.testing.assert_array_equal(final.rotation().matrix(), lying.rotation().matrix())


@pytest.mark.parametrize(("repeat", "height"), [(1, None), (2, None), (1, 0.1)])
def test_what_is_no_simple_shape_stays_as_it_stood(repeat, height):
    place = dc.replace(KITCHEN.task.place, height=height)
    scenario = dc.replace(
        with_task(place=place, repeat=repeat), objects={"soup_can": MUG_TO_PICK}
    )
    start = RigidTransform(RollPitchYaw(0.0, 0.0, 0.2), [0.6, 0.1, 0.0])
    final = final_pose(scenario, start)
    there = [*place.position, height or 0.0]
    expected = start.translation() if repeat == 2 else there
    np.testing.assert_allclose(final.translation(), expected, atol=1e-4)
    np.testing.assert_array_equal(final.rotation().matrix(), start.rotation().matrix())


def test_what_lies_may_be_turned_about_the_vertical_but_not_tilted():
    scenario = dc.replace(KITCHEN, objects={"soup_can": MUG_TO_PICK})
    lying = RollPitchYaw(1.5, 0.0, 0.2).ToRotationMatrix()
    start = RigidTransform(lying, [0.6, 0.1, 0.04])
    for roll, yaw in ((0.0, 0.8), (0.1, 0.0)):
        end = RigidTransform(RollPitchYaw(roll, 0.0, yaw).ToRotationMatrix() @ lying)
        assert final_tilt(scenario, start, end) == pytest.approx(roll, abs=1e-9)


def test_a_ball_has_no_tilt():
    ball = dc.replace(KITCHEN.objects["soup_can"], model=None, shape=Sphere(0.03))
    scenario = dc.replace(KITCHEN, objects={"soup_can": ball})
    assert final_tilt(scenario, START, START) is None


@given(
    roll=st.floats(-np.pi, np.pi),
    pitch=st.floats(-1.5, 1.5),
    radius=st.floats(0.01, 0.05),
    length=st.floats(0.02, 0.2),
)
def test_righting_an_object_keeps_its_lowest_point(roll, pitch, radius, length):
    shape = Cylinder(radius, length)
    X_WO = RigidTransform(RollPitchYaw(roll, pitch, 0.0), [0.1, 0.2, 0.3])
    angle = np.linspace(0.0, 2.0 * np.pi, 721)
    # Sampled on the rims.
    rim = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.0 * angle])
    ends = [rim + np.array([[0.0], [0.0], [s * length / 2]]) for s in (-1, 1)]
    lowest = min((X_WO @ end)[2].min() for end in ends)
    stands = standing_at(X_WO, shape)
    # Halfway between samples, the rim is up to 1e-5 of its radius lower.
    assert stands.translation()[2] - length / 2 == pytest.approx(lowest, abs=1e-6)
    np.testing.assert_array_equal(stands.translation()[:2], [0.1, 0.2])
    assert lean(stands.rotation().col(2), np.array([0.0, 0.0, 1.0])) == 0.0


APPROACHES = "planner.approaches=[above, side]"


def hand_of(name, *overrides):
    scenario = load_scenario(name, overrides=[APPROACHES, *overrides])
    return MakeHand(scenario, MakeModelsPlant(scenario))


@pytest.mark.parametrize(
    ("scenario", "key"),
    [
        ("kitchen", "gripper.underactuation.full_scale"),
        ("kitchen_tendon", "gripper.spool.full_scale"),
    ],
)
@pytest.mark.parametrize("full_scale", [2.6, 3.3])
def test_the_srgs_closure_commands_follow_the_full_scale_of_its_driver(
    scenario, key, full_scale
):
    nominal = hand_of(scenario).grasps(CAN, RigidTransform())
    scaled = hand_of(scenario, f"{key}={full_scale}").grasps(CAN, RigidTransform())
    assert len(nominal) > 1
    for grasp, other in zip(nominal, scaled, strict=True):
        for name in ("closure_open", "closure_closed"):
            asked = 3.0 * getattr(grasp, name)
            expected = min(1.0, asked / full_scale)
            assert getattr(other, name) == pytest.approx(expected), name


def test_the_task_planner_has_that_hand():
    overrides = ["gripper.underactuation.full_scale=2.6"]
    scenario = load_scenario("kitchen", overrides=overrides)
    assert MakeTaskPlanner(scenario).hand.pinch.full_scale == 2.6


def test_the_linkage_grippers_closure_commands_follow_its_full_scale():
    hand = hand_of("assistive_arm", "gripper.master_slave.full_scale=0.6")
    assert isinstance(hand, LinkageHand)
    assert hand.pinch.full_scale == 0.6


def test_a_driver_has_the_hand_of_the_class_that_it_derives_from():
    class Stiffer(SrgPositionDriver):
        pass

    scenario = load_scenario("kitchen")
    plant = MakeModelsPlant(scenario)
    other = dc.replace(scenario, gripper=Stiffer())
    assert MakeHand(other, plant) == MakeHand(scenario, plant)


def test_a_driver_without_a_hand_is_named():
    scenario = dc.replace(load_scenario("kitchen"), gripper=None)
    with pytest.raises(ScenarioError, match=r"needs a Hand .* register_gripper"):
        MakeHand(scenario, MakeModelsPlant(load_scenario("kitchen")))


@pytest.fixture
def registered():
    """Lets a test register drivers that others do not see."""
    (field,) = (f for f in dc.fields(Scenario) if f.name == "gripper")
    before = field.type
    yield
    field.type = Scenario.__annotations__["gripper"] = before


def make_driver(**defaults):
    """A driver of your own; each call makes another class of the same name."""

    @dc.dataclass(kw_only=True)
    class Mine(SrgPositionDriver):
        motor_strength: float = defaults.get("motor_strength", 1.0)

    return Mine


def test_a_registered_driver_is_a_tag_of_scenario_files(registered):
    with pytest.raises(ScenarioError, match="unknown tag !Mine"):
        load_scenario("kitchen", overrides=["gripper=!Mine {}"])
    register_gripper(make_driver(motor_strength=0.7))
    scenario = load_scenario("kitchen", overrides=["gripper=!Mine {trigger: touch}"])
    assert scenario.gripper.motor_strength == 0.7
    # A camera process gets the scenario as Drake writes and reads it.
    for name in ("SrgPositionDriver", "Mine"):
        scenario = load_scenario("kitchen", overrides=[f"gripper=!{name} {{}}"])
        same = read_typed(Scenario, yaml_dump_typed(scenario))
        assert type(same.gripper).__name__ == name
        assert same.gripper == scenario.gripper


def test_a_driver_that_is_defined_again_replaces_the_first(registered):
    for strength in (0.7, 0.8):
        register_gripper(make_driver(motor_strength=strength))
        scenario = load_scenario("kitchen", overrides=["gripper=!Mine {}"])
        assert scenario.gripper.motor_strength == strength


def test_a_registered_hand_wins_over_that_of_the_base_class(registered):
    driver, made = make_driver(), SrgHand([], [], 0.1)
    register_gripper(driver, lambda driver, planner, plant: made)
    scenario = load_scenario("kitchen", overrides=["gripper=!Mine {}"])
    assert MakeHand(scenario, MakeModelsPlant(scenario)) is made
