"""Fixtures of the bridges' tests."""

import contextlib
import socket
import threading
from types import SimpleNamespace

import pytest
from helpers import needs_debian

from robot.serve.ros1.programs import Roscore


def pytest_configure(config):
    config.addinivalue_line(
        "markers", "ros: needs Debian packages, see tools/install_test_peers.sh"
    )


def new_roscore(folder):
    needs_debian("roscore", "/usr/lib/python3/dist-packages/rospy/__init__.py")
    return contextlib.closing(Roscore(folder))


@pytest.fixture(scope="session")
def roscore(tmp_path_factory):
    """A real roscore, shared by all tests."""
    with new_roscore(tmp_path_factory.mktemp("ros")) as roscore:
        roscore.start()
        yield roscore


@pytest.fixture
def own_roscore(tmp_path):
    """A real roscore for one test, not started yet."""
    with new_roscore(tmp_path) as roscore:
        yield roscore


class Told(list):
    """The warnings shown to the user."""

    def about(self, word):
        return [text for text in self if word in text]


@pytest.fixture
def told():
    return Told()


@pytest.fixture
def hanging_names(monkeypatch):
    """Lookups of hosts "robot..." hang until the end of the test.

    `pending` lists the hosts whose lookups hang.
    """
    released, pending = threading.Event(), []
    real = socket.getaddrinfo

    def getaddrinfo(host, *arguments, **options):
        if str(host).startswith("robot"):
            pending.append(host)
            released.wait(20.0)
            pending.remove(host)
            raise socket.gaierror(-3, "Temporary failure in name resolution")
        return real(host, *arguments, **options)

    monkeypatch.setattr(socket, "getaddrinfo", getaddrinfo)
    yield SimpleNamespace(pending=pending)
    released.set()
