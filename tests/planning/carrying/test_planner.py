"""The transitions of carrying together, its commands, and what it refuses."""

import itertools

import numpy as np
import pytest
from pydrake.common.yaml import yaml_dump_typed
from pydrake.math import RigidTransform

from drake_srg.common.exceptions import ScenarioError
from drake_srg.planning.carrying.config import CarryMode, CarryTogether
from drake_srg.planning.carrying.planner import (
    CARRY_TRANSITIONS,
    LargeSightings,
    carry_transition,
)
from drake_srg.planning.pick_and_place.sightings import PickTask, View
from drake_srg.planning.planner_machine import Observation
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.scenario.typed_yaml import read_typed
from drake_srg.station.planners import MakeCarryPlanner
from drake_srg.types import Blob, BlobFlag, Box, Failure, Mode

CONFIG = CarryTogether()
GOES_WELL = Observation(
    ready=True, arrived=True, holding=True, still=True, clear=True, at_goal=True
)
ORDER = (
    *(Mode.IDLE, Mode.PRE_GRASP, Mode.GRASP, Mode.CLOSE, Mode.VERIFY),
    *(CarryMode.SETTLE, Mode.LIFT, Mode.TRANSFER, Mode.PLACE, Mode.RELEASE),
    *(Mode.RETREAT, Mode.HOME, Mode.DONE),
)


def following(mode, observation, t=1.0):
    return carry_transition(mode, observation, t, CONFIG)


def test_modes_follow_one_another_if_all_goes_well():
    for mode, next_mode in itertools.pairwise(ORDER):
        assert following(mode, GOES_WELL) is next_mode


def test_every_mode_waits_for_its_end():
    for mode in ORDER:
        if mode is not Mode.VERIFY:
            assert following(mode, Observation(holding=True), t=0.0) is mode


@pytest.mark.parametrize("mode", ORDER[4:8])
def test_hands_that_lose_the_object_open(mode):
    assert following(mode, Observation(arrived=True)) is Mode.RELEASE


def test_the_lift_waits_for_its_plan():
    settled = Observation(arrived=True, holding=True)
    assert following(CarryMode.SETTLE, settled) is CarryMode.SETTLE
    trapped = Observation(failure=Failure.OUT_OF_REACH)
    assert following(CarryMode.SETTLE, trapped) is Mode.FAILED


@pytest.mark.parametrize("failure", [Failure.TIME_BUDGET, Failure.STOPPED])
def test_reasons_to_give_up_end_every_mode(failure):
    for mode in CARRY_TRANSITIONS:
        ended = mode in (Mode.DONE, Mode.FAILED)
        expected = mode if ended else Mode.FAILED
        assert following(mode, Observation(failure=failure)) is expected


def test_an_uncertain_part_of_the_object_is_no_obstacle():
    box = Box([0.7, 0.26, 0.1])
    sightings = LargeSightings(PickTask("crate", box, RigidTransform()), 0.2)

    def blob(x, certain):
        flags = frozenset() if certain else frozenset({BlobFlag.UNCERTAIN})
        X_WO = RigidTransform([x, 0.0, 0.05])
        return Blob("crate", "top", (0.0, 0.0), X_WO, 1.0, flags)

    found = [
        len(sightings.obstacles(View([blob(0.3, certain)]), np.zeros(3)))
        for certain in (True, False)
    ]
    assert found == [1, 0]


def test_the_planner_commands_each_arm_by_its_name():
    scenario = load_scenario("carry_together")
    planner = MakeCarryPlanner(scenario)
    context = planner.CreateDefaultContext()
    for name in ("left", "right"):
        home = scenario.arms[name].arm.home
        port = planner.GetOutputPort(f"{name}.position_commanded")
        np.testing.assert_array_equal(port.Eval(context), home)
        assert planner.GetOutputPort(f"{name}.closure_commanded").Eval(context) == [0]


@pytest.mark.parametrize(
    ("override", "message"),
    [
        (
            "objects.crate={model: null, shape: !Box {size: [0.7, 0.26, 0.1]}, "
            "mass: 1, friction: 1}",
            r"objects\.crate: must be a model with two end walls",
        ),
        (
            "objects.crate.model=package://drake_srg/sdf/bowl.sdf",
            r"objects\.crate: must be a model with two end walls",
        ),
        (
            "objects.crate.known_scale=0.4",
            r"objects\.crate: must be wider than one hand opens \(136 mm\).*104 mm",
        ),
        (
            "objects.crate.known_scale=3.0",
            r"arms\.left\.gripper: knows no grasp from above of an end wall",
        ),
    ],
)
def test_objects_that_two_hands_cannot_or_need_not_carry_are_refused(override, message):
    with pytest.raises(ScenarioError, match=message):
        MakeCarryPlanner(load_scenario("carry_together", overrides=[override]))


def test_the_configuration_is_sent_to_other_processes():
    """As the process that renders the video gets it."""
    scenario = load_scenario("carry_together")
    again = read_typed(Scenario, yaml_dump_typed(scenario))
    assert again.planner == scenario.planner
    assert again.arms == scenario.arms
