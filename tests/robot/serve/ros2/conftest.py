"""Fixtures of the ROS 2 tests: a bridge in a domain of its own, and a peer."""

import contextlib

import pytest
from helpers import LACKS_DDS, NO_DDS

from drake_srg.robot.serve.commands import CommandInbox, Warnings
from robot.serve.ros2.peers import CyclonePeer, command_topics, free_domain


class DdsModule(pytest.Module):
    """Tests of a module that needs cyclonedds."""

    def collect(self):
        if LACKS_DDS:
            pytest.skip(NO_DDS, allow_module_level=True)
        return super().collect()


def pytest_pycollect_makemodule(module_path, parent):
    return DdsModule.from_parent(parent, path=module_path)


@pytest.fixture
def inbox(told):
    return CommandInbox(command_topics(), Warnings(told.append))


@pytest.fixture
def topics():
    """Topics that the bridge publishes; test modules override it."""
    return []


@pytest.fixture
def bridge(inbox, topics, monkeypatch):
    from drake_srg.robot.serve.ros2.bridge import Ros2Bridge

    monkeypatch.delenv("CYCLONEDDS_URI", raising=False)
    bridge = Ros2Bridge(inbox, topics, domain=free_domain())
    with contextlib.closing(bridge):
        yield bridge


@pytest.fixture
def peer(bridge):
    with contextlib.closing(CyclonePeer(bridge.domain)) as peer:
        yield peer
