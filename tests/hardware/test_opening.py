import pytest

from drake_srg.bridges.commands import Warnings
from drake_srg.common.exceptions import ScenarioError
from drake_srg.hardware.cameras import Ros2Camera
from drake_srg.hardware.config import HardwareConfig
from drake_srg.hardware.opening import open_cameras
from drake_srg.scenario import load_scenario


@pytest.mark.parametrize(
    ("cameras", "message"),
    [
        ({}, "cameras.ceiling: missing, but the localizer needs it"),
        ({"ceiling": Ros2Camera()}, "cameras.hand: missing, but the visual servo"),
    ],
)
def test_a_camera_that_is_missing_is_told_with_who_needs_it(cameras, message):
    config = HardwareConfig(cameras=cameras)
    scenario = load_scenario("kitchen_servoing")
    with (
        pytest.raises(ScenarioError, match=message),
        open_cameras(scenario, config, Warnings(print)),
    ):
        pass
