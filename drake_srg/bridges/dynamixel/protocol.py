"""Dynamixel Protocol 1.0: packets.

Source: ROBOTIS's public e-manual (emanual.robotis.com: "Protocol 1.0").
An instruction is FF FF ID LENGTH CODE PARAMETERS CHECKSUM; a status packet has an error
in place of the code. Words are little endian.
"""

from __future__ import annotations

import dataclasses as dc
import enum
from collections.abc import Iterator

BROADCAST = 254
_HEADER = b"\xff\xff"


class Instruction(enum.IntEnum):
    """Instruction codes."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    SYNC_WRITE = 0x83
    BULK_READ = 0x92


class Error(enum.IntFlag):
    """Error bits of a status packet."""

    VOLTAGE = 1
    ANGLE_LIMIT = 2
    OVERHEATING = 4
    RANGE = 8
    CHECKSUM = 16
    OVERLOAD = 32
    INSTRUCTION = 64


class RefusedError(Exception):
    """An instruction is refused.

    Attributes:
        error: Error bit for the status packet.
    """

    def __init__(self, error: Error, reason: str):
        super().__init__(reason)
        self.error = error


@dc.dataclass(frozen=True)
class Packet:
    """An instruction, or a status packet with its error as `code`."""

    id: int
    code: int
    parameters: bytes = b""
    intact: bool = True  # whether the checksum is right

    def encode(self) -> bytes:
        """Return the bytes that go over the wire."""
        body = bytes([self.id, len(self.parameters) + 2, self.code, *self.parameters])
        return _HEADER + body + bytes([_checksum(body)])


def _checksum(body: bytes) -> int:
    return ~sum(body) & 0xFF


class PacketReader:
    """Finds packets in a stream of bytes, whatever pieces and noise it arrives in.

    A packet that is incomplete after `patience` is dropped, so that half a packet never
    swallows the next one. The buffer is always shorter than the longest packet, 259
    bytes.

    Args:
        patience: Longest pause within a packet [s]. Masters wait 0.2 s for a reply
            before they repeat a packet.

    Attributes:
        dropped: Number of bytes so far that belonged to no packet.
    """

    def __init__(self, patience: float = 0.1):
        self.dropped = 0
        self._patience = patience
        self._buffer = bytearray()
        self._last = -float("inf")

    @property
    def pending(self) -> int:
        """Number of bytes of the incomplete packet."""
        return len(self._buffer)

    def feed(self, data: bytes, time: float) -> Iterator[Packet]:
        """Yield the packets that `data`, received at a time [s], completes."""
        if time - self._last > self._patience:
            self._drop(len(self._buffer))
        self._last = time
        self._buffer += data
        while (packet := self._next()) is not None:
            yield packet

    def _next(self) -> Packet | None:
        buffer = self._buffer
        while True:
            start = buffer.find(_HEADER)
            if start < 0:  # the last byte may begin a header
                start = len(buffer) - buffer.endswith(b"\xff")
            self._drop(start)
            if len(buffer) < 4:
                return None
            if buffer[2] == 0xFF or buffer[3] < 2:  # invalid ID or length
                self._drop(1)
                continue
            end = 4 + buffer[3]
            if len(buffer) < end:
                return None
            body, checksum = bytes(buffer[2 : end - 1]), buffer[end - 1]
            packet = Packet(body[0], body[2], body[3:], _checksum(body) == checksum)
            if packet.intact:
                del buffer[:end]
            else:  # a packet may begin within the invalid one
                self._drop(len(_HEADER))
            return packet

    def _drop(self, count: int) -> None:
        self.dropped += count
        del self._buffer[:count]
