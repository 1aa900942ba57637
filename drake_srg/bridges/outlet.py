"""Distribute what a station publishes to its bridges."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from drake_srg.bridges.bridge import Bridge
from drake_srg.bridges.commands import Warnings
from drake_srg.recording.ros_topics import Topic


class Outlet:
    """Publishes through every bridge that has subscribers. Any thread may call.

    A failing bridge is reported; the station and the other bridges go on.

    Args:
        bridges: The bridges to publish through.
        warnings: Where failures are reported.
    """

    def __init__(self, bridges: Sequence[Bridge], warnings: Warnings):
        self.bridges, self._warnings = bridges, warnings

    @property
    def status(self) -> str:
        """Where clients reach the bridges, as text for the status line."""
        return ", ".join(bridge.status for bridge in self.bridges if bridge.status)

    def has_subscribers(self, topic: str) -> bool:
        """Return whether any bridge has a subscriber to a topic."""
        return any(bridge.has_subscribers(topic) for bridge in self.bridges)

    def send(self, topic: Topic, time: float, values: Sequence[Any]) -> None:
        """Publish the message that `topic.convert` makes of values at a time [s]."""
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
