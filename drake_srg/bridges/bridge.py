"""What all bridges offer to the loop that serves a station."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from drake_srg.recording.ros_topics import Topic
from drake_srg.types import Vector


class Bridge:
    """Carries commands from clients, and to them what the station tells.

    Made with the `CommandInbox` into which it puts what clients command. All methods
    are quick, wait for no client, and may be called by any thread. This one has no
    clients.

    Attributes:
        ports: Names of the station's output ports that it wants in `update`.
    """

    ports: Collection[str] = ()

    @property
    def status(self) -> str:
        """Where it is reached, for people, as in "ROS 1 at http://localhost:11311"."""
        return ""

    @property
    def closed(self) -> bool:
        """Whether it has ended by itself, and nobody can reach it any more."""
        return False

    def has_subscribers(self, topic: str) -> bool:
        """Whether somebody listens to a topic."""
        return False

    def publish(self, topic: Topic, time: float, values: Sequence[Any]) -> None:
        """Send what `topic.convert` makes of its ports' values at a time [s]."""

    def update(self, time: float, values: Mapping[str, Vector]) -> None:
        """Take the values of `ports` at a time [s], every control period."""

    def close(self) -> None:
        """Say goodbye to all clients; the second time, this does nothing."""
