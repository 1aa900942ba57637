import socket

import pytest
from helpers import NEEDS_DDS

from bridges.ros2.peers import free_domain
from drake_srg.bridges.commands import CommandInbox, Warnings
from drake_srg.bridges.connecting import BridgeOptions
from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import load_scenario

KITCHEN = load_scenario("kitchen")
TENDON = load_scenario("kitchen_tendon")
# No roscore listens there.
MASTER = "http://127.0.0.1:9"


def connect(scenario=KITCHEN, **options):
    inbox = CommandInbox([], Warnings(lambda text: None))
    return BridgeOptions(**options).connect(scenario, inbox, [])


@NEEDS_DDS
def test_the_bridges_are_those_that_the_options_name():
    assert connect() == []
    domain = free_domain()
    bridges = connect(
        TENDON, ros1=True, master=MASTER, ros2=True, domain=domain, servo="tcp:0"
    )
    for bridge in bridges:
        bridge.close()
    ros1, ros2, servo = bridges
    assert ros1.status == "ROS 1 shut down"
    assert ros2.status == f"ROS 2 in domain {domain}"
    assert servo.status == f"servo at tcp:{servo.address}"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"name": "my node"}, "serve: --name: must be a letter, .*, got 'my node'"),
        ({"servo": "tcp:0"}, "serve: --servo: needs a gripper with a wire motor"),
        ({"protocol": 2}, "serve: --protocol: needs --servo"),
        (
            {"scenario": TENDON, "servo": "tcp:0", "protocol": 0},
            "serve: protocol: must be 1 or 2, got 0",
        ),
        ({"ros1": True, "master": "roscore"}, "serve: ROS 1 master: must be"),
        pytest.param(
            {"ros2": True, "domain": 233},
            "serve: ROS 2 domain: must be 0 to 232",
            marks=NEEDS_DDS,
        ),
    ],
)
def test_invalid_options_are_scenario_errors(options, words):
    with pytest.raises(ScenarioError, match=words):
        connect(**options)


@NEEDS_DDS
def test_a_bridge_that_cannot_be_made_closes_the_others(monkeypatch):
    domain = free_domain()
    with socket.create_server(("127.0.0.1", 0)) as server:
        taken = f"tcp:{server.getsockname()[1]}"
        with pytest.raises(OSError, match="in use"):
            connect(TENDON, ros2=True, domain=domain, servo=taken)
    (bridge,) = connect(ros2=True, domain=domain)  # the domain is free again
    bridge.close()
