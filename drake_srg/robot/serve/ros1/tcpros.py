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
import struct
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterable, Mapping

from drake_srg.common.exceptions import one_line
from drake_srg.robot.serve.commands import Warnings
from drake_srg.robot.serve.ros1.xmlrpc import TIMEOUT, call
from drake_srg.robot.serve.sockets import MOST_LOOKUPS, address_of

# Largest frame that peers may send [bytes]; headers and commands are a thousand times
# smaller.
FRAME_LIMIT = 2**20
# Wildcard for a type or an MD5 sum.
ANY = "*"
# Length of the queue for a slow subscriber, ROS 2's default. When it is full, the
# oldest message is lost.
_QUEUE = 10
# Time for a peer to send its connection header [s, real].
_HANDSHAKE = 5.0
# Time before the next attempt to reach a publisher, which doubles after each failure,
# and its maximum [s, real].
_RETRY, _LONGEST_RETRY = 0.5, 4.0

_LENGTH = struct.Struct("<I")
_ids = itertools.count(1)


class TcprosError(ValueError):
    """A peer violates the protocol."""


class MismatchError(TcprosError):
    """A peer's topic or type does not match ours."""


@dc.dataclass(frozen=True)
class MessageType:
    """A message type, described as in ROS 1's connection headers."""

    name: str  # such as "std_msgs/Int32"
    md5sum: str
    definition: str


class Connection:
    """A connection, described as in `rosnode info`.

    Attributes:
        peer: Name of a subscriber, or URI of a publisher.
    """

    def __init__(self, peer: str) -> None:
        self.peer, self.id = peer, next(_ids)


def frame(content: bytes | memoryview) -> bytes:
    """Return content preceded by its length."""
    return b"".join((_LENGTH.pack(len(content)), content))


async def frames(
    reader: asyncio.StreamReader, limit: int = FRAME_LIMIT
) -> AsyncIterator[bytes]:
    """Yield the contents of a stream's frames until it ends.

    Raises:
        TcprosError: If a frame is larger than the limit [bytes], or the stream ends
            within a frame.
    """
    while first := await reader.read(1):
        try:
            rest = await reader.readexactly(_LENGTH.size - 1)
            (size,) = _LENGTH.unpack(first + rest)
            if size > limit:
                raise TcprosError(
                    f"invalid frame: must have at most {limit} bytes, got {size}"
                )
            content = await reader.readexactly(size)
        except asyncio.IncompleteReadError:
            raise TcprosError(
                "the connection ended in the middle of a message"
            ) from None
        yield content


def encode_header(fields: Mapping[str, str]) -> bytes:
    """Return a connection header as a frame."""
    return frame(b"".join(frame(f"{k}={v}".encode()) for k, v in fields.items()))


def decode_header(content: bytes) -> dict[str, str]:
    """Return the fields of a connection header, given the content of its frame.

    Raises:
        TcprosError: If the content is not a header.
    """
    fields, end = dict[str, str](), 0
    while end < len(content):
        start = end + _LENGTH.size
        end = start + int.from_bytes(content[end:start], "little")
        field = content[start:end].decode(errors="replace")
        name, equals, fields[name] = field.partition("=")
        if end > len(content) or not (name and equals):
            raise TcprosError("invalid header: must consist of fields name=value")
    return fields


@dc.dataclass(frozen=True)
class Endpoint:
    """Our node, as one end of every connection.

    Attributes:
        name: The node's name, such as "/drake_srg".
        warnings: Receives warnings.
    """

    name: str
    warnings: Warnings


