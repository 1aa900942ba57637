"""A served station in a separate process, and a client that commands and times it."""

from __future__ import annotations

import contextlib
import dataclasses as dc
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
from typing import Any

import numpy as np

from drake_srg.common.exceptions import ScenarioError
from drake_srg.recording.rosbag import MakeMessage, Topic, float64_array
from drake_srg.robot.serve.bridge import Bridge
from drake_srg.robot.serve.commands import (
    CommandInbox,
    CommandTopic,
    PortValues,
    Warnings,
)
from drake_srg.types import Vector

_PATIENCE = 60.0  # how long to wait for a start or an end [s]
WIRES = ("ROS 1", "ROS 2")

# Makes one side of a wire: it receives into the inbox and publishes the topics.
MakeBridge = Callable[[CommandInbox, Sequence[Topic]], Bridge]


@dc.dataclass(frozen=True)
class Wire:
    """An open wire between one station and one client.

    Attributes:
        arguments: Arguments of `drake-srg serve` for the station's side.
        make_station: Makes the station's side; at most one per process.
        make_client: Makes the client's side; at most one per process.
    """

    arguments: Sequence[str]
    make_station: MakeBridge
    make_client: MakeBridge


@dc.dataclass(frozen=True)
class ServeReport:
    """The output of a served station, and the time that it ran.

    Attributes:
        sim_time: Simulated time [s].
        wall_time: Real time by the station's clock [s].
        seen_time: Real time by our clock, from the first output to the request to end
            [s].
        commands: Messages received, good and bad.
        warnings: Standard error.
    """

    sim_time: float
    wall_time: float
    seen_time: float
    commands: int
    warnings: str


def wait_for(connected: Callable[[], bool]) -> None:
    """Wait until client and station are connected.

    Raises:
        ScenarioError: If they do not connect within a minute.
    """
    end = wall.monotonic() + _PATIENCE
    while not connected():
        if wall.monotonic() > end:
            raise ScenarioError("client and station failed to connect")
        wall.sleep(0.05)


class ServedProcess:
    """A process that runs `drake-srg serve`.

    Args:
        arguments: Arguments of the command.

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

    def stop(self) -> ServeReport:
        """Stop the process by SIGTERM and return its report.

        Raises:
            ScenarioError: If it ended without a report.
        """
        seen_time = wall.monotonic() - self._start
        self._process.terminate()
        output, _ = self._process.communicate(timeout=_PATIENCE)
        found = re.search(r"served ([\d.]+) s in ([\d.]+) s, (\d+) commands", output)
        if not found:
            raise ScenarioError(f"serve: {self._read_errors()}")
        sim_time, wall_time, commands = found.groups()
        return ServeReport(
            float(sim_time),
            float(wall_time),
            seen_time,
            int(commands),
            self._read_errors(),
        )

    def _read_errors(self) -> str:
        self._errors.seek(0)
        return self._errors.read().strip()


def free_port() -> int:
    """Return a TCP port of this machine that nobody listens at."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextlib.contextmanager
def run_roscore(experiment: str) -> Iterator[str]:
    """Run a roscore on a free port and yield its URI.

    Args:
        experiment: Name of the experiment that needs it, for the error.

    Raises:
        ScenarioError: If this machine has no roscore.
    """
    if shutil.which("roscore") is None:
        raise ScenarioError(
            f"{experiment}: needs a roscore: sudo apt-get install -y ros-core"
        )
    port = free_port()
    process = subprocess.Popen(
        ["roscore", "-p", str(port)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield f"http://127.0.0.1:{port}"
    finally:
        process.terminate()
        process.wait()


@contextlib.contextmanager
def open_wire(wire: str, experiment: str) -> Iterator[Wire]:
    """Open a wire that nobody else uses, for the duration of the context.

    Args:
        wire: One of `WIRES`.
        experiment: Name of the experiment that needs it, for errors.

    Raises:
        ScenarioError: If the wire is ROS 1 and this machine has no roscore.
        ImportError: If a package is missing.
    """
    if wire == "ROS 1":
        from drake_srg.robot.serve.ros1.bridge import Ros1Bridge

        with run_roscore(experiment) as uri:
            yield Wire(
                ("--ros1", "--master", uri),
                functools.partial(Ros1Bridge, master=uri),
                functools.partial(Ros1Bridge, master=uri, name="/client"),
            )
    else:
        from drake_srg.robot.serve.ros2.bridge import Ros2Bridge

        domain = os.getpid() % 233
        make = functools.partial(Ros2Bridge, domain=domain)
        yield Wire(("--ros2", "--domain", str(domain)), make, make)


class Client:
    """Commands a served kitchen, and records the commands to its drivers.

    Args:
        make_bridge: Makes the client's side of the wire.

    Attributes:
        arm: Messages on /arm/position_commanded as (real time [s], positions [rad]).
        closure: Messages on /gripper/closure_commanded as (real time [s], closure).

    Raises:
        ScenarioError: If the station does not connect within a minute.
    """

    def __init__(self, make_bridge: MakeBridge):
        self.arm: list[tuple[float, Vector]] = []
        self.closure: list[tuple[float, Vector]] = []
        array = "std_msgs/msg/Float64MultiArray"
        self._topics = {
            "/grasp": _scalar("/grasp", "std_msgs/msg/Int32", int),
            "/startgrasp": _scalar("/startgrasp", "std_msgs/msg/Bool", bool),
            "/position_grasp": float64_array("/position_grasp", "", 4),
            "/kuka": float64_array("/kuka", "", 7),
        }
        published = [
            CommandTopic("/arm/position_commanded", array, _append_to(self.arm)),
            CommandTopic(
                "/gripper/closure_commanded",
                "std_msgs/msg/Float64",
                _append_to(self.closure),
            ),
        ]
        inbox = CommandInbox(published, Warnings(lambda text: None))
        self._bridge = make_bridge(inbox, list(self._topics.values()))
        try:
            wait_for(lambda: bool(self.arm and self.closure) and self._is_subscribed())
        except ScenarioError:
            self.close()
            raise

    def send(self, values: Mapping[str, Any]) -> None:
        """Publish values by topic."""
        for name, value in values.items():
            self._bridge.publish(self._topics[name], 0.0, [value])

    def close(self) -> None:
        """Disconnect."""
        self._bridge.close()

    def _is_subscribed(self) -> bool:
        return all(self._bridge.has_subscribers(name) for name in self._topics)


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
    watched = CommandTopic(topic, type, lambda data: {})
    bridge = make_bridge(CommandInbox([watched], Warnings(lambda text: None)), [])
    with contextlib.closing(bridge):
        threading.Event().wait()  # until the process is terminated


def _scalar(name: str, type: str, convert: Callable[[Any], Any]) -> Topic:
    def message(make: MakeMessage, time: float, value: Any) -> Any:
        return make(type, data=convert(value))

    return Topic(name, type, {}, message)


def _append_to(messages: list[tuple[float, Vector]]) -> Callable[[Any], PortValues]:
    def convert(data: Any) -> PortValues:
        messages.append((wall.monotonic(), np.atleast_1d(data).copy()))
        return {}

    return convert
