"""The topics that a ROS 1 node subscribes to, and the connections to publishers."""

from __future__ import annotations

import asyncio
import dataclasses as dc
from collections.abc import Callable, Iterable

from drake_srg.bridges.addresses import Resolver
from drake_srg.bridges.commands import Warnings
from drake_srg.bridges.ros1.tcpros import (
    ANY,
    FRAME_LIMIT,
    Connection,
    Frames,
    MessageType,
    MismatchError,
    TcprosError,
    decode_header,
    encode_header,
)
from drake_srg.bridges.ros1.timing import Timing
from drake_srg.bridges.ros1.xmlrpc import TIMEOUT, call
from drake_srg.common.exceptions import one_line

# Bytes read at once; other connections get their turn in between.
_CHUNK = 2**16
# Unknown names of publishers' machines are the most common fault of ROS 1. They have a
# resolver of their own, so that they do not use up the master's lookups.
_resolver = Resolver()


@dc.dataclass
class _Publisher:
    task: asyncio.Task[None] | None = None
    connection: Connection | None = None


class Subscription:
    """A topic that a node subscribes to.

    It connects to every publisher that the master lists, and tries again when that
    fails. A working connection is kept even if a new master does not list it.

    Args:
        name: Name of our node.
        topic: Name of the topic.
        type: Message type of the topic.
        receive: Called with each message, serialized.
        warnings: Where unsuitable publishers are reported.
        timing: Has the times between attempts.
        largest: Size of the largest message [bytes].

    Attributes:
        topic, type: The arguments.
        updates: Number of publisher lists received so far.
    """

    def __init__(
        self,
        name: str,
        topic: str,
        type: MessageType,
        receive: Callable[[bytes], None],
        warnings: Warnings,
        timing: Timing,
        largest: int = FRAME_LIMIT,
    ):
        self.topic, self.type = topic, type
        self._name, self._receive, self._warnings = name, receive, warnings
        self._timing, self._largest = timing, largest
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
        retry, worked = self._timing.retry, False
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
            if worked:
                retry = self._timing.retry
            else:
                retry = min(2.0 * retry, self._timing.retry_max)
            await asyncio.sleep(retry)
        self._publishers.pop(uri, None)

    async def _read(self, uri: str, publisher: _Publisher) -> None:
        """Connect to a publisher and receive until either side closes."""
        protocols = [["TCPROS"]]
        answer = await call(
            uri, "requestTopic", self._name, self.topic, protocols, resolver=_resolver
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
                        "callerid": self._name,
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
                        publisher.connection.count(len(content))
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
        self._warnings.warn(
            f"ROS 1 {self.topic} {kind}", f"ROS 1: {self.topic}: {message}"
        )


async def _connect(
    host: str, port: int
) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    return await asyncio.open_connection(await _resolver.address(host), port)
