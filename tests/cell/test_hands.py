"""What the planner knows of the gripper follows the gripper's driver."""

import dataclasses as dc

import numpy as np
import pytest

from drake_srg.cell import MakeHand, MakeTaskPlanner
from drake_srg.common.exceptions import ScenarioError
from drake_srg.gripper.drivers import SrgPositionDriver
from drake_srg.planning.grasps.linkage_hand import LinkageHand
from drake_srg.scenario import load_scenario
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Cylinder

CAN = Cylinder(0.0339, 0.1018)
UP = np.array([0.0, 0.0, 1.0])
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
    nominal = hand_of(scenario).grasps(CAN, UP)
    scaled = hand_of(scenario, f"{key}={full_scale}").grasps(CAN, UP)
    assert len(nominal) > 1
    for grasp, other in zip(nominal, scaled, strict=True):
        for name in ("closure_open", "closure_closed"):
            asked = 3.0 * getattr(grasp, name)
            expected = min(1.0, asked / full_scale)
            assert getattr(other, name) == pytest.approx(expected), name


def test_the_task_planner_has_that_hand():
    overrides = ["gripper.underactuation.full_scale=2.6"]
    scenario = load_scenario("kitchen", overrides=overrides)
    assert MakeTaskPlanner(scenario).hand.full_scale == 2.6


def test_the_linkage_grippers_closure_commands_follow_its_full_scale():
    hand = hand_of("assistive_arm", "gripper.master_slave.full_scale=0.6")
    assert isinstance(hand, LinkageHand)
    assert hand.full_scale == 0.6


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
