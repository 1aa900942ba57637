"""The topics that a ROS 1 node publishes, and the connections of their subscribers."""

from __future__ import annotations

import asyncio
import socket
from collections import deque
from collections.abc import Mapping
from typing import cast

from drake_srg.bridges.commands import Warnings
from drake_srg.bridges.ros1.tcpros import (
    ANY,
    Connection,
    Frames,
    MessageType,
    MismatchError,
    TcprosError,
    decode_header,
    encode_header,
    frame,
)
from drake_srg.bridges.ros1.timing import Timing

# Messages queued for a slow subscriber before the oldest is lost: ROS 2's default.
_QUEUE = 10


class Publication:
    """A topic that a node publishes.

    Args:
        topic: Name of the topic.
        type: Message type of the topic.

    Attributes:
        topic, type: The arguments.
        connections: Connections to subscribers.
    """

    def __init__(self, topic: str, type: MessageType):
        self.topic, self.type = topic, type
        self.connections: set[SubscriberConnection] = set()

    def send(self, message: bytes | memoryview) -> None:
        """Send a message to all subscribers, without waiting for them."""
        if self.connections:
            framed = frame(message)
            for connection in self.connections:
                connection.send(framed)


class SubscriberConnection(asyncio.Protocol):
    """An incoming connection of a subscriber.

    It belongs to no publication until its header has named one. Messages that the
    subscriber does not read wait in the system's buffers and then in a queue, which
    loses its oldest message when it is full.

    Args:
        name: Name of our node.
        publications: The node's publications, by topic.
        connections: All open connections; this one adds and removes itself.
        warnings: Where refused subscribers are reported.
        timing: Has the time allowed for the header.

    Attributes:
        info: Statistics.
    """

    def __init__(
        self,
        name: str,
        publications: Mapping[str, Publication],
        connections: set[SubscriberConnection],
        warnings: Warnings,
        timing: Timing,
    ):
        self._name, self._publications, self._warnings = name, publications, warnings
        self._connections, self._timing = connections, timing
        self._publication: Publication | None = None
        self._frames = Frames()
        self._queue: deque[bytes] = deque(maxlen=_QUEUE)
        self._paused = False
        self.info = Connection("")

    def send(self, framed: bytes) -> None:
        """Send a framed message now, or queue it."""
        self._queue.append(framed)
        self._flush()

    def abort(self) -> None:
        """Break the connection."""
        self._transport.abort()

    # Called by asyncio.

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Wait for the subscriber's header."""
        self._transport = cast(asyncio.Transport, transport)
        self._transport.set_write_buffer_limits(0)  # messages wait in our own queue
        connection = self._transport.get_extra_info("socket")
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._connections.add(self)
        loop = asyncio.get_running_loop()
        self._deadline = loop.call_later(self._timing.handshake, self.abort)

    def data_received(self, data: bytes) -> None:
        """Read the header. Subscribers send nothing after it."""
        if self._publication is not None or self._transport.is_closing():
            return
        try:
            for content in self._frames.feed(data):
                self._accept(decode_header(content))
                return
        except TcprosError as error:
            kind = type(error).__name__
            self._warnings.warn(
                f"ROS 1 subscriber {kind}", f"ROS 1: refused a subscriber: {error}"
            )
            self._transport.write(encode_header({"error": str(error)}))
            self._transport.close()

    def pause_writing(self) -> None:
        """Queue messages from now on."""
        self._paused = True

    def resume_writing(self) -> None:
        """Send the queued messages."""
        self._paused = False
        self._flush()

    def connection_lost(self, _: Exception | None) -> None:
        """Forget the subscriber."""
        self._deadline.cancel()
        self._queue.clear()
        self._connections.discard(self)
        if self._publication is not None:
            self._publication.connections.discard(self)

    def _flush(self) -> None:
        while self._queue and not self._paused:
            framed = self._queue.popleft()
            self.info.count(len(framed))
            self._transport.write(framed)

    def _accept(self, header: Mapping[str, str]) -> None:
        """Answer a subscriber's header.

        Raises:
            TcprosError: If the header lacks a field or does not match a publication.
        """
        try:
            topic, md5sum = header["topic"], header["md5sum"]
            self.info.peer = header["callerid"]
        except KeyError as error:
            raise TcprosError(f"invalid header: lacks {error}") from error
        publication = self._publications.get(topic)
        if publication is None:
            topics = ", ".join(sorted(self._publications))
            raise MismatchError(f"{topic!r:.99} is not published (topics: {topics})")
        type = publication.type
        if md5sum not in (ANY, type.md5sum):
            raise MismatchError(
                f"{self.info.peer!r:.99} expects {topic} as {header.get('type')!r:.99} "
                f"with MD5 sum {md5sum!r:.99}, but it is {type.name} with {type.md5sum}"
            )
        self._deadline.cancel()
        self._publication = publication
        publication.connections.add(self)
        self._transport.write(
            encode_header(
                {
                    "callerid": self._name,
                    "latching": "0",
                    "md5sum": type.md5sum,
                    "message_definition": type.definition,
                    "topic": topic,
                    "type": type.name,
                }
            )
        )
