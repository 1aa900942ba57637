import numpy as np
import pytest

from drake_srg.safety.config import SafetyConfig, WorkspaceConfig
from drake_srg.safety.limits import JointLimits, ToolLimits
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
