"""TCPROS, how ROS 1 sends messages: frames of a byte stream, and their header.

Everything goes in frames, a little-endian length of four bytes and as many bytes. The
first one each way is the connection's header, of fields name=value framed likewise;
each of the others is a message. Source: wiki.ros.org/ROS/TCPROS and
wiki.ros.org/ROS/Connection Header.
"""

from __future__ import annotations

import contextlib
import dataclasses as dc
import itertools
import struct
from collections.abc import Iterator, Mapping

# Allowed of what peers send [bytes]: headers and commands are a thousand times smaller.
FRAME_LIMIT = 2**20
# A peer says who it is within this [s, real].
HANDSHAKE_TIMEOUT = 5.0
# Stands for any type, or any MD5 sum.
ANY = "*"

_LENGTH = struct.Struct("<I")
_ids = itertools.count(1)


class TcprosError(ValueError):
    """Bytes that no ROS 1 node sends."""


class MismatchError(TcprosError):
    """A ROS 1 node whose topic or type is not ours."""


@dc.dataclass(frozen=True)
class MessageType:
    """A message type as ROS 1 tells it peers."""

    name: str  # as in "std_msgs/Int32"
    md5sum: str
    definition: str


@dc.dataclass
class Connection:
    """What people may ask about a connection, as by `rosnode info`."""

    peer: str  # subscriber's name, or publisher's URI
    messages: int = 0
    bytes: int = 0
    id: int = dc.field(default_factory=lambda: next(_ids))

    def count(self, size: int) -> None:
        """Count a message of a size [bytes]."""
        self.messages += 1
        self.bytes += size


def frame(content: bytes | memoryview) -> bytes:
    """Return content as it is sent, behind its length."""
    return b"".join((_LENGTH.pack(len(content)), content))


def encode_header(fields: Mapping[str, str]) -> bytes:
    """Return a connection's header as it is sent, framed."""
    return frame(b"".join(frame(f"{k}={v}".encode()) for k, v in fields.items()))


def decode_header(content: bytes) -> dict[str, str]:
    """Return the fields of a connection's header, whose own frame is off already.

    Raises:
        TcprosError: If it is none.
    """
    frames, fields = Frames(), []
    with contextlib.suppress(TcprosError):  # of a length; bytes are left over then
        for field in frames.feed(content):
            fields.append(field.decode(errors="replace").partition("="))
    if frames.pending or not all(name and equals for name, equals, _ in fields):
        raise TcprosError("a header that is not of fields name=value")
    return {name: value for name, _, value in fields}


class Frames:
    """Finds the frames in a stream of bytes that arrives in any pieces."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    @property
    def pending(self) -> int:
        """How many bytes there are of a frame that is not complete."""
        return len(self._bytes)

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Take bytes; yield the contents of all frames that are complete now.

        Raises:
            TcprosError: If a frame says that it is longer than allowed.
        """
        self._bytes += data
        start = 0
        try:
            while len(self._bytes) >= start + _LENGTH.size:
                (size,) = _LENGTH.unpack_from(self._bytes, start)
                if size > FRAME_LIMIT:
                    raise TcprosError(
                        f"a length of {size} bytes; allowed are up to {FRAME_LIMIT}"
                    )
                end = start + _LENGTH.size + size
                if len(self._bytes) < end:
                    return
                content = bytes(self._bytes[start + _LENGTH.size : end])
                start = end
                yield content
        finally:
            del self._bytes[:start]
