import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.hardware.config import HardwareConfig
from drake_srg.hardware.link import STAMP
from drake_srg.hardware.opening import Hardware
from drake_srg.hardware.run import check_servo
from drake_srg.scenario import load_scenario

SERVOED = load_scenario("kitchen_servoing")


@pytest.mark.parametrize(
    ("release", "start", "message"),
    [
        (5.0, {STAMP: np.zeros(1)}, "release: must be 0 with servoing"),
        (0.0, {}, "servoing: needs an arm whose states have time stamps"),
    ],
)
def test_what_a_visual_servo_cannot_do_is_refused(release, start, message):
    hardware = Hardware([], {}, start)
    with pytest.raises(ScenarioError, match=message):
        check_servo(SERVOED, HardwareConfig(release=release), hardware)


def test_any_release_will_do_without_a_visual_servo():
    config = HardwareConfig(release=5.0)
    check_servo(load_scenario("kitchen"), config, Hardware([], {}, {}))
