"""The bridge to ROS 1: a node that registers at the master and serves other nodes."""

from __future__ import annotations

import asyncio
import contextlib
import functools
import os
import re
import socket
from collections.abc import Callable, Mapping, Sequence
from typing import Any
from urllib.parse import urlsplit

from rosbags.typesys import Stores, get_typestore

from drake_srg.recording.rosbag import Topic
from drake_srg.robot.serve.bridge import RosBridge
from drake_srg.robot.serve.commands import CommandInbox, CommandTopic
from drake_srg.robot.serve.ros1.tcpros import (
    Endpoint,
    MessageType,
    Publication,
    Subscription,
    serve_subscriber,
)
from drake_srg.robot.serve.ros1.xmlrpc import XmlRpcError, call, serve
from drake_srg.robot.serve.sockets import IoThread, own_address

_DEFAULT_MASTER = "http://localhost:11311"
# How long the constructor waits for the first attempt to register [s, real], so that
# the first status is right. With a roscore, an attempt takes some ms.
_REGISTRATION_TIMEOUT = 1.0
# Time between checks that the master still knows the node, and for unregistering all
# topics together [s, real].
_POLL, _GOODBYE = 1.0, 0.5


class Ros1Bridge(RosBridge):
    """A ROS 1 node that subscribes to an inbox's topics and publishes others.

    Without a roscore, it waits for one, and it registers again when roscore restarts.
    On a request to shut down, such as `rosnode kill`, it closes.

    Args:
        inbox: Receives the commands. Every message is deserialized, which takes 1 to
            3 us.
        topics: The topics to publish. A subscriber that reads too slowly loses the
            oldest messages.
        master: The master's URI; None: $ROS_MASTER_URI, or http://localhost:11311.
        host: Address or network interface of this machine. The node listens there and
            gives its address to peers, which must be able to reach it. $ROS_IP and
            $ROS_HOSTNAME are ignored, so that settings for other nodes do not open this
            one to the network.
        name: The node's name. The master shuts down an older node of the same name.

    Raises:
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
    ):
        super().__init__(get_typestore(Stores.ROS1_NOETIC), inbox)
        # Actions of ROS 2 do not exist in ROS 1.
        topics = [topic for topic in topics if _is_ours(topic)]
        self._sequence = {topic.name: 0 for topic in topics}
        self._publications = {
            topic.name: Publication(topic.name, self._type(topic.type))
            for topic in topics
        }
        self._ours = ours = Endpoint(name, inbox.warnings)
        self._subscriptions = {
            topic.name: Subscription(
                ours,
                topic.name,
                self._type(topic.type),
                functools.partial(self._receive, topic),
                topic.largest,
            )
            for topic in filter(_is_ours, inbox.topics.values())
        }
        self._master = master or os.environ.get("ROS_MASTER_URI") or _DEFAULT_MASTER
        _check_uri(self._master)
        self._registered = self._closed = False
        self._subscribers: set[asyncio.StreamWriter] = set()
        self._servers: list[asyncio.Server] = []
        self._tasks: list[asyncio.Task[None]] = []
        host = own_address(host)
        with contextlib.ExitStack() as stack:
            self._listeners = [
                stack.enter_context(socket.create_server((host, 0))) for _ in range(2)
            ]
            stack.pop_all()
        slave, tcpros = (listener.getsockname()[1] for listener in self._listeners)
        self._uri = f"http://{host}:{slave}/"
        self._api = SlaveApi(
            self._master,
            (host, tcpros),
            self._publications,
            self._subscriptions,
            self._shut_down,
        )
        self._io = IoThread("ros1")
        self._io.loop.set_exception_handler(self._handle_fault)
        try:
            self._io.call(self._start(_REGISTRATION_TIMEOUT))
        except BaseException:
            self.close()
            raise

    @property
    def status(self) -> str:
        """The master's URI, and whether the master answers."""
        if self._closed:
            return "ROS 1 shut down"
        waiting = "" if self._registered else " (waiting for roscore)"
        return f"ROS 1 at {self._master}{waiting}"

    @property
    def closed(self) -> bool:
        """Whether the node was closed or told to shut down."""
        return self._closed

    def has_subscribers(self, topic: str) -> bool:
        """Return whether a topic has a subscriber."""
        publication = self._publications.get(topic)
        return publication is not None and len(publication.connections) > 0

    def publish(self, topic: Topic, time: float, values: Sequence[Any]) -> None:
        """Send the message that `topic.convert` makes from values at a time [s]."""
        # Unlike in DDS, later subscribers do not get earlier messages.
        if self.has_subscribers(topic.name):
            super().publish(topic, time, values)

    def close(self) -> None:
        """Unregister and disconnect all peers, within about a second."""
        if not self._io.loop.is_closed():
            with contextlib.suppress(TimeoutError):
                self._io.call(self._leave(), timeout=1.0)
            self._io.stop()

    def _serialize(self, topic: Topic, message: Any) -> bytes | memoryview:
        self._sequence[topic.name] += 1
        content: bytes | memoryview = self._store.serialize_ros1(message, topic.type)
        return content

    def _deserialize(self, content: bytes, type: str) -> Any:
        return self._store.deserialize_ros1(content, type)

    def _write(self, topic: Topic, content: bytes | memoryview) -> None:
        with contextlib.suppress(RuntimeError):  # closed by another thread meanwhile
            self._io.post(self._publications[topic.name].send, content)

    def _make(self, topic: Topic | None, type: str, *values: Any, **fields: Any) -> Any:
        if topic is not None and type == "std_msgs/msg/Header":
            fields["seq"] = self._sequence[topic.name] % 2**32
        return super()._make(topic, type, *values, **fields)

    def _type(self, type: str) -> MessageType:
        definition, md5sum = self._store.generate_msgdef(type)
        self._store.get_msgdef(type)  # compiles now, not at the first message
        return MessageType(self._type_name(type), md5sum, definition)

    def _type_name(self, type: str) -> str:
        return type.replace("/msg/", "/")

    # Called in the thread of the event loop.

    async def _start(self, timeout: float) -> None:
        """Listen to peers, and start to register at the master.

        Args:
            timeout: How long to wait for the first attempt to register, successful or
                not [s, real].
        """
        slave, tcpros = self._listeners
        self._servers.append(await serve(slave, self._api.answer, self._refuse))
        self._servers.append(await asyncio.start_server(self._connect, sock=tcpros))
        tried = asyncio.Event()
        self._tasks.append(asyncio.create_task(self._stay_registered(tried)))
        with contextlib.suppress(asyncio.TimeoutError):
            await asyncio.wait_for(tried.wait(), timeout)

    async def _leave(self) -> None:
        """Unregister at the master and disconnect all peers."""
        if self._closed:
            return
        self._closed, self._registered = True, False
        for task in self._tasks:
            task.cancel()
        for subscription in self._subscriptions.values():
            subscription.close()
        for server in self._servers:
            server.close()
        for listener in self._listeners:
            listener.close()
        for writer in self._subscribers:
            writer.transport.abort()
        goodbyes = [
            self._call(f"unregister{kind}", topic, self._uri, timeout=_GOODBYE)
            for kind, topics in (
                ("Publisher", self._publications),
                ("Subscriber", self._subscriptions),
            )
            for topic in topics
        ]
        await asyncio.gather(*goodbyes, return_exceptions=True)

    async def _stay_registered(self, tried: asyncio.Event) -> None:
        """Register whenever the master does not know the node.

        Set `tried` after the first attempt.
        """
        warnings = self._ours.warnings
        while True:
            try:
                if self._registered:
                    await self._call("lookupNode", self._ours.name)
            except XmlRpcError:
                self._registered = False
            try:
                if not self._registered:
                    await self._register()
                    self._registered = True
                    warnings.forget("ROS 1 master")
            except (XmlRpcError, TypeError) as error:
                warnings.warn(
                    "ROS 1 master", f"ROS 1: roscore: {error}; waiting for it"
                )
            tried.set()
            await asyncio.sleep(_POLL)

    async def _register(self) -> None:
        for topic, publication in self._publications.items():
            await self._call(
                "registerPublisher", topic, publication.type.name, self._uri
            )
        for topic, subscription in self._subscriptions.items():
            updates, type = subscription.updates, subscription.type.name
            peers = await self._call("registerSubscriber", topic, type, self._uri)
            # If `updates` has changed, the master sent a newer list while its answer
            # was on the way.
            if subscription.updates == updates:
                subscription.update(map(str, peers))

    async def _call(self, method: str, *arguments: Any, **options: Any) -> Any:
        """Call a method of the master."""
        return await call(self._master, method, self._ours.name, *arguments, **options)

    async def _connect(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        self._subscribers.add(writer)
        try:
            await serve_subscriber(self._ours, self._publications, reader, writer)
        finally:
            self._subscribers.discard(writer)

    def _refuse(self, reason: str) -> None:
        self._ours.warnings.warn("ROS 1 request", f"ROS 1: refused a request: {reason}")

    def _shut_down(self, reason: str) -> None:
        self._ours.warnings.warn(
            "ROS 1 shutdown", f"ROS 1: told to shut down ({reason})"
        )
        self._goodbye = asyncio.create_task(self._leave())

    def _handle_fault(
        self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]
    ) -> None:
        """Report an unexpected error; the loop continues."""
        reason = context.get("exception") or context["message"]
        self._ours.warnings.warn("ROS 1 fault", f"ROS 1: {reason!r}")