class Subscriber(Connection):
    """A subscriber to a publication.

    Messages that it has not read wait in the system's buffers, and then in a queue that
    drops its oldest message when it is full.
    """

    def __init__(self, peer: str) -> None:
        super().__init__(peer)
        self._queue: deque[bytes] = deque(maxlen=_QUEUE)
        self._queued = asyncio.Event()

    def send(self, framed: bytes) -> None:
        """Queue a framed message."""
        self._queue.append(framed)
        self._queued.set()

    async def write_to(self, writer: asyncio.StreamWriter) -> None:
        """Write the queued messages until the connection breaks."""
        writer.transport.set_write_buffer_limits(0)  # messages wait in our own queue
        with contextlib.suppress(OSError):
            while True:
                await self._queued.wait()
                self._queued.clear()
                while self._queue:
                    writer.write(self._queue.popleft())
                    await writer.drain()


class Publication:
    """A topic that a node publishes."""

    def __init__(self, topic: str, type: MessageType):
        self.topic, self.type = topic, type
        self.connections: set[Subscriber] = set()

    def send(self, message: bytes | memoryview) -> None:
        """Send a message to all subscribers, without waiting for them."""
        if self.connections:
            framed = frame(message)
            for connection in self.connections:
                connection.send(framed)


async def serve_subscriber(
    ours: Endpoint,
    publications: Mapping[str, Publication],
    reader: asyncio.StreamReader,
    writer: asyncio.StreamWriter,
) -> None:
    """Answer a subscriber's header, and send messages until it leaves.

    The header names one of the publications.
    """
    try:
        async with asyncio.timeout(_HANDSHAKE):
            header = decode_header(await anext(frames(reader)))
        subscriber, publication = _accepted(header, publications)
        type = publication.type
        answer = {
            "callerid": ours.name,
            "latching": "0",
            "md5sum": type.md5sum,
            "message_definition": type.definition,
            "topic": publication.topic,
            "type": type.name,
        }
        # Count the subscriber before the answer: it expects all messages after that.
        publication.connections.add(subscriber)
        writer.write(encode_header(answer))
        writing = asyncio.create_task(subscriber.write_to(writer))
        try:
            while await reader.read(FRAME_LIMIT):
                pass  # subscribers send nothing after the header
        finally:
            writing.cancel()
            publication.connections.discard(subscriber)
    except TcprosError as error:
        kind = error.__class__.__name__
        ours.warnings.warn(
            f"ROS 1 subscriber {kind}", f"ROS 1: refused a subscriber: {error}"
        )
        writer.write(encode_header({"error": str(error)}))
    except (OSError, StopAsyncIteration):  # the subscriber is silent or has left
        pass
    finally:
        writer.close()


def _accepted(
    header: Mapping[str, str], publications: Mapping[str, Publication]
) -> tuple[Subscriber, Publication]:
    """Return a subscriber and its publication.

    Raises:
        TcprosError: If the header lacks a field or does not match a publication.
    """
    try:
        topic, md5sum, peer = (header[name] for name in ("topic", "md5sum", "callerid"))
    except KeyError as error:
        raise TcprosError(f"invalid header: lacks {error}") from error
    publication = publications.get(topic)
    if publication is None:
        topics = ", ".join(sorted(publications))
        raise MismatchError(f"{topic!r:.99} is not published (topics: {topics})")
    type = publication.type
    if md5sum not in (ANY, type.md5sum):
        raise MismatchError(
            f"{peer!r:.99} expects {topic} as {header.get('type')!r:.99} "
            f"with MD5 sum {md5sum!r:.99}, but it is {type.name} with {type.md5sum}"
        )
    return Subscriber(peer), publication


@dc.dataclass
class _Publisher:
    task: asyncio.Task[None] | None = None
    connection: Connection | None = None


class Subscription:
    """A topic that a node subscribes to.

    It connects to every publisher that the master lists, and tries again after a
    failure. It keeps a working connection even if a new master does not list it.

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
        """Receive the master's list of publishers' URIs."""
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
        """Receive from a publisher until it is neither listed nor sending."""
        retry, worked = _RETRY, False
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
            retry = _RETRY if worked else min(2.0 * retry, _LONGEST_RETRY)
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
            async for content in frames(reader, self._largest):
                if publisher.connection is None:
                    self._check(decode_header(content))
                    publisher.connection = Connection(uri)
                else:
                    self._receive(content)
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
