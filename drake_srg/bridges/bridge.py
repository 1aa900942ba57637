"""The wires between clients or robots and us: what every bridge and ROS node does."""

from __future__ import annotations

import abc
import functools
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from drake_srg.bridges.commands import CommandInbox, CommandTopic
from drake_srg.common.exceptions import one_line
from drake_srg.recording.ros_topics import Topic
from drake_srg.types import Vector


class Bridge:
    """Carries commands from clients to a station, and its messages to clients.

    A bridge puts commands into the `CommandInbox` with which it is constructed. All
    methods return quickly, never wait for a client, and may be called by any thread.
    This base class has no clients.

    Attributes:
        ports: Names of the station's output ports whose values `update` needs.
    """

    ports: Collection[str] = ()

    @property
    def status(self) -> str:
        """Where clients reach it, such as "ROS 1 at http://localhost:11311"."""
        return ""

    @property
    def closed(self) -> bool:
        """Whether it has closed, so that no client can reach it any more."""
        return False

    def has_subscribers(self, topic: str) -> bool:
        """Return whether a topic has a subscriber."""
        return False

    def publish(self, topic: Topic, time: float, values: Sequence[Any]) -> None:
        """Send the message that `topic.convert` makes of values at a time [s]."""

    def update(self, time: float, values: Mapping[str, Vector]) -> None:
        """Receive the values of `ports` at a time [s]; called every control period."""

    def close(self) -> None:
        """Disconnect all clients. A second call does nothing."""


class RosBridge(Bridge, abc.ABC):
    """A ROS node: receives an inbox's topics and publishes others.

    ROS 1 and ROS 2 share the messages, by ROS 2's names of their types. They differ in
    how they serialize and transport them.

    Args:
        store: Of rosbags, with the types of the messages.
        inbox: Where commands go.
    """

    def __init__(self, store: Any, inbox: CommandInbox) -> None:
        self._store, self._inbox = store, inbox

    def publish(self, topic: Topic, time: float, values: Sequence[Any]) -> None:
        """Send the message that `topic.convert` makes of values at a time [s]."""
        message = topic.convert(functools.partial(self._make, topic), time, *values)
        if message is not None:
            self._write(topic, self._serialize(topic, message))

    def _receive(self, topic: CommandTopic, content: bytes) -> None:
        """Put a serialized message into the inbox, or refuse it."""
        try:
            message = self._deserialize(content, topic.type)
        except Exception as error:  # rosbags' own errors, and others it lets pass
            name, why = self._type_name(topic.type), one_line(error).rstrip(".")
            reason = f"must be a {name}: {why}"
            self._inbox.refuse(topic.name, "malformed", reason)
        else:
            self._inbox.receive_message(topic.name, message)

    def _make(self, topic: Topic | None, type: str, *values: Any, **fields: Any) -> Any:
        """Make a message, or a part of one, that a topic publishes."""
        return self._store.types[type](*values, **fields)

    def _type_name(self, type: str) -> str:
        """Return the name of a type as this ROS writes it."""
        return type

    @abc.abstractmethod
    def _serialize(self, topic: Topic, message: Any) -> bytes | memoryview:
        """Return a message as bytes."""

    @abc.abstractmethod
    def _deserialize(self, content: bytes, type: str) -> Any:
        """Return the message that bytes hold; raises any error if they hold none."""

    @abc.abstractmethod
    def _write(self, topic: Topic, content: bytes | memoryview) -> None:
        """Send a serialized message to the subscribers, if there are any."""
