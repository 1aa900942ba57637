"""The interface between a bridge and the loop that serves a station."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

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
