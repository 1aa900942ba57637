"""TCPROS, the stream protocol of ROS 1's messages, and a node's topics on it.

Everything is sent in frames: a little-endian length of four bytes, then the content.
The first frame in each direction is the connection header, whose fields name=value are
framed in the same way. Every later frame is a message. Sources: wiki.ros.org/ROS/TCPROS
and wiki.ros.org/ROS/Connection Header.
"""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses as dc
import itertools
import socket
import struct
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import cast

from drake_srg.common.exceptions import one_line
from drake_srg.robot.serve.commands import Warnings
from drake_srg.robot.serve.ros1.xmlrpc import TIMEOUT, call
from drake_srg.robot.serve.sockets import MOST_LOOKUPS, address_of

# Largest frame that peers may send [bytes]; headers and commands are a thousand times
# smaller.
FRAME_LIMIT = 2**20
# Wildcard for a type or an MD5 sum.
ANY = "*"
# Messages queued for a slow subscriber before the oldest is lost: ROS 2's default.
_QUEUE = 10
# Bytes read at once; other connections get their turn in between.
_CHUNK = 2**16

_LENGTH = struct.Struct("<I")
_ids = itertools.count(1)


class TcprosError(ValueError):
    """A peer violates the protocol."""


class MismatchError(TcprosError):
    """A peer's topic or type does not match ours."""


@dc.dataclass(frozen=True)
class MessageType:
    """A message type as ROS 1 describes it in connection headers."""

    name: str  # such as "std_msgs/Int32"
    md5sum: str
    definition: str


@dc.dataclass
class Connection:
    """A connection as `rosnode info` shows it."""

    peer: str  # subscriber's name, or publisher's URI
    id: int = dc.field(default_factory=lambda: next(_ids))


def frame(content: bytes | memoryview) -> bytes:
    """Return content with its length in front."""
    return b"".join((_LENGTH.pack(len(content)), content))


def encode_header(fields: Mapping[str, str]) -> bytes:
    """Return a connection header as a frame."""
    return frame(b"".join(frame(f"{k}={v}".encode()) for k, v in fields.items()))


def decode_header(content: bytes) -> dict[str, str]:
    """Return the fields of a connection header, given the content of its frame.

    Raises:
        TcprosError: If the content is not a header.
    """
    frames, fields = Frames(), []
    with contextlib.suppress(TcprosError):  # a wrong length leaves bytes pending
        for field in frames.feed(content):
            fields.append(field.decode(errors="replace").partition("="))
    if frames.pending or not all(name and equals for name, equals, _ in fields):
        raise TcprosError("invalid header: must consist of fields name=value")
    return {name: value for name, _, value in fields}


class Frames:
    """Finds the frames in a stream of bytes, whatever pieces it arrives in.

    Args:
        limit: Size of the largest frame [bytes].
    """

    def __init__(self, limit: int = FRAME_LIMIT) -> None:
        self._bytes, self._limit = bytearray(), limit

    @property
    def pending(self) -> int:
        """Number of bytes of the incomplete frame."""
        return len(self._bytes)

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Take bytes; yield the contents of all frames that are now complete.

        Raises:
            TcprosError: If a frame's length exceeds the limit.
        """
        self._bytes += data
        start = 0
        try:
            while len(self._bytes) >= start + _LENGTH.size:
                (size,) = _LENGTH.unpack_from(self._bytes, start)
                if size > self._limit:
                    raise TcprosError(
                        f"invalid frame: must have at most {self._limit} bytes, "
                        f"got {size}"
                    )
                end = start + _LENGTH.size + size
                if len(self._bytes) < end:
                    return
                content = bytes(self._bytes[start + _LENGTH.size : end])
                start = end
                yield content
        finally:
            del self._bytes[:start]


@dc.dataclass(frozen=True)
class Timing:
    """Waiting times of a ROS 1 node [s, real].

    Attributes:
        poll: Between checks that the master still knows the node.
        retry: Before a publisher is tried again; doubles after each failure.
        retry_max: Upper limit of `retry`.
        handshake: For a peer to send its connection header.
        goodbye: For all goodbyes to the master together.
    """

    poll: float = 1.0
    retry: float = 0.5
    retry_max: float = 4.0
    handshake: float = 5.0
    goodbye: float = 0.5


@dc.dataclass(frozen=True)
class Endpoint:
    """Our side of every connection.

    Attributes:
        name: The node's name, such as "/drake_srg".
        timing: Waiting times.
    """

    name: str
    warnings: Warnings
    timing: Timing


class Publication:
    """A topic that a node publishes."""

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
        publications: The node's publications, by topic.
        connections: All open connections; this one adds and removes itself.

    Attributes:
        info: For other nodes.
    """

    def __init__(
        self,
        ours: Endpoint,
        publications: Mapping[str, Publication],
        connections: set[SubscriberConnection],
    ):
        self._ours, self._publications = ours, publications
        self._connections = connections
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
        self._deadline = loop.call_later(self._ours.timing.handshake, self.abort)

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
            self._ours.warnings.warn(
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
            self._transport.write(self._queue.popleft())

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
                    "callerid": self._ours.name,
                    "latching": "0",
                    "md5sum": type.md5sum,
                    "message_definition": type.definition,
                    "topic": topic,
                    "type": type.name,
                }
            )
        )


