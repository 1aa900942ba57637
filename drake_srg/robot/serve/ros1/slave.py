"""The API of a ROS 1 node for the master and for other nodes."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import Any

from drake_srg.robot.serve.ros1.tcpros import Publication, Subscription


class SlaveApi:
    """ROS 1's slave API; the protocol defines the names of its public methods.

    Each method takes the caller's name first and returns [code, message, value]. The
    code is 1 for success, -1 for an error of the caller and 0 for a failure. Source:
    wiki.ros.org/ROS/Slave_API, but for getBusStats, which no tool of ROS calls.

    Args:
        master: The master's URI.
        address: Host and port to which subscribers connect.
        publications: The node's publications, by topic.
        subscriptions: The node's subscriptions, by topic.
        shutdown: Called with the reason when the node is told to shut down.
    """

    def __init__(
        self,
        master: str,
        address: tuple[str, int],
        publications: Mapping[str, Publication],
        subscriptions: Mapping[str, Subscription],
        shutdown: Callable[[str], None],
    ):
        self._master, self._address = master, address
        self._publications, self._subscriptions = publications, subscriptions
        self._shutdown = shutdown

    def answer(self, method: str, arguments: tuple[Any, ...]) -> list[Any]:
        """Call a method of the protocol by name.

        Raises:
            TypeError: If the method does not exist or takes other arguments.
        """
        function = getattr(self, method, None)
        if method == "answer" or method.startswith("_") or function is None:
            raise TypeError(f"unknown method {method!r}")
        return list(function(*arguments))

    def getBusInfo(self, caller: str) -> list[Any]:
        """Return the connected peers."""
        info = [
            [c.info.id, c.info.peer, "o", "TCPROS", topic, True, "TCPROS connection"]
            for topic, publication in self._publications.items()
            for c in publication.connections
        ]
        info += [
            [c.id, c.peer, "i", "TCPROS", topic, True, "TCPROS connection"]
            for topic, subscription in self._subscriptions.items()
            for c in subscription.connections
        ]
        return [1, "bus info", info]

    def getMasterUri(self, caller: str) -> list[Any]:
        """Return the master's URI."""
        return [1, "", self._master]

    def shutdown(self, caller: str, reason: str = "") -> list[Any]:
        """Shut the node down."""
        self._shutdown(f"{caller!r:.99}: {reason!r:.99}")
        return [1, "shutdown", 0]

    def getPid(self, caller: str) -> list[Any]:
        """Return the process id."""
        return [1, "", os.getpid()]

    def getSubscriptions(self, caller: str) -> list[Any]:
        """Return topics and types of the subscriptions."""
        return [1, "subscriptions", _types(self._subscriptions)]

    def getPublications(self, caller: str) -> list[Any]:
        """Return topics and types of the publications."""
        return [1, "publications", _types(self._publications)]

    def paramUpdate(self, caller: str, key: str, value: Any) -> list[Any]:
        """Ignore a parameter: the node has none."""
        return [1, "", 0]

    def publisherUpdate(
        self, caller: str, topic: str, publishers: list[str]
    ) -> list[Any]:
        """Take the master's list of publishers of a topic."""
        if topic not in self._subscriptions:
            return [-1, f"no subscription to {topic}", 0]
        self._subscriptions[topic].update(map(str, publishers))
        return [1, "", 0]

    def requestTopic(self, caller: str, topic: str, protocols: list[Any]) -> list[Any]:
        """Return the address to connect to for a topic."""
        if topic not in self._publications:
            return [-1, f"{topic} is not published", 0]
        if not any(protocol[:1] == ["TCPROS"] for protocol in protocols):
            return [0, "only TCPROS is supported", 0]
        return [1, "", ["TCPROS", *self._address]]


def _types(
    topics: Mapping[str, Publication] | Mapping[str, Subscription],
) -> list[list[str]]:
    return [[topic, which.type.name] for topic, which in topics.items()]
