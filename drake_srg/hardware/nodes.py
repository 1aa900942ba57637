"""The ROS nodes that the drivers of a robot share."""

import dataclasses as dc
from collections.abc import Callable
from typing import Any

from drake_srg.bridges.bridge import Bridge
from drake_srg.bridges.commands import (
    COMMAND_LIMIT,
    CommandInbox,
    CommandTopic,
    PortValues,
    Warnings,
)
from drake_srg.bridges.connecting import Ros1Config, Ros2Config
from drake_srg.common.exceptions import ScenarioError
from drake_srg.recording.ros_topics import Topic

# Takes a message; raises a CommandError if it is refused.
Receive = Callable[[Any], None]


class Node:
    """A ROS node: first collects topics, then opens.

    Args:
        config: Opens it.
        warnings: Where refused messages are reported.
    """

    def __init__(self, config: Ros1Config | Ros2Config, warnings: Warnings) -> None:
        self._config, self._warnings = config, warnings
        self._receivers: dict[str, list[Receive]] = {}
        self._subscribed: dict[str, CommandTopic] = {}
        self._published: list[Topic] = []
        self._bridge: Bridge | None = None

    def subscribe(
        self, topic: str, type: str, receive: Receive, largest: int = COMMAND_LIMIT
    ) -> None:
        """Have messages of a topic received; several may receive the same topic.

        Args:
            topic: Its name.
            type: Its type, such as "sensor_msgs/msg/JointState".
            receive: Called with each message, in a thread of the node.
            largest: Size of the largest message [bytes].
        """
        receivers = self._receivers.setdefault(topic, [])
        receivers.append(receive)

        def convert(message: Any) -> PortValues:
            for each in receivers:
                each(message)
            return {}

        self._subscribed[topic] = CommandTopic(
            topic, type, convert, whole=True, largest=largest
        )

    def publish(self, topic: Topic) -> None:
        """Announce a topic that `send` publishes."""
        self._published.append(topic)

    def open(self) -> None:
        """Join the network, if there are any topics.

        Raises:
            ScenarioError: If an address is in use or invalid.
            ImportError: If a package is missing.
        """
        if self._subscribed or self._published:
            inbox = CommandInbox(self._subscribed.values(), self._warnings)
            try:
                self._bridge = self._config.open(inbox, self._published)
            except (OSError, ValueError) as error:
                raise ScenarioError(f"hardware: {error}") from error

    def send(self, topic: Topic, time: float, *values: Any) -> None:
        """Publish a message, stamped with a time [s], if the node is open."""
        if self._bridge is not None:
            self._bridge.publish(topic, time, values)

    def has_subscribers(self, topic: str) -> bool:
        """Return whether anybody subscribes to a topic that this node publishes."""
        return self._bridge is not None and self._bridge.has_subscribers(topic)

    def close(self) -> None:
        """Leave the network. A second call does nothing."""
        if self._bridge is not None:
            self._bridge.close()
            self._bridge = None


class Nodes:
    """One node for each ROS.

    Args:
        ros1: Of ROS 1.
        ros2: Of ROS 2.
        warnings: Where refused messages are reported.
        suffix: Of the nodes' names, where several processes have nodes.
    """

    def __init__(
        self, ros1: Ros1Config, ros2: Ros2Config, warnings: Warnings, suffix: str = ""
    ) -> None:
        self._nodes = {
            version: Node(dc.replace(config, name=f"{config.name}{suffix}"), warnings)
            for version, config in ((1, ros1), (2, ros2))
        }

    def of(self, version: int) -> Node:
        """Return the node of ROS 1 or of ROS 2."""
        return self._nodes[version]

    def open(self) -> None:
        """Open the nodes that have topics; see `Node.open`."""
        for node in self._nodes.values():
            node.open()

    def close(self) -> None:
        """Close all nodes."""
        for node in self._nodes.values():
            node.close()