def _is_ours(topic: Topic | CommandTopic) -> bool:
    return topic.name.startswith("/") and not topic.type.startswith("action_msgs/")


def _check_uri(uri: str) -> None:
    """Raise a ValueError unless a URI can be a master's."""
    try:
        address = urlsplit(uri)
        good = address.scheme == "http" and address.hostname and address.port
    except ValueError:  # an invalid port
        good = False
    if not good:
        raise ValueError(
            "ROS 1 master: must be http://HOST:PORT, such as http://localhost:11311, "
            f"got {uri!r}"
        )


class SlaveApi:
    """ROS 1's slave API. Methods have Python's names, such as `get_pid` for `getPid`.

    Each method takes the caller's name first and returns [code, message, value]. The
    code is 1 for success, -1 for an error of the caller and 0 for a failure. Source:
    wiki.ros.org/ROS/Slave_API. getBusStats is missing: no ROS tool calls it.

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
        name = re.sub("[A-Z]", lambda letter: f"_{letter[0].lower()}", method)
        function = getattr(self, name, None)
        if name == "answer" or name.startswith("_") or function is None:
            raise TypeError(f"unknown method {method!r}")
        return list(function(*arguments))

    def get_bus_info(self, caller: str) -> list[Any]:
        """Return the connected peers."""
        info = [
            [c.id, c.peer, direction, "TCPROS", topic, True, "TCPROS connection"]
            for direction, topics in (
                ("o", self._publications),
                ("i", self._subscriptions),
            )
            for topic, which in topics.items()
            for c in which.connections
        ]
        return [1, "bus info", info]

    def get_master_uri(self, caller: str) -> list[Any]:
        """Return the master's URI."""
        return [1, "", self._master]

    def shutdown(self, caller: str, reason: str = "") -> list[Any]:
        """Shut the node down."""
        self._shutdown(f"{caller!r:.99}: {reason!r:.99}")
        return [1, "shutdown", 0]

    def get_pid(self, caller: str) -> list[Any]:
        """Return the process ID."""
        return [1, "", os.getpid()]

    def get_subscriptions(self, caller: str) -> list[Any]:
        """Return topics and types of the subscriptions."""
        return [1, "subscriptions", _types(self._subscriptions)]

    def get_publications(self, caller: str) -> list[Any]:
        """Return topics and types of the publications."""
        return [1, "publications", _types(self._publications)]

    def param_update(self, caller: str, key: str, value: Any) -> list[Any]:
        """Ignore a parameter: the node has none."""
        return [1, "", 0]

    def publisher_update(
        self, caller: str, topic: str, publishers: list[str]
    ) -> list[Any]:
        """Receive the master's list of publishers of a topic."""
        if topic not in self._subscriptions:
            return [-1, f"no subscription to {topic}", 0]
        self._subscriptions[topic].update(map(str, publishers))
        return [1, "", 0]

    def request_topic(self, caller: str, topic: str, protocols: list[Any]) -> list[Any]:
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
