"""Fixtures of the ROS 1 tests: a bridge, and peers made of plain sockets."""

import contextlib

import pytest

from drake_srg.robot.serve.commands import CommandInbox, Warnings
from drake_srg.robot.serve.ros1 import bridge as bridge_module
from drake_srg.robot.serve.ros1 import tcpros
from drake_srg.robot.serve.ros1.bridge import Ros1Bridge
from robot.serve.ros1 import peers
from robot.serve.ros1.peers import wait_until


@pytest.fixture
def inbox(told):
    return CommandInbox(peers.COMMANDS, Warnings(told.append))


@pytest.fixture
def master():
    with contextlib.closing(peers.Master()) as master:
        yield master


@pytest.fixture
def publisher():
    with contextlib.closing(peers.Publisher()) as publisher:
        yield publisher


@pytest.fixture
def new_bridge(inbox, monkeypatch):
    """A function that returns a new bridge; closes it at the end of the test.

    Waits between attempts are short, so that tests are quick.
    """
    monkeypatch.setattr(bridge_module, "_POLL", 0.05)
    monkeypatch.setattr(tcpros, "_RETRY", 0.05)
    monkeypatch.setattr(tcpros, "_LONGEST_RETRY", 0.1)
    with contextlib.ExitStack() as stack:

        def new_bridge(topics=peers.TOPICS, **options):
            bridge = Ros1Bridge(inbox, topics, **options)
            return stack.enter_context(contextlib.closing(bridge))

        yield new_bridge


@pytest.fixture
def bridge(new_bridge, master):
    """A registered bridge with the topics of `peers`."""
    bridge = new_bridge(master=master.uri)
    assert wait_until(lambda: "waiting" not in bridge.status)
    return bridge
