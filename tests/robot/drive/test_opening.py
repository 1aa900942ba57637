from types import SimpleNamespace

import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.safety_states import SafetyState
from drake_srg.robot.drive.cameras import Ros1Camera, Ros2Camera
from drake_srg.robot.drive.config import HardwareConfig
from drake_srg.robot.drive.link import HardwareDriver, Nodes
from drake_srg.robot.drive.opening import open_cameras, open_hardware
from drake_srg.robot.serve.commands import CommandInbox, Warnings, safety_topics
from drake_srg.scenario import load_scenario
from robot.drive.stand import (
    HOME,
    MOVING,
    FakeArm,
    FakeGripper,
    FakeNode,
    Stand,
    motion_to,
)

COMMANDS = ("estop", "release")


@pytest.mark.parametrize(
    ("name", "cameras", "message"),
    [
        ("kitchen", {}, "cameras.ceiling: missing, but the localizer needs it"),
        ("kitchen_servoing", {"ceiling": Ros2Camera()}, "cameras.hand: missing, but t"),
        (
            "clear_table",
            {"ceiling": Ros2Camera()},
            r"bin: .*\(task.place.cameras\)",
        ),
    ],
)
def test_a_camera_that_is_missing_is_told_with_who_needs_it(name, cameras, message):
    config = HardwareConfig(cameras=cameras)
    scenario = load_scenario(name)
    with (
        pytest.raises(ScenarioError, match=message),
        open_cameras(scenario, config, Warnings(print)),
    ):
        pass


class Driver(HardwareDriver):
    """A driver of a link that is already there."""

    def __init__(self, link):
        self._link = link

    def connect(self, robot):
        return self._link


@pytest.mark.parametrize("version", [1, 2])
def test_any_part_that_speaks_ros_brings_the_topics_that_stop_the_arm(
    monkeypatch, version
):
    nodes = {1: FakeNode(), 2: FakeNode()}
    monkeypatch.setattr(Nodes, "of", lambda _, version: nodes[version])
    monkeypatch.setattr(Nodes, "open", lambda _: None)
    camera = {1: Ros1Camera(), 2: Ros2Camera()}[version]
    config = HardwareConfig(
        arm=Driver(FakeArm()),
        gripper=Driver(FakeGripper()),
        cameras={"ceiling": camera},
    )
    warnings = Warnings(print)
    inbox = CommandInbox(safety_topics(["safety.estop"], COMMANDS), warnings)
    scenario = load_scenario("kitchen")
    with open_hardware(scenario, config, warnings, inbox=inbox):
        for topic, data in (("/estop", True), ("/speed_override", 40)):
            nodes[version].deliver(topic, SimpleNamespace(data=data))
            nodes[3 - version].deliver(topic, SimpleNamespace(data=False))
    taken = inbox.take()
    assert taken["safety.estop"] == [1.0]
    assert taken["safety.speed_override"] == pytest.approx([0.4])
    stand = Stand()
    stand.planner.say(MOVING, motion_to(HOME + 0.5), time=0.0)
    assert stand.run(1.0)
    assert not all(stand.loop.advance(taken) for _ in range(200))
    assert stand.loop.safety[0] is SafetyState.EMERGENCY_STOP


def test_links_close_while_their_node_can_still_send(monkeypatch):
    closed = []
    monkeypatch.setattr(Nodes, "close", lambda nodes: closed.append("nodes"))

    arm, gripper = FakeArm(), FakeGripper()
    arm.close = gripper.close = lambda: closed.append("link")
    config = HardwareConfig(arm=Driver(arm), gripper=Driver(gripper))
    with open_hardware(load_scenario("kitchen"), config, Warnings(print)):
        assert closed == []
    assert closed == ["link", "link", "nodes"]
