"""Dynamixel Protocol 2.0: packets and errors.

A packet is FF FF FD 00 ID LENGTH CODE PARAMETERS CRC, with two bytes for LENGTH and for
CRC, low byte first. The code of a status packet is 0x55, and its first parameter an
error. LENGTH counts what follows it. In code and parameters, a byte FD is inserted
after each FF FF FD, so that nothing there looks like a header.
"""

from __future__ import annotations

import enum
from typing import ClassVar, Self

from drake_srg.bridges.dynamixel.protocol import BROADCAST, Packet, Refusal

# Longest packet in bytes: dynamixel-sdk's. A longer one would take more than the whole
# control table.
_LONGEST = 1024
_RESERVED = 0x00
_BEFORE_LENGTH = 5  # bytes


class Error(enum.IntEnum):
    """Error numbers of a status packet."""

    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7


ALERT = 0x80  # bit beside the error number: the hardware has an error

ERRORS = {
    Refusal.FAILED: Error.RESULT_FAIL,
    Refusal.INSTRUCTION: Error.INSTRUCTION,
    Refusal.CHECKSUM: Error.CRC,
    Refusal.RANGE: Error.DATA_RANGE,
    Refusal.LENGTH: Error.DATA_LENGTH,
    Refusal.LIMIT: Error.DATA_LIMIT,
    Refusal.ACCESS: Error.ACCESS,
}


class Packet2(Packet):
    """A packet of Protocol 2.0, of up to 1024 bytes."""

    header: ClassVar[bytes] = b"\xff\xff\xfd"

    def encode(self) -> bytes:
        """See `Packet`."""
        return self._framed(_stuffed(bytes([self.code]) + self.parameters))

    @classmethod
    def size(cls, data: bytearray) -> int | None:
        """See `Packet`."""
        if len(data) < _BEFORE_LENGTH + 2:
            return None
        reserved, number = data[3:5]
        end = _BEFORE_LENGTH + 2 + int.from_bytes(data[5:7], "little")
        possible = reserved == _RESERVED and number <= BROADCAST and number != 0xFD
        return end if possible and 10 <= end <= _LONGEST else 0

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """See `Packet`."""
        body = data[7:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
        intact = _crc(data[:-2]) == int.from_bytes(data[-2:], "little")
        return cls(data[4], body[0], body[1:], intact)

    def _framed(self, body: bytes) -> bytes:
        length = len(body) + 2
        head = bytes([_RESERVED, self.id]) + length.to_bytes(2, "little")
        packet = self.header + head + body
        return packet + _crc(packet).to_bytes(2, "little")


class FastStatus(Packet2):
    """The status packet that servos share in reply to a fast read, of one servo here.

    ROBOTIS's masters take its data as they are: nothing is inserted.
    """

    def encode(self) -> bytes:
        """See `Packet`."""
        return self._framed(bytes([self.code]) + self.parameters)


def _stuffed(body: bytes) -> bytes:
    return body.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")


def _remainder(byte: int) -> int:
    """Return the remainder of a byte and 16 zeros for the polynomial 0x8005."""
    crc = byte << 8
    for _ in range(8):
        crc = crc << 1 ^ (0x8005 if crc & 0x8000 else 0)
    return crc & 0xFFFF


_REMAINDERS = [_remainder(byte) for byte in range(256)]


def _crc(data: bytes) -> int:
    """Return the CRC-16/BUYPASS of bytes."""
    crc = 0
    for byte in data:
        crc = (crc << 8 ^ _REMAINDERS[crc >> 8 ^ byte]) & 0xFFFF
    return crc
