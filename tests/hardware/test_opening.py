import pytest

from drake_srg.bridges.commands import Warnings
from drake_srg.common.exceptions import ScenarioError
from drake_srg.hardware.cameras import Ros2Camera
from drake_srg.hardware.config import HardwareConfig
from drake_srg.hardware.link import HardwareDriver
from drake_srg.hardware.nodes import Nodes
from drake_srg.hardware.opening import open_cameras, open_hardware
from drake_srg.scenario import load_scenario
from hardware.stand import FakeArm, FakeGripper


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


def test_links_close_while_their_node_can_still_send(monkeypatch):
    closed = []
    monkeypatch.setattr(Nodes, "close", lambda nodes: closed.append("nodes"))

    class Driver(HardwareDriver):
        def __init__(self, link):
            self._link = link
            link.close = lambda: closed.append("link")

        def connect(self, robot):
            return self._link

    config = HardwareConfig(arm=Driver(FakeArm()), gripper=Driver(FakeGripper()))
    with open_hardware(load_scenario("kitchen"), config, Warnings(print)):
        assert closed == []
    assert closed == ["link", "link", "nodes"]
