"""A served station in a separate process, and a client that commands and times it."""

from __future__ import annotations

import contextlib
import functools
import multiprocessing as mp
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time as wall
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from drake_srg.common.exceptions import ScenarioError
from drake_srg.recording.rosbag import MakeMessage, Topic, float64_array
from drake_srg.robot.serve import commands
from drake_srg.robot.serve.bridge import Bridge
from drake_srg.types import Vector

_PATIENCE = 60.0  # how long to wait for a start or an end [s]
WIRES = ("ROS 1", "ROS 2")

# Makes one side of a wire: it receives into the inbox and publishes the topics.
MakeBridge = Callable[[commands.CommandInbox, Sequence[Topic]], Bridge]


class Wire(NamedTuple):
    """An open wire between one station and one client, at most one each per process.

    `arguments` are those of `drake-srg serve` for the station's side.
    """

    arguments: Sequence[str]
    make_station: MakeBridge
    make_client: MakeBridge


class Served(NamedTuple):
    """A served station's simulated and real time [s], and the messages it received.

    `wall_time` is by the station's clock; `seen_time` by ours, from its first output.
    """

    sim_time: float
    wall_time: float
    commands: int
    seen_time: float


def silent_inbox(*topics: commands.CommandTopic) -> commands.CommandInbox:
    return commands.CommandInbox(topics, commands.Warnings(lambda text: None))


def wait_for(connected: Callable[[], bool]) -> None:
    """Wait until client and station are connected, for a minute at most."""
    end = wall.monotonic() + _PATIENCE
    while not connected():
        if wall.monotonic() > end:
            raise ScenarioError("client and station failed to connect")
        wall.sleep(0.05)


class ServedProcess:
    """A process that runs `drake-srg serve` with some arguments.

    Raises:
        ScenarioError: If it does not start to serve; the message is the process's.
    """

    def __init__(self, *arguments: str):
        self._errors = tempfile.TemporaryFile("w+")  # noqa: SIM115 (stays open)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "drake_srg", "serve", *arguments],
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
        )
        assert self._process.stdout is not None
        if not self._process.stdout.readline():
            self._process.wait()
            raise ScenarioError(f"serve {' '.join(arguments)}: {self._read_errors()}")
        self._start = wall.monotonic()

    def stop(self) -> Served:
        """Stop the process by SIGTERM and return its report."""
        seen_time = wall.monotonic() - self._start
        self._process.terminate()
        output, _ = self._process.communicate(timeout=_PATIENCE)
        found = re.search(r"served ([\d.]+) s in ([\d.]+) s, (\d+) commands", output)
        if not found:
            raise ScenarioError(f"serve: {self._read_errors()}")
        return Served(float(found[1]), float(found[2]), int(found[3]), seen_time)

    def _read_errors(self) -> str:
        self._errors.seek(0)
        return self._errors.read().strip()


def free_port() -> int:
    """Return a free TCP port of this machine."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextlib.contextmanager
def open_wire(wire: str, experiment: str) -> Iterator[Wire]:
    """Open a private wire; ROS 1 gets its own roscore.

    Raises:
        ScenarioError: If the wire is ROS 1 and this machine has no roscore; it names
            the experiment.
        ImportError: If a package is missing.
    """
    if wire == "ROS 2":
        from drake_srg.robot.serve.ros2.bridge import Ros2Bridge

        domain = os.getpid() % 233
        make = functools.partial(Ros2Bridge, domain=domain)
        yield Wire(("--ros2", "--domain", str(domain)), make, make)
        return
    from drake_srg.robot.serve.ros1.bridge import Ros1Bridge

    if shutil.which("roscore") is None:
        needs = "needs a roscore: sudo apt-get install -y ros-core"
        raise ScenarioError(f"{experiment}: {needs}")
    port = free_port()
    uri, quiet = f"http://127.0.0.1:{port}", subprocess.DEVNULL
    core = subprocess.Popen(["roscore", "-p", str(port)], stdout=quiet, stderr=quiet)
    try:
        make_station = functools.partial(Ros1Bridge, master=uri)
        make_client = functools.partial(Ros1Bridge, master=uri, name="/client")
        yield Wire(("--ros1", "--master", uri), make_station, make_client)
    finally:
        core.terminate()
        core.wait()


class Client:
    """Commands a served kitchen, and records the commands to its drivers.

    `arm` and `closure` are messages on /arm/position_commanded and
    /gripper/closure_commanded as (real time [s], positions [rad] or closure).
    """

    def __init__(self, make_bridge: MakeBridge):
        self.arm: list[tuple[float, Vector]] = []
        self.closure: list[tuple[float, Vector]] = []
        topics = (
            _scalar("/grasp", "std_msgs/msg/Int32", int),
            _scalar("/startgrasp", "std_msgs/msg/Bool", bool),
            float64_array("/position_grasp", "", 4),
            float64_array("/kuka", "", 7),
        )
        self._topics = {topic.name: topic for topic in topics}
        inbox = silent_inbox(
            _recorded("/arm/position_commanded", "Float64MultiArray", self.arm),
            _recorded("/gripper/closure_commanded", "Float64", self.closure),
        )
        self._bridge = make_bridge(inbox, topics)
        try:
            wait_for(
                lambda: (
                    bool(self.arm and self.closure)
                    and all(map(self._bridge.has_subscribers, self._topics))
                )
            )
        except ScenarioError:
            self.close()
            raise

    def send(self, values: Mapping[str, Any]) -> None:
        for name, value in values.items():
            self._bridge.publish(self._topics[name], 0.0, [value])

    def close(self) -> None:
        self._bridge.close()


@contextlib.contextmanager
def watch(make_bridge: MakeBridge, topic: str, type: str) -> Iterator[None]:
    """Subscribe to a topic in a separate process, for the duration of the context."""
    process = mp.get_context("spawn").Process(
        target=_watch, args=(make_bridge, topic, type), daemon=True
    )
    process.start()
    try:
        yield
    finally:
        process.terminate()
        process.join()


def _watch(make_bridge: MakeBridge, topic: str, type: str) -> None:
    inbox = silent_inbox(commands.CommandTopic(topic, type, lambda data: {}))
    with contextlib.closing(make_bridge(inbox, [])):
        threading.Event().wait()  # until the process is terminated


def _scalar(name: str, type: str, convert: Callable[[Any], Any]) -> Topic:
    def message(make: MakeMessage, time: float, value: Any) -> Any:
        return make(type, data=convert(value))

    return Topic(name, type, {}, message)


def _recorded(
    name: str, type: str, into: list[tuple[float, Vector]]
) -> commands.CommandTopic:
    def convert(data: Any) -> commands.PortValues:
        into.append((wall.monotonic(), np.atleast_1d(data).copy()))
        return {}

    return commands.CommandTopic(name, f"std_msgs/msg/{type}", convert)
