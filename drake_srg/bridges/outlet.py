"""What goes from a station to the bridges that serve it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from drake_srg.bridges.bridge import Bridge
from drake_srg.bridges.commands import Warnings
from drake_srg.recording.ros_topics import Topic


class Outlet:
    """Sends to those bridges that have somebody who listens. Any thread may call.

    A bridge that fails is warned of; neither the station nor the others stop for it.
    """

    def __init__(self, bridges: Sequence[Bridge], warnings: Warnings):
        self.bridges, self._warnings = bridges, warnings

    @property
    def status(self) -> str:
        """Where the bridges are reached, for people."""
        return ", ".join(bridge.status for bridge in self.bridges if bridge.status)

    def has_subscribers(self, topic: str) -> bool:
        """Whether somebody listens to a topic, anywhere."""
        return any(bridge.has_subscribers(topic) for bridge in self.bridges)

    def send(self, topic: Topic, time: float, values: Sequence[Any]) -> None:
        """Publish what `topic.convert` makes of the values at a time [s]."""
        for bridge in self.bridges:
            with self._warned(bridge, topic.name):
                if bridge.has_subscribers(topic.name):
                    bridge.publish(topic, time, values)

    def update(self, time: float, values: Mapping[str, Any]) -> None:
        """Give each bridge the values of its ports at a time [s]."""
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
