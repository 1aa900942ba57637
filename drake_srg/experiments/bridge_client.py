"""A served station in a process of its own, and a client that times it."""

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

from drake_srg.bridges.bridge import Bridge
from drake_srg.bridges.commands import CommandInbox, CommandTopic, PortValues, Warnings
from drake_srg.common.exceptions import ScenarioError
from drake_srg.recording.ros_topics import MakeMessage, Topic, float64_array
from drake_srg.types import Vector

_PATIENCE = 60.0  # for something to begin or to end, then it is broken [s]

# Makes the client's side of a wire: what it hears comes into the inbox, what it says
# are the topics.
MakeBridge = Callable[[CommandInbox, Sequence[Topic]], Bridge]


WIRES = ("ROS 1", "ROS 2")


@dc.dataclass(frozen=True)
class MeetingPlace:
    """Where a station and a client meet each other, and nobody else.

    Attributes:
        arguments: Of `drake-srg serve`.
        make_station, make_client: Make their sides, one a process.
    """

    arguments: Sequence[str]
    make_station: MakeBridge
    make_client: MakeBridge


@dc.dataclass(frozen=True)
class Served:
    """What a served station says at its end, and what the clock on the wall says."""

    sim_time: float  # s
    wall_time: float  # by the station's own clock [s]
    seen_time: float  # from its first words to the request to end [s]
    commands: int
    warnings: str  # what it wrote on standard error


def wait_for(connected: Callable[[], bool]) -> None:
    """Wait until client and station know each other.

    Raises:
        ScenarioError: If they do not within a minute.
    """
    end = wall.monotonic() + _PATIENCE
    while not connected():
        if wall.monotonic() > end:
            raise ScenarioError("client and station do not connect")
        wall.sleep(0.05)


class ServedProcess:
    """`drake-srg serve` with arguments, in a process of its own.

    Raises:
        ScenarioError: If it does not begin to serve; the message is its own.
    """

    def __init__(self, *arguments: str):
        self._errors = tempfile.TemporaryFile("w+")  # noqa: SIM115 (it stays open)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "drake_srg", "serve", *arguments],
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
        )
        assert self._process.stdout is not None
        if not self._process.stdout.readline():
            self._process.wait()
            raise ScenarioError(f"serve {' '.join(arguments)}: {self._said()}")
        self._start = wall.monotonic()

    def stop(self) -> Served:
        """End it as somebody would who asks it politely."""
        seen_time = wall.monotonic() - self._start
        self._process.terminate()
        output, _ = self._process.communicate(timeout=_PATIENCE)
        found = re.search(r"served ([\d.]+) s in ([\d.]+) s, (\d+) commands", output)
        if not found:
            raise ScenarioError(f"serve: {self._said()}")
        sim_time, wall_time, commands = found.groups()
        return Served(
            float(sim_time), float(wall_time), seen_time, int(commands), self._said()
        )

    def _said(self) -> str:
        self._errors.seek(0)
        return self._errors.read().strip()


@contextlib.contextmanager
def ros1_master() -> Iterator[str]:
    """Run a roscore on a free port; gives its URI.

    Raises:
        ScenarioError: If this machine has none.
    """
    if shutil.which("roscore") is None:
        raise ScenarioError(
            "bridge_load: needs a roscore: sudo apt-get install -y ros-core"
        )
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
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
def meeting_place(wire: str) -> Iterator[MeetingPlace]:
    """Return where to meet on one of `WIRES`; goes with the context.

    Raises:
        ScenarioError: If this machine has no roscore.
        ImportError: If a package is missing.
    """
    if wire == "ROS 1":
        from drake_srg.bridges.ros1.bridge import Ros1Bridge

        with ros1_master() as uri:
            yield MeetingPlace(
                ("--ros1", "--master", uri),
                functools.partial(Ros1Bridge, master=uri),
                functools.partial(Ros1Bridge, master=uri, name="/client"),
            )
    else:
        from drake_srg.bridges.ros2.bridge import Ros2Bridge

        domain = os.getpid() % 233
        make = functools.partial(Ros2Bridge, domain=domain)
        yield MeetingPlace(("--ros2", "--domain", str(domain)), make, make)


class Client:
    """Commands a served kitchen, and hears what it is commanded to do.

    Attributes:
        arm: What /arm/position_commanded said: (real time [s], positions), newest last.
        closure: The same of /gripper/closure_commanded.
    """

    def __init__(self, make_bridge: MakeBridge):
        self.arm: list[tuple[float, Vector]] = []
        self.closure: list[tuple[float, Vector]] = []
        array = "std_msgs/msg/Float64MultiArray"
        self._topics = {
            "/grasp": _number("/grasp", "std_msgs/msg/Int32", int),
            "/startgrasp": _number("/startgrasp", "std_msgs/msg/Bool", bool),
            "/position_grasp": float64_array("/position_grasp", "", 4),
            "/kuka": float64_array("/kuka", "", 7),
        }
        heard = [
            CommandTopic("/arm/position_commanded", array, _into(self.arm)),
            CommandTopic(
                "/gripper/closure_commanded",
                "std_msgs/msg/Float64",
                _into(self.closure),
            ),
        ]
        inbox = CommandInbox(heard, Warnings(lambda text: None))
        self._bridge = make_bridge(inbox, list(self._topics.values()))
        try:
            wait_for(lambda: bool(self.arm and self.closure) and self._is_heard())
        except ScenarioError:
            self.close()
            raise

    def send(self, values: Mapping[str, Any]) -> None:
        """Publish on topics, by their names."""
        for name, value in values.items():
            self._bridge.publish(self._topics[name], 0.0, [value])

    def close(self) -> None:
        """Say goodbye."""
        self._bridge.close()

    def _is_heard(self) -> bool:
        return all(self._bridge.has_subscribers(name) for name in self._topics)


@contextlib.contextmanager
def watcher(make_bridge: MakeBridge, topic: str, type: str) -> Iterator[None]:
    """Let a process of its own listen to a topic."""
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
    heard = CommandTopic(topic, type, lambda data: {})
    bridge = make_bridge(CommandInbox([heard], Warnings(lambda text: None)), [])
    with contextlib.closing(bridge):
        threading.Event().wait()  # until it is terminated


def _number(name: str, type: str, convert: Callable[[Any], Any]) -> Topic:
    def message(make: MakeMessage, time: float, value: Any) -> Any:
        return make(type, data=convert(value))

    return Topic(name, type, {}, message)


def _into(heard: list[tuple[float, Vector]]) -> Callable[[Any], PortValues]:
    def convert(data: Any) -> PortValues:
        heard.append((wall.monotonic(), np.atleast_1d(data).copy()))
        return {}

    return convert
