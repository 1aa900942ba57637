"""What the planner knows of the gripper follows the gripper's driver."""

import dataclasses as dc

import pytest
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed
from pydrake.math import RigidTransform

from drake_srg.cell import MakeHand, MakeTaskPlanner, register_gripper
from drake_srg.common.exceptions import ScenarioError
from drake_srg.gripper.drivers import SrgPositionDriver
from drake_srg.planning.grasps.linkage_hand import LinkageHand
from drake_srg.planning.grasps.srg_hand import SrgHand
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Cylinder

CAN = Cylinder(0.0339, 0.1018)
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
        same = yaml_load_typed(schema=Scenario, data=yaml_dump_typed(scenario))
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
