"""A ROS node without a network: messages are delivered by a call."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

from rosbags.typesys import Stores, get_typestore

from drake_srg.recording.rosbag import Topic
from drake_srg.robot.drive.config import HardwareConfig
from drake_srg.robot.drive.link import Robot
from drake_srg.robot.drive.opening import MakeRobot
from drake_srg.robot.serve.action_server import with_actions
from drake_srg.robot.serve.bridge import Bridge
from drake_srg.robot.serve.commands import CommandError, Warnings
from drake_srg.scenario import Scenario

_STORE = with_actions(get_typestore(Stores.ROS2_HUMBLE))


def make_message(kind: str, *values: Any, **fields: Any) -> Any:
    """Return a ROS 2 message; see `MakeMessage`."""
    return _STORE.types[kind](*values, **fields)


class DirectNode:
    """Stands in for `hardware.link.Node`; keeps what was `sent`, and `told`."""

    def __init__(self) -> None:
        self.sent: list[tuple[Topic, Any]] = []
        self.told: list[str] = []
        self._receivers: dict[str, list[Callable[[Any], None]]] = {}

    def subscribe(
        self, topic: str, type: str, receive: Callable[[Any], None], largest: int = 0
    ) -> None:
        self._receivers.setdefault(topic, []).append(receive)

    def hears(self, topic: str) -> bool:
        """Return whether anybody has subscribed to a topic."""
        return topic in self._receivers

    def publish(self, topic: Topic) -> None:
        pass

    def has_subscribers(self, topic: str) -> bool:
        return True

    def send(self, topic: Topic, time: float, *values: Any) -> None:
        self.sent.append((topic, topic.convert(make_message, time, *values)))

    def deliver(self, topic: str, message: Any) -> list[str]:
        """Deliver a message to those who have subscribed; return the refusals."""
        refused = []
        for receive in self._receivers.get(topic, ()):
            try:
                receive(message)
            except CommandError as error:
                refused.append(str(error))
        return refused

    def robot(self, scenario: Scenario) -> Robot:
        """Return the robot of a scenario, whose drivers use this node."""
        warnings = Warnings(self.told.append)
        nodes: Any = SimpleNamespace(of=lambda version: self)
        return dc.replace(MakeRobot(scenario, HardwareConfig(), warnings), nodes=nodes)


class DirectBridge(Bridge):
    """Carries a station's messages to a node in the same process."""

    def __init__(self, node: DirectNode) -> None:
        self._node = node

    def has_subscribers(self, topic: str) -> bool:
        return self._node.hears(topic)

    def publish(self, topic: Topic, time: float, values: Sequence[Any]) -> None:
        message = topic.convert(make_message, time, *values)
        self._node.told += self._node.deliver(topic.name, message)
