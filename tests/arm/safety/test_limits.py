import math

import numpy as np
import pytest
from pydrake.multibody.tree import JacobianWrtVariable

from drake_srg.arm.safety.config import (
    BodyRegionLimits,
    ForceLimitConfig,
    SafetyConfig,
    WorkspaceConfig,
)
from drake_srg.arm.safety.limits import JointLimits, Tool, ToolLimits, TouchLimits
from drake_srg.common.safety_states import StopReason
from drake_srg.scenario import load_scenario
from drake_srg.station.plant import MakeModelsPlant

PERIOD = 0.005


@pytest.fixture(scope="module")
def plant():
    return MakeModelsPlant(load_scenario("kitchen", seed=0))


def limits_of(plant, **config):
    arm = plant.GetModelInstanceByName("arm")
    return JointLimits.of_plant(plant, arm, SafetyConfig(**config), PERIOD)


def test_the_model_fills_in_what_the_configuration_leaves_open(plant):
    limits = limits_of(plant, lower=[-1.0])
    np.testing.assert_array_equal(limits.lower, [-1.0] * 7)
    np.testing.assert_allclose(limits.upper, plant.GetPositionUpperLimits()[:7])
    speed = plant.GetVelocityUpperLimits()[:7]
    np.testing.assert_allclose(limits.step, 1.001 * PERIOD * speed)
    model = plant.GetAccelerationUpperLimits()[:7]
    np.testing.assert_allclose(limits.bend, 1.001 * 1.5 * PERIOD**2 * model)
    np.testing.assert_allclose(limits.brake, 1.001 * 2.0 * PERIOD**2 * model)


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"speed": [1.0, 1.0]}, r"safety.speed: needs 1 entry or one per joint.*\(7\)"),
        ({"lower": [1.0], "upper": [0.5]}, r"safety.lower: must be less than"),
        (
            {"acceleration": [9.0], "stop_acceleration": [9.0]},
            r"safety.stop_acceleration: must be greater than safety.acceleration",
        ),
    ],
)
def test_limits_that_do_not_fit_are_refused(plant, config, message):
    with pytest.raises(ValueError, match=message):
        limits_of(plant, **config)


def test_an_empty_workspace_is_refused():
    box = WorkspaceConfig(min=[-1.0, 1.0, 0.0], max=[1.0, -1.0, 1.0])
    with pytest.raises(ValueError, match=r"safety.workspace.min: must be less than"):
        ToolLimits.of(SafetyConfig(workspace=box), lambda q: q[:3], PERIOD)


Q = np.array([0.1, 0.4, -0.2, -1.3, 0.2, 0.9, 0.3])


@pytest.fixture(scope="module")
def tool(plant):
    return Tool(plant, "arm", "gripper::grasp_center")


def test_its_position_is_that_of_the_frame(plant, tool):
    context = plant.CreateDefaultContext()
    arm = plant.GetModelInstanceByName("arm")
    plant.SetPositions(context, arm, Q)
    frame = plant.GetFrameByName("grasp_center")
    np.testing.assert_allclose(
        tool.position(Q), frame.CalcPoseInWorld(context).translation(), atol=1e-15
    )


def test_it_finds_the_force_that_causes_torques(plant, tool):
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, plant.GetModelInstanceByName("arm"), Q)
    world, frame = plant.world_frame(), plant.GetFrameByName("grasp_center")
    J = plant.CalcJacobianTranslationalVelocity(
        context, JacobianWrtVariable.kV, frame, np.zeros(3), world, world
    )
    arm = plant.GetModelInstanceByName("arm")
    force = np.array([10.0, -20.0, 5.0])
    torque = plant.GetVelocitiesFromArray(arm, J.T @ force)
    assert tool.force(Q, torque) == pytest.approx(np.linalg.norm(force))


@pytest.mark.parametrize("name", ["grasp_center", "gripper::nowhere", "hand::palm"])
def test_an_unknown_frame_is_refused(plant, name):
    with pytest.raises(ValueError, match=f"safety.tool: must be a frame.* '{name}'"):
        Tool(plant, "arm", name)


PROFILE = {
    "hand": BodyRegionLimits(transient=100.0, quasi_static=40.0),
    "arm": BodyRegionLimits(transient=80.0, quasi_static=60.0),
}


class Scale:
    """A tool whose force is the first joint's torque."""

    def force(self, q, torque):
        return abs(torque[0])


def limits(*regions):
    force = ForceLimitConfig(profile=PROFILE, regions=list(regions), transient_time=0.5)
    return TouchLimits.of(SafetyConfig(force=force), 2, Scale())


def test_without_limits_there_is_nothing_to_feel():
    assert TouchLimits.of(SafetyConfig(), 2, None) is None


def test_the_least_limits_of_the_regions_in_reach_hold():
    both = limits("hand", "arm")
    assert (both.transient, both.quasi_static) == (80.0, 40.0)
    assert limits("arm").quasi_static == 60.0


@pytest.mark.parametrize("regions", [[], ["head"], ["hand", "head"]])
def test_unknown_regions_are_refused(regions):
    with pytest.raises(ValueError, match=r"safety.force.regions.*allowed: hand, arm"):
        limits(*regions)


@pytest.mark.parametrize("torque", [[], [1.0] * 3])
def test_torques_must_fit_the_joints(torque):
    with pytest.raises(ValueError, match=r"safety.external_torque: needs 1 entry"):
        TouchLimits.of(SafetyConfig(external_torque=torque), 2, None)


def test_an_impact_counts_at_once_and_a_press_once_it_lasts():
    touch, q = limits("hand"), np.zeros(2)
    assert touch.fault(q, np.array([101.0, 0.0]), math.inf, 0.0)[0] is StopReason.FORCE
    reason, since = touch.fault(q, np.array([50.0, 0.0]), math.inf, 1.0)
    assert (reason, since) == (StopReason.NONE, 1.0)
    assert touch.fault(q, np.array([50.0, 0.0]), since, 1.4)[0] is StopReason.NONE
    assert touch.fault(q, np.array([50.0, 0.0]), since, 1.6)[0] is StopReason.FORCE
    assert touch.fault(q, np.array([30.0, 0.0]), since, 1.6) == (
        StopReason.NONE,
        math.inf,
    )


def test_torques_count_in_both_directions():
    config = SafetyConfig(external_torque=[2.0])
    touch = TouchLimits.of(config, 2, None)
    for torque, reason in (
        ([1.9, -1.9], StopReason.NONE),
        ([0.0, -2.1], StopReason.EXTERNAL_TORQUE),
        ([np.nan, 0.0], StopReason.MEASURED_NOT_FINITE),
    ):
        assert touch.fault(np.zeros(2), np.array(torque), math.inf, 0.0)[0] is reason
