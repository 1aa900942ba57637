"""The bridge to ROS 1."""

from __future__ import annotations

import asyncio
import contextlib
import importlib
import os
from collections.abc import Sequence
from typing import Any

from drake_srg.bridges.bridge import Bridge
from drake_srg.bridges.commands import CommandInbox, CommandTopic
from drake_srg.bridges.io_thread import IoThread
from drake_srg.bridges.ros1.node import Ros1Node
from drake_srg.bridges.ros1.publication import Publication
from drake_srg.bridges.ros1.subscription import Subscription
from drake_srg.bridges.ros1.tcpros import MessageType
from drake_srg.bridges.ros1.timing import Timing
from drake_srg.common.exceptions import one_line
from drake_srg.common.installing import pip_install, this_package
from drake_srg.recording.ros_topics import Topic

_DEFAULT_MASTER = "http://localhost:11311"
# How long the constructor waits for the first attempt to register [s, real]. With a
# roscore that takes some ms; then the first status is right.
_REGISTRATION_TIMEOUT = 1.0


class Ros1Bridge(Bridge):
    """A ROS 1 node that subscribes to an inbox's topics and publishes others.

    It can be constructed without a roscore: it waits for one, and registers again when
    roscore restarts. On a request to shut down, such as `rosnode kill`, it closes.

    Args:
        inbox: Where commands go. Every message is deserialized, which takes 1 to 3 us;
            a client that sends at 1 kHz leaves 1 ms.
        topics: The topics to publish. A subscriber that reads too slowly loses the
            oldest messages.
        master: The master's URI. None takes $ROS_MASTER_URI, or
            http://localhost:11311.
        host: Address or network interface of this machine. The node listens there and
            gives its address to peers, which must be able to reach it. $ROS_IP and
            $ROS_HOSTNAME are ignored, so that settings for other nodes do not open this
            one to the network.
        name: The node's name. The master shuts down an older node of the same name.
        timing: Waiting times; None takes the defaults.

    Raises:
        ImportError: If rosbags is missing; the message says how to install it.
        ValueError: If `master` or `host` is invalid.
        OSError: If the node cannot listen at `host`.
    """

    def __init__(
        self,
        inbox: CommandInbox,
        topics: Sequence[Topic],
        *,
        master: str | None = None,
        host: str = "127.0.0.1",
        name: str = "/drake_srg",
        timing: Timing | None = None,
    ):
        self._store = _load_noetic_types()
        # ROS 1 has no services of ROS 2.
        topics = [topic for topic in topics if _is_ours(topic)]
        commands = filter(_is_ours, inbox.topics.values())
        self._inbox, self._timing = inbox, timing or Timing()
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
            [self._subscription(name, topic) for topic in commands],
            inbox.warnings,
            self._timing,
        )
        self._io = IoThread("ros1")
        self._io.loop.set_exception_handler(self._handle_fault)
        try:
            self._io.call(self._node.start(_REGISTRATION_TIMEOUT))
        except BaseException:
            self.close()
            raise

    @property
    def status(self) -> str:
        """The master's URI, and whether the master answers."""
        if self._node.closed:
            return "ROS 1 shut down"
        waiting = "" if self._node.registered else " (waiting for roscore)"
        return f"ROS 1 at {self._node.master}{waiting}"

    @property
    def closed(self) -> bool:
        """Whether it was closed or told to shut down."""
        return self._node.closed

    def has_subscribers(self, topic: str) -> bool:
        """Return whether a topic has a subscriber."""
        publication = self._publications.get(topic)
        return publication is not None and len(publication.connections) > 0

    def publish(self, topic: Topic, time: float, values: Sequence[Any]) -> None:
        """Send the message that `topic.convert` makes of values at a time [s]."""
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
        with contextlib.suppress(RuntimeError):  # closed by another thread meanwhile
            self._io.post(self._publications[topic.name].send, content)

    def close(self) -> None:
        """Unregister and disconnect all peers, within about a second."""
        if not self._io.loop.is_closed():
            with contextlib.suppress(TimeoutError):
                self._io.call(self._node.close(), timeout=1.0)
            self._io.stop()

    def _subscription(self, node: str, subscribed: CommandTopic) -> Subscription:
        topic, type = subscribed.name, subscribed.type
        ros1_type = self._type(type)

        def receive(content: bytes) -> None:
            try:
                message = self._store.deserialize_ros1(content, type)
            except Exception as error:  # rosbags' own errors, and others it lets pass
                reason = f"must be a {ros1_type.name}: {one_line(error)}"
                self._inbox.refuse(topic, "message", reason)
            else:
                self._inbox.receive_message(topic, message)

        return Subscription(
            node,
            topic,
            ros1_type,
            receive,
            self._inbox.warnings,
            self._timing,
            subscribed.largest,
        )

    def _type(self, type: str) -> MessageType:
        definition, md5sum = self._store.generate_msgdef(type)
        self._store.get_msgdef(type)  # compiles now, not at the first message
        return MessageType(type.replace("/msg/", "/"), md5sum, definition)

    def _handle_fault(
        self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]
    ) -> None:
        """Report an unexpected error; the loop goes on."""
        reason = context.get("exception") or context["message"]
        self._inbox.warnings.warn("ROS 1 fault", f"ROS 1: {reason!r}")


def _is_ours(topic: Topic | CommandTopic) -> bool:
    return topic.name.startswith("/") and not topic.type.startswith("action_msgs/")


def _load_noetic_types() -> Any:
    """Return ROS 1's message types."""
    try:
        typesys = importlib.import_module("rosbags.typesys")
    except ImportError as error:
        raise ImportError(
            "ROS 1 needs 'rosbags', which is not installed. "
            f"Run: {pip_install(*this_package('ros1'))}"
        ) from error
    return typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
