"""TCPROS, the stream protocol of ROS 1's messages: frames and connection headers.

Everything is sent in frames: a little-endian length of four bytes, then the content.
The first frame in each direction is the connection header, whose fields name=value are
framed in the same way. Every later frame is a message. Sources: wiki.ros.org/ROS/TCPROS
and wiki.ros.org/ROS/Connection Header.
"""

from __future__ import annotations

import contextlib
import dataclasses as dc
import itertools
import struct
from collections.abc import Iterator, Mapping

# Largest frame that peers may send [bytes]; headers and commands are a thousand times
# smaller.
FRAME_LIMIT = 2**20
# Wildcard for a type or an MD5 sum.
ANY = "*"

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
    """Statistics of a connection, as `rosnode info` shows them."""

    peer: str  # subscriber's name, or publisher's URI
    messages: int = 0
    bytes: int = 0
    id: int = dc.field(default_factory=lambda: next(_ids))

    def count(self, size: int) -> None:
        """Count a message of `size` bytes."""
        self.messages += 1
        self.bytes += size


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
