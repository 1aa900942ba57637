"""Checks of a scenario's visual servo."""

import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import load_scenario


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (
            ["servoing.camera=belly"],
            r"servoing\.camera: unknown camera 'belly' \(allowed",
        ),
        (["servoing.method=guess"], r"servoing\.method"),
        (
            ["servoing.camera_period=0.0146484375"],
            r"servoing\.camera_period: must be a multiple of servoing\.period",
        ),
        (["servoing.period=0.01"], r"servoing\.period: must be a multiple of 1/1024 s"),
        (
            ["script=[{mode: lift, duration: 1}]"],
            "servoing: must be null with script",
        ),
    ],
)
def test_mistakes_are_named(overrides, message):
    with pytest.raises(ScenarioError, match=message):
        load_scenario("kitchen_servoing", overrides=overrides)


def test_servoing_can_be_switched_off():
    assert (
        load_scenario("kitchen_servoing", overrides=["servoing=null"]).servoing is None
    )
