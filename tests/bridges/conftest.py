"""What the tests of bridges need that no Python package has."""

import contextlib
import os
import shutil
import socket
import subprocess
import time
import xmlrpc.client
from pathlib import Path

import pytest


def pytest_configure(config):
    config.addinivalue_line(
        "markers", "ros: needs Debian packages, see tools/install_test_peers.sh"
    )


def needs_debian(*programs):
    """Skip where a program, or a file of an absolute path, is missing.

    With DRAKE_SRG_REQUIRE_ROS in the environment the test fails instead.
    """
    missing = [p for p in programs if not (shutil.which(p) or Path(p).is_file())]
    if missing:
        message = f"{', '.join(missing)} missing: sh tools/install_test_peers.sh"
        if "DRAKE_SRG_REQUIRE_ROS" in os.environ:
            pytest.fail(message)
        pytest.skip(message)


def wait_until(condition, timeout=5.0):
    """Wait until `condition()` is true; return what it last was."""
    end = time.monotonic() + timeout
    while not (value := condition()) and time.monotonic() < end:
        time.sleep(0.01)
    return value


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


class RosMaster:
    """The real one of ROS 1, with its node rosout, on a port of its own."""

    def __init__(self, log):
        self.uri = f"http://127.0.0.1:{free_port()}"
        # Its log files and parameters of the machine's user are none of the tests'.
        self.environment = {
            **os.environ,
            "ROS_MASTER_URI": self.uri,
            "ROS_IP": "127.0.0.1",
            "ROS_HOME": str(log),
            "PYTHONUNBUFFERED": "1",
        }
        self._process = None

    def start(self, *command):
        port = self.uri.rpartition(":")[2]
        self._process = subprocess.Popen(
            [*(command or ["roscore"]), "-p", port],
            env=self.environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        assert wait_until(self.answers, 20.0)

    def answers(self):
        with contextlib.suppress(OSError, xmlrpc.client.Error):
            return xmlrpc.client.ServerProxy(self.uri).getPid("/test")[0] == 1
        return False

    def kill(self):
        if self._process is not None:
            self._process.terminate()
            self._process.wait(20.0)

    def run(self, *command, timeout=20.0):
        """Run a program of ROS; return what it printed."""
        done = subprocess.run(
            command,
            env=self.environment,
            timeout=timeout,
            check=False,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        return done.stdout


@pytest.fixture(scope="session")
def roscore(tmp_path_factory):
    """A real roscore, the same for all tests."""
    needs_debian("roscore", "/usr/lib/python3/dist-packages/rospy/__init__.py")
    master = RosMaster(tmp_path_factory.mktemp("ros"))
    try:
        master.start()
        yield master
    finally:
        master.kill()
