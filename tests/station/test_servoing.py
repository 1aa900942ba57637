"""The planner with a visual servo: its goal, its camera, and what it refuses."""

import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import load_scenario
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.station.servoing import CameraMount, MakeServoingPlanner


def load(*overrides):
    return load_scenario("kitchen_servoing", overrides=overrides)


def test_the_camera_is_believed_where_its_errors_say():
    error = [0.01, -0.02, 0.005]
    scenario = load(f"camera_errors={{hand: {{translation: {error}}}}}")
    mount = CameraMount.of(scenario, MakeModelsPlant(scenario))
    X_CE = mount.X_GC.inverse() @ mount.X_GC_believed
    np.testing.assert_allclose(X_CE.translation(), error, atol=1e-12)
    np.testing.assert_allclose(mount.X_GC.translation(), [0.0, 0.0, 0.085], atol=1e-9)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (
            ["cameras.hand.X_PB.base_frame=world"],
            "base_frame: must be fixed to the hand",
        ),
        (["planner.approaches=[above, side]"], "planner: needs one way to grasp"),
        (
            [
                "planner.servo.method=ibvs",
                "cameras.hand.X_PB.rotation=!Rpy {deg: [0, 0, 0]}",
            ],
            "hand does not see all of soup_can",
        ),
    ],
)
def test_what_does_not_fit_is_refused(overrides, message):
    with pytest.raises(ScenarioError, match=message):
        MakeServoingPlanner(load(*overrides))