@dc.dataclass
class _Publisher:
    task: asyncio.Task[None] | None = None
    connection: Connection | None = None


class Subscription:
    """A topic that a node subscribes to.

    It connects to every publisher that the master lists, and tries again when that
    fails. A working connection is kept even if a new master does not list it.

    Args:
        receive: Called with each message, serialized.
        largest: Size of the largest message [bytes].

    Attributes:
        updates: Number of publisher lists received so far.
    """

    def __init__(
        self,
        ours: Endpoint,
        topic: str,
        type: MessageType,
        receive: Callable[[bytes], None],
        largest: int = FRAME_LIMIT,
    ):
        self.topic, self.type = topic, type
        self._ours, self._receive, self._largest = ours, receive, largest
        self._publishers: dict[str, _Publisher] = {}
        self._listed: set[str] = set()
        self.updates = 0

    @property
    def connections(self) -> list[Connection]:
        """Connections to publishers whose header has been accepted."""
        publishers = self._publishers.values()
        return [p.connection for p in publishers if p.connection is not None]

    def update(self, publishers: Iterable[str]) -> None:
        """Take the master's list of publishers' URIs."""
        self.updates += 1
        self._listed = set(publishers)
        for uri in self._publishers.keys() - self._listed:
            if self._publishers[uri].connection is None:
                self._drop(uri)
        for uri in self._listed - self._publishers.keys():
            publisher = self._publishers[uri] = _Publisher()
            publisher.task = asyncio.create_task(self._follow(uri, publisher))

    def close(self) -> None:
        """Close all connections."""
        self._listed = set()
        for uri in list(self._publishers):
            self._drop(uri)

    def _drop(self, uri: str) -> None:
        task = self._publishers.pop(uri).task
        if task is not None:
            task.cancel()

    async def _follow(self, uri: str, publisher: _Publisher) -> None:
        """Receive from a publisher while it is listed or sends."""
        timing = self._ours.timing
        retry, worked = timing.retry, False
        while uri in self._listed:
            try:
                await self._read(uri, publisher)
            except TcprosError as error:
                kind = type(error).__name__
                self._warn(kind, f"{uri}: {error}; connection closed")
            except (TimeoutError, OSError, ValueError) as error:
                # A publisher that has just left may still be listed for a moment.
                if publisher.connection is None and not worked:
                    text = one_line(error) or "no answer"
                    self._warn("unreachable", f"{uri} cannot be reached: {text}")
            except Exception as error:  # only close() and the master may end this loop
                self._warn("fault", f"{uri}: {error!r}; connection closed")
            worked, publisher.connection = publisher.connection is not None, None
            retry = timing.retry if worked else min(2.0 * retry, timing.retry_max)
            await asyncio.sleep(retry)
        self._publishers.pop(uri, None)

    async def _read(self, uri: str, publisher: _Publisher) -> None:
        """Connect to a publisher and receive until either side closes."""
        protocols = [["TCPROS"]]
        name = self._ours.name
        answer = await call(
            uri, "requestTopic", name, self.topic, protocols, lookups=MOST_LOOKUPS
        )
        match answer:
            case ["TCPROS", str(host), int(port)] if 0 < port < 2**16:
                connecting = _connect(host, port)
            case _:
                raise TcprosError(f"invalid answer to requestTopic: {answer!r:.100}")
        reader, writer = await asyncio.wait_for(connecting, TIMEOUT)
        try:
            writer.write(
                encode_header(
                    {
                        "callerid": name,
                        "md5sum": self.type.md5sum,
                        "message_definition": self.type.definition,
                        "tcp_nodelay": "1",
                        "topic": self.topic,
                        "type": self.type.name,
                    }
                )
            )
            frames = Frames(self._largest)
            while data := await reader.read(_CHUNK):
                for content in frames.feed(data):
                    if publisher.connection is None:
                        self._check(decode_header(content))
                        publisher.connection = Connection(uri)
                    else:
                        self._receive(content)
            if frames.pending:
                raise TcprosError("the connection ended in the middle of a message")
        finally:
            writer.close()

    def _check(self, header: dict[str, str]) -> None:
        """Raise a MismatchError unless a publisher's header matches the topic."""
        if "error" in header:
            raise MismatchError(f"the publisher refuses: {header['error']!r:.200}")
        md5sum = header.get("md5sum")
        if md5sum not in (ANY, self.type.md5sum):
            raise MismatchError(
                f"must be {self.type.name} with MD5 sum {self.type.md5sum}, "
                f"got {header.get('type')!r:.99} with {md5sum!r:.99}"
            )

    def _warn(self, kind: str, message: str) -> None:
        self._ours.warnings.warn(
            f"ROS 1 {self.topic} {kind}", f"ROS 1: {self.topic}: {message}"
        )


async def _connect(
    host: str, port: int
) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    return await asyncio.open_connection(await address_of(host, MOST_LOOKUPS), port)
