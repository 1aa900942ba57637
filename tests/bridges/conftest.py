"""What the tests of bridges need that no Python package has."""

import contextlib

import pytest
from helpers import needs_debian

from bridges.ros1 import ros1_peers
from bridges.ros1.ros1_peers import wait_until
from bridges.ros1.ros1_programs import Roscore
from drake_srg.bridges.commands import CommandInbox, Warnings
from drake_srg.bridges.ros1 import node as ros1_node
from drake_srg.bridges.ros1 import subscription as ros1_subscription
from drake_srg.bridges.ros1.bridge import Ros1Bridge


def pytest_configure(config):
    config.addinivalue_line(
        "markers", "ros: needs Debian packages, see tools/install_test_peers.sh"
    )


def new_roscore(folder):
    needs_debian("roscore", "/usr/lib/python3/dist-packages/rospy/__init__.py")
    return contextlib.closing(Roscore(folder))


@pytest.fixture(scope="session")
def roscore(tmp_path_factory):
    """A real roscore, the same for all tests."""
    with new_roscore(tmp_path_factory.mktemp("ros")) as roscore:
        roscore.start()
        yield roscore


@pytest.fixture
def roscore_of_its_own(tmp_path):
    """A real roscore that does not run yet."""
    with new_roscore(tmp_path) as roscore:
        yield roscore


class Told(list):
    """The warnings that people got."""

    def about(self, word):
        return [text for text in self if word in text]


@pytest.fixture
def told():
    return Told()


@pytest.fixture
def inbox(told):
    return CommandInbox(ros1_peers.COMMANDS, Warnings(told.append))


@pytest.fixture
def impatient(monkeypatch):
    """ROS 1 nodes try again soon, so that tests need not wait."""
    monkeypatch.setattr(ros1_node, "_POLL_PERIOD", 0.05)
    monkeypatch.setattr(ros1_subscription, "_RETRY", 0.05)
    monkeypatch.setattr(ros1_subscription, "_RETRY_MAX", 0.1)


@pytest.fixture
def ros1_master():
    with contextlib.closing(ros1_peers.Master()) as master:
        yield master


@pytest.fixture
def ros1_bridge(inbox, ros1_master, impatient):
    """Registered, with the topics of `ros1_peers`."""
    bridge = Ros1Bridge(inbox, ros1_peers.TOPICS, master=ros1_master.uri)
    with contextlib.closing(bridge):
        assert wait_until(lambda: "waiting" not in bridge.status)
        yield bridge


@pytest.fixture
def ros1_publisher():
    with contextlib.closing(ros1_peers.Publisher()) as publisher:
        yield publisher
