"""Dynamixel Protocol 1.0: packets and errors.

An instruction is FF FF ID LENGTH CODE PARAMETERS CHECKSUM; a status packet has an error
in place of the code. Words are little endian.
"""

from __future__ import annotations

import enum
from typing import ClassVar, Self

from drake_srg.bridges.dynamixel.protocol import Packet, Refusal


class Error(enum.IntFlag):
    """Error bits of a status packet."""

    VOLTAGE = 1
    ANGLE_LIMIT = 2
    OVERHEATING = 4
    RANGE = 8
    CHECKSUM = 16
    OVERLOAD = 32
    INSTRUCTION = 64


ERRORS = {
    Refusal.FAILED: Error.INSTRUCTION,
    Refusal.INSTRUCTION: Error.INSTRUCTION,
    Refusal.CHECKSUM: Error.CHECKSUM,
    Refusal.RANGE: Error.RANGE,
    Refusal.LENGTH: Error.RANGE,
    Refusal.LIMIT: Error.ANGLE_LIMIT,
    Refusal.ACCESS: Error.RANGE,
}


class Packet1(Packet):
    """A packet of Protocol 1.0, of up to 259 bytes."""

    header: ClassVar[bytes] = b"\xff\xff"

    def encode(self) -> bytes:
        """See `Packet`."""
        body = bytes([self.id, len(self.parameters) + 2, self.code, *self.parameters])
        return self.header + body + bytes([_checksum(body)])

    @classmethod
    def size(cls, data: bytearray) -> int | None:
        """See `Packet`."""
        if len(data) < 4:
            return None
        number, length = data[2:4]
        return 0 if number == 0xFF or length < 2 else 4 + length

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """See `Packet`."""
        body, checksum = data[2:-1], data[-1]
        return cls(body[0], body[2], body[3:], _checksum(body) == checksum)


def _checksum(body: bytes) -> int:
    return ~sum(body) & 0xFF
