import io
import os
import socket
import subprocess
import sys
import termios
from pathlib import Path

import pytest
from helpers import NEEDS_DDS, needs_pty

from drake_srg.common.exceptions import ScenarioError
from drake_srg.robot.serve.commands import CommandInbox, Warnings, safety_topics
from drake_srg.robot.serve.connecting import BridgeOptions, KeyboardBridge, own_terminal
from drake_srg.scenario import Scenario, load_scenario
from robot.serve.ros2.peers import free_domain
from robot.serve.waiting import wait_until

# A session whose only other process uses the keys and then goes to the background.
IN_THE_BACKGROUND = """
import os, pty, sys
from drake_srg.robot.serve.commands import CommandInbox, Warnings
from drake_srg.robot.serve.connecting import KeyboardBridge

session, keyboard = pty.fork()
if session:
    sys.exit(os.waitstatus_to_exitcode(os.waitpid(session, 0)[1]))
process = os.fork()
if process == 0:
    bridge = KeyboardBridge(CommandInbox([], Warnings(print)), 0)
    os.setpgid(0, 0)
    bridge.close()
    os._exit(0)
status = os.waitpid(process, os.WUNTRACED)[1]
os._exit(1 if os.WIFSTOPPED(status) else os.waitstatus_to_exitcode(status))
"""


@pytest.fixture
def terminal():
    needs_pty()
    keyboard, terminal = os.openpty()
    yield keyboard, terminal
    os.close(keyboard)
    os.close(terminal)


@pytest.fixture
def inbox():
    return CommandInbox(safety_topics(["safety.estop"]), Warnings(print))


def test_keys_stop_and_release(terminal, inbox):
    bridge = KeyboardBridge(inbox, terminal[1])
    os.write(terminal[0], b"xe")
    wait_until(lambda: inbox.received == 1)
    assert inbox.take() == {"safety.estop": [1.0]}
    os.write(terminal[0], b"r")
    wait_until(lambda: inbox.received == 3)
    assert inbox.take() == {"safety.estop": [0.0], "safety.release": [1.0]}
    bridge.close()


def test_the_terminal_is_given_back(terminal, inbox):
    before = termios.tcgetattr(terminal[1])
    bridge = KeyboardBridge(inbox, terminal[1])
    assert termios.tcgetattr(terminal[1]) != before
    assert bridge.closed  # it keeps no station alive
    bridge.close()
    bridge.close()
    assert termios.tcgetattr(terminal[1]) == before


def test_the_terminal_is_given_back_from_the_background():
    needs_pty()
    command = [sys.executable, "-c", IN_THE_BACKGROUND]
    subprocess.run(command, check=True, timeout=60)


@pytest.mark.parametrize(("topics", "count"), [(["safety.estop"], 1), ([], 0)])
def test_keys_are_for_stations_with_a_monitor(terminal, topics, count):
    inbox = CommandInbox(safety_topics(topics), Warnings(print))
    options = BridgeOptions(terminal=terminal[1])
    bridges = options.connect(Scenario(), inbox, [])
    assert len(bridges) == count
    for bridge in bridges:
        bridge.close()


def test_only_a_terminal_in_the_foreground_has_keys(terminal):
    assert own_terminal(io.StringIO()) is None
    with Path(os.devnull).open() as nothing:
        assert own_terminal(nothing) is None
    # A terminal, but not this process's.
    with os.fdopen(os.dup(terminal[1])) as other:
        assert own_terminal(other) is None


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
            "serve: Ros2Config.domain: must be at most 232, got 233",
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
