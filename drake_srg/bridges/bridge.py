"""What all bridges offer to the loop that serves a station."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from drake_srg.recording.ros_topics import Topic


class Bridge(Protocol):
    """Carries topics to and from clients.

    Made with the `CommandInbox` into which it puts what clients command and the
    `Topic`s that it publishes. All methods are quick, wait for no client, and may be
    called by any thread.
    """

    @property
    def status(self) -> str:
        """Where it is reached, for people, as in "ROS 1 at http://localhost:11311"."""
        ...

    def has_subscribers(self, topic: str) -> bool:
        """Whether somebody listens."""
        ...

    def publish(self, topic: Topic, time: float, values: Sequence[Any]) -> None:
        """Send what `topic.convert` makes of its ports' values at a time [s]."""
        ...

    def close(self) -> None:
        """Say goodbye to all clients; the second time, this does nothing."""
        ...
