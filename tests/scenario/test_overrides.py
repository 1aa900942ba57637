"""The effect of `--set` and `overrides` on a scenario."""

import numpy as np

from drake_srg.gripper import SrgPositionDriver
from drake_srg.scenario import load_scenario
from drake_srg.types import Box, Sphere


def test_values_of_overrides_are_yaml_with_tags():
    scenario = load_scenario(
        "kitchen",
        overrides=[
            "planner.max_attempts=1",
            "object.friction=0",
            "object.covered=true",
            "gripper=!SrgPositionDriver {proximity: {range: 0.1}}",
            "object.model=null",
            "object.shape=!Box {size: [0.05, 0.06, 0.07]}",
            "planner={lift_height: 0.1}",
            "random_seed=5",
        ],
    )
    assert scenario.planner.max_attempts == 1
    assert scenario.planner.lift_height == 0.1
    can = scenario.objects["soup_can"]
    assert (can.friction, can.covered, can.shape) == (
        0.0,
        True,
        Box([0.05, 0.06, 0.07]),
    )
    assert isinstance(scenario.gripper, SrgPositionDriver)
    assert scenario.gripper.proximity.range == 0.1
    assert scenario.random_seed == 5


def test_the_seed_argument_beats_an_override():
    assert (
        load_scenario("kitchen", seed=4, overrides=["random_seed=5"]).random_seed == 4
    )


def test_object_means_the_picked_object():
    scenario = load_scenario(
        "kitchen",
        overrides=[
            "objects.ball={shape: !Sphere {radius: 0.03}, mass: 1, friction: 1}",
            "task.pick=ball",
            "object.mass=0.2",
        ],
    )
    assert scenario.objects["ball"].mass == 0.2
    assert scenario.objects["ball"].shape == Sphere(0.03)
    assert scenario.objects["soup_can"].mass != 0.2


def test_overrides_reach_into_lists():
    turned = "directives.gripper::palm.add_weld.X_PC.rotation=!Rpy {deg: [0, 0, 90]}"
    scenario = load_scenario(
        "gripper_bench", overrides=[turned, "planner.steps.0.duration=2"]
    )
    X_PC = scenario.directives[5].add_weld.X_PC.GetDeterministicValue()
    np.testing.assert_allclose(X_PC.rotation().col(0), [0, 1, 0], atol=1e-12)
    assert scenario.planner.steps[0].duration == 2.0


def test_an_object_with_a_pose_gets_no_position():
    pose = "object.pose={translation: [0.5, 0, !Uniform {min: 0.2, max: 0.3}]}"
    can = load_scenario("kitchen", overrides=[pose]).objects["soup_can"]
    assert can.position is None
    assert 0.2 <= can.pose.translation[2] <= 0.3
