"""The bridge to ROS 1: a node of our own, no ROS installed."""

from __future__ import annotations

import asyncio
import contextlib
import importlib
import os
from collections.abc import Sequence
from typing import Any

from drake_srg.bridges.bridge import Bridge
from drake_srg.bridges.commands import CommandInbox
from drake_srg.bridges.io_thread import IoThread
from drake_srg.bridges.ros1.node import Ros1Node
from drake_srg.bridges.ros1.publication import Publication
from drake_srg.bridges.ros1.subscription import Subscription
from drake_srg.bridges.ros1.tcpros import MessageType
from drake_srg.common.errors import one_line
from drake_srg.common.installing import pip_install, this_package
from drake_srg.recording.ros_topics import Topic

_DEFAULT_MASTER = "http://localhost:11311"
# To be registered takes some ms; so who makes a bridge sees whether there is a roscore
# [s, real].
_REGISTRATION_TIMEOUT = 1.0


class Ros1Bridge(Bridge):
    """Subscribes to the topics of an inbox and publishes others, as a ROS 1 node.

    It does not need a roscore to be made: it waits for one, and registers again when
    there is a new one. Where it is told to shut down, as by `rosnode kill`, it does,
    and is `closed`.

    Args:
        inbox: Where commands go; every one that arrives is deserialized, which takes
            1 to 3 us of the 1 ms between those of a client that sends at 1 kHz.
        topics: What is published. A subscriber that reads too slowly loses the oldest
            messages.
        master: Its URI; None: $ROS_MASTER_URI, or http://localhost:11311.
        host: Address or network interface of this machine. It is listened at, and
            peers are told its address, which they must be able to reach. $ROS_IP and
            $ROS_HOSTNAME are not looked at: what is said there for other nodes does
            not open this one to the network.
        name: Of the node. Where there was one of this name, the master shuts it down.

    Raises:
        ImportError: If rosbags is missing; the message says how to install it.
        ValueError: If `master` or `host` cannot be.
        OSError: If nothing can be listened to at `host`.
    """

    def __init__(
        self,
        inbox: CommandInbox,
        topics: Sequence[Topic],
        *,
        master: str | None = None,
        host: str = "127.0.0.1",
        name: str = "/drake_srg",
    ):
        self._store = _noetic()
        self._inbox = inbox
        self._sequence = {topic.name: 0 for topic in topics}
        self._publications = {
            topic.name: Publication(topic.name, self._type(topic.type))
            for topic in topics
        }
        self._node = Ros1Node(
            name,
            master or os.environ.get("ROS_MASTER_URI") or _DEFAULT_MASTER,
            host,
            list(self._publications.values()),
            [
                self._subscription(name, topic.name, topic.type)
                for topic in inbox.topics.values()
            ],
            inbox.warnings,
        )
        self._io = IoThread("ros1")
        self._io.loop.set_exception_handler(self._fault)
        try:
            self._io.call(self._node.start(_REGISTRATION_TIMEOUT))
        except BaseException:
            self.close()
            raise

    @property
    def status(self) -> str:
        """Where its master is, and whether it is there."""
        if self._node.closed:
            return "ROS 1 shut down"
        waiting = "" if self._node.registered else " (waiting for roscore)"
        return f"ROS 1 at {self._node.master}{waiting}"

    @property
    def closed(self) -> bool:
        """Whether it was told to shut down, or closed."""
        return self._node.closed

    def has_subscribers(self, topic: str) -> bool:
        """Whether somebody listens to a topic."""
        publication = self._publications.get(topic)
        return publication is not None and len(publication.connections) > 0

    def publish(self, topic: Topic, time: float, values: Sequence[Any]) -> None:
        """Send what `topic.convert` makes of its ports' values at a time [s]."""
        if not self.has_subscribers(topic.name):
            return

        def make(type: str, *arguments: Any, **fields: Any) -> Any:
            if type == "std_msgs/msg/Header":
                fields["seq"] = self._sequence[topic.name] % 2**32
            return self._store.types[type](*arguments, **fields)

        message = topic.convert(make, time, *values)
        if message is None:
            return
        self._sequence[topic.name] += 1
        content = self._store.serialize_ros1(message, topic.type)
        with contextlib.suppress(RuntimeError):  # closed meanwhile, by another thread
            self._io.post(self._publications[topic.name].send, content)

    def close(self) -> None:
        """Say goodbye to the master and all peers, within about a second."""
        if not self._io.loop.is_closed():
            with contextlib.suppress(TimeoutError):
                self._io.call(self._node.close(), timeout=1.0)
            self._io.stop()

    def _subscription(self, node: str, topic: str, type: str) -> Subscription:
        ros1_type = self._type(type)

        def receive(content: bytes) -> None:
            try:
                message = self._store.deserialize_ros1(content, type)
            except Exception as error:  # rosbags' and those that it lets through
                reason = f"is no {ros1_type.name}: {one_line(error)}"
                self._inbox.refuse(topic, "message", reason)
            else:
                self._inbox.receive(topic, message.data)

        return Subscription(node, topic, ros1_type, receive, self._inbox.warnings)

    def _type(self, type: str) -> MessageType:
        definition, md5sum = self._store.generate_msgdef(type)
        self._store.get_msgdef(type)  # compiles what the first message needs
        return MessageType(type.replace("/msg/", "/"), md5sum, definition)

    def _fault(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Tell of what nobody expected; the loop goes on."""
        reason = context.get("exception") or context["message"]
        self._inbox.warnings.warn("ROS 1 fault", f"ROS 1: {reason!r}")


def _noetic() -> Any:
    """ROS 1's message types."""
    try:
        typesys = importlib.import_module("rosbags.typesys")
    except ImportError as error:
        raise ImportError(
            "ROS 1 needs 'rosbags', which is not installed. "
            f"Run: {pip_install(*this_package('ros1'))}"
        ) from error
    return typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
