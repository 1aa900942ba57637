"""Base classes of bridges and ROS nodes, and the outlet that publishes to all."""

from __future__ import annotations

import abc
import contextlib
import functools
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

from drake_srg.common.exceptions import one_line
from drake_srg.recording.rosbag import Topic
from drake_srg.robot.serve.commands import CommandInbox, CommandTopic, Warnings
from drake_srg.types import Vector


class Bridge:
    """Carries commands from clients to a station, and the station's messages back.

    A bridge puts commands into the `CommandInbox` with which it is constructed. All
    methods return quickly, never wait for a client, and may be called by any thread.
    This base class has no clients.

    Attributes:
        ports: Names of the station's output ports whose values `update` needs.
    """

    ports: Collection[str] = ()

    @property
    def status(self) -> str:
        """Address for clients, such as "ROS 1 at http://localhost:11311"."""
        return ""

    @property
    def closed(self) -> bool:
        """Whether the bridge has closed, so that no client can reach it."""
        return False

    def has_subscribers(self, topic: str) -> bool:
        """Return whether a topic has a subscriber."""
        return False

    def publish(self, topic: Topic, time: float, values: Sequence[Any]) -> None:
        """Send the message that `topic.convert` makes from values at a time [s]."""

    def update(self, time: float, values: Mapping[str, Vector]) -> None:
        """Receive the values of `ports` at a time [s]; called every control period."""

    def close(self) -> None:
        """Disconnect all clients. A second call does nothing."""


class RosBridge(Bridge, abc.ABC):
    """A ROS node: receives an inbox's topics and publishes others.

    ROS 1 and ROS 2 share the messages here, with ROS 2's names of the types. They
    differ in how they serialize and transport messages.

    Args:
        store: The store of rosbags with the types of the messages.
    """

    def __init__(self, store: Any, inbox: CommandInbox) -> None:
        self._store, self._inbox = store, inbox

    def publish(self, topic: Topic, time: float, values: Sequence[Any]) -> None:
        """Send the message that `topic.convert` makes from values at a time [s]."""
        message = topic.convert(functools.partial(self._make, topic), time, *values)
        if message is not None:
            self._write(topic, self._serialize(topic, message))

    def _receive(self, topic: CommandTopic, content: bytes) -> None:
        """Put a serialized message into the inbox, or refuse it."""
        try:
            message = self._deserialize(content, topic.type)
        except Exception as error:  # rosbags raises errors of any type
            name, why = self._type_name(topic.type), one_line(error).rstrip(".")
            reason = f"must be a {name}: {why}"
            self._inbox.refuse(topic.name, "malformed", reason)
        else:
            self._inbox.receive_message(topic.name, message)

    def _make(self, topic: Topic | None, type: str, *values: Any, **fields: Any) -> Any:
        """Make a message of a topic, or a part of one."""
        return self._store.types[type](*values, **fields)

    def _type_name(self, type: str) -> str:
        """Return the name of a type in this version of ROS."""
        return type

    @abc.abstractmethod
    def _serialize(self, topic: Topic, message: Any) -> bytes | memoryview:
        """Return a message as bytes."""

    @abc.abstractmethod
    def _deserialize(self, content: bytes, type: str) -> Any:
        """Deserialize a message; may raise an error of any type."""

    @abc.abstractmethod
    def _write(self, topic: Topic, content: bytes | memoryview) -> None:
        """Send a serialized message to the subscribers, if there are any."""


class Outlet:
    """Publishes through every bridge that has subscribers. It is thread-safe.

    If a bridge fails, the user is warned, and the other bridges continue.
    """

    def __init__(self, bridges: Sequence[Bridge], warnings: Warnings):
        self.bridges, self._warnings = bridges, warnings

    @property
    def status(self) -> str:
        """Addresses of the bridges, as text for the status line."""
        return ", ".join(bridge.status for bridge in self.bridges if bridge.status)

    def has_subscribers(self, topic: str) -> bool:
        """Return whether any bridge has a subscriber to a topic."""
        return any(bridge.has_subscribers(topic) for bridge in self.bridges)

    def send(self, topic: Topic, time: float, values: Sequence[Any]) -> None:
        """Publish the message that `topic.convert` makes from values at a time [s]."""
        for bridge in self.bridges:
            with self._warned(bridge, topic.name):
                if bridge.has_subscribers(topic.name):
                    bridge.publish(topic, time, values)

    def update(self, time: float, values: Mapping[str, Any]) -> None:
        """Pass each bridge the values of its ports at a time [s]."""
        for bridge in self.bridges:
            with self._warned(bridge, "update"):
                bridge.update(time, {name: values[name] for name in bridge.ports})

    @contextlib.contextmanager
    def _warned(self, bridge: Bridge, what: str) -> Iterator[None]:
        try:
            yield
        except Exception as error:
            kind = f"{type(bridge).__name__} {what}"
            self._warnings.warn(kind, f"{kind}: {error!r}")
