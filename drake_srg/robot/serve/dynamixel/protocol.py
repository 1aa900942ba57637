"""Dynamixel Protocols 1.0 and 2.0: instructions, packets, refusals.

Source: ROBOTIS's public e-manual (emanual.robotis.com: "Protocol 1.0", "Protocol 2.0").
Numbers are little-endian.
"""

from __future__ import annotations

import dataclasses as dc
import enum
from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar, Self, TypeAlias

BROADCAST = 254


class Instruction(enum.IntEnum):
    """Instruction codes of Protocol 2.0. Protocol 1.0 has some of them, too."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    CLEAR = 0x10
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92
    BULK_WRITE = 0x93
    FAST_BULK_READ = 0x9A


# Instructions that read several servos. They are broadcast, but servos reply.
GROUP_READING = (
    Instruction.SYNC_READ,
    Instruction.BULK_READ,
    Instruction.FAST_SYNC_READ,
    Instruction.FAST_BULK_READ,
)
# Group reads in whose reply servos share a packet.
FAST_READING = (Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ)


class Fault(enum.IntFlag):
    """A servo's faults: bits of its registers and status packets."""

    VOLTAGE = 1
    OVERHEATING = 4
    OVERLOAD = 32

    def __str__(self) -> str:
        return ", ".join((fault.name or "").lower() for fault in self)


class Refusal(enum.IntEnum):
    """Why a servo refuses an instruction: error numbers of Protocol 2.0."""

    FAILED = 1
    INSTRUCTION = 2
    CHECKSUM = 3
    RANGE = 4  # a value that its register never takes
    LENGTH = 5  # a part of a register
    LIMIT = 6  # beyond a limit that another register sets
    ACCESS = 7  # no such register, read only, or locked


class RefusedError(Exception):
    """Raised if an instruction is refused.

    Attributes:
        kind: The reason, for the status packet.
    """

    def __init__(self, kind: Refusal, reason: str):
        super().__init__(reason)
        self.kind = kind


@dc.dataclass(frozen=True)
class Status:
    """A status packet's content.

    Attributes:
        fault: Faults of the servo; empty: none.
        refusal: Why the servo refuses the instruction; None: it does not.
        data: The requested data.
    """

    fault: str
    refusal: Refusal | None
    data: bytes


@dc.dataclass(frozen=True)
class _Packet:
    """An instruction or a status packet of either protocol.

    Attributes:
        header: First bytes of every packet.
        width: Size of an address or a length in the parameters [bytes].
        id: The servo's ID.
        code: The instruction; in a status packet of Protocol 1.0, the error.
        parameters: The data; in a status packet of Protocol 2.0, the error comes first.
        intact: Whether the checksum is right.
    """

    header: ClassVar[bytes]
    width: ClassVar[int]

    id: int
    code: int
    parameters: bytes = b""
    intact: bool = True

    @classmethod
    def number(cls, data: bytes) -> int:
        """Return the number, such as an address, at the start of data."""
        return int.from_bytes(data[: cls.width], "little")

    @classmethod
    def numbers(cls, data: bytes) -> tuple[int, int]:
        """Return the two numbers, such as address and length, at the start of data."""
        return cls.number(data), cls.number(data[cls.width :])

    @classmethod
    def to_bytes(cls, *numbers: int) -> bytes:
        """Return the bytes of addresses and lengths."""
        return b"".join(number.to_bytes(cls.width, "little") for number in numbers)


class Error1(enum.IntFlag):
    """Error bits of a status packet of Protocol 1.0."""

    VOLTAGE = 1
    ANGLE_LIMIT = 2
    OVERHEATING = 4
    RANGE = 8
    CHECKSUM = 16
    OVERLOAD = 32
    INSTRUCTION = 64


_ERRORS1: Mapping[Refusal, Error1] = {
    Refusal.FAILED: Error1.INSTRUCTION,
    Refusal.INSTRUCTION: Error1.INSTRUCTION,
    Refusal.CHECKSUM: Error1.CHECKSUM,
    Refusal.RANGE: Error1.RANGE,
    Refusal.LENGTH: Error1.RANGE,
    Refusal.LIMIT: Error1.ANGLE_LIMIT,
    Refusal.ACCESS: Error1.RANGE,
}


class Packet1(_Packet):
    """A packet of Protocol 1.0, of up to 259 bytes.

    An instruction is FF FF ID LENGTH CODE PARAMETERS CHECKSUM; a status packet has an
    error in place of the code.
    """

    header: ClassVar[bytes] = b"\xff\xff"
    width: ClassVar[int] = 1

    def encode(self) -> bytes:
        """Return the packet's bytes."""
        body = bytes([self.id, len(self.parameters) + 2, self.code, *self.parameters])
        return self.header + body + bytes([_checksum(body)])

    @classmethod
    def size(cls, data: bytearray) -> int | None:
        """Return the length of the packet at the start of `data` [bytes].

        None if this needs more bytes; 0 if no packet begins like this.
        """
        if len(data) < 4:
            return None
        number, length = data[2:4]
        return 0 if number == 0xFF or length < 2 else 4 + length

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Return the packet with exactly these bytes."""
        body, checksum = data[2:-1], data[-1]
        return cls(body[0], body[2], body[3:], _checksum(body) == checksum)

    @classmethod
    def answer(
        cls,
        number: int,
        code: int,
        fault: Fault,
        refused: Refusal | None,
        data: bytes,
    ) -> Packet1:
        """Return the status packet of a servo, by ID, that answers an instruction."""
        return cls(number, fault | (_ERRORS1[refused] if refused else 0), data)

    @property
    def status(self) -> Status | None:
        """Content of a status packet; None if the packet is broken or no status."""
        if not self.intact:
            return None
        fault = Fault(self.code & sum(Fault))
        refused = next((r for r, bit in _ERRORS1.items() if self.code & bit), None)
        return Status(str(fault), refused, self.parameters)

    @classmethod
    def group_read(cls, numbers: Sequence[int], address: int, size: int) -> Packet1:
        """Return an instruction to read the same block of several servos."""
        blocks = [bytes([size, number, address]) for number in numbers]
        return cls(BROADCAST, Instruction.BULK_READ, b"\0" + b"".join(blocks))

    @property
    def asked(self) -> list[tuple[int, int, int]]:
        """ID, address and length for each servo of a group read, in order of reply.

        It is empty for other packets.
        """
        if self.code != Instruction.BULK_READ:
            return []
        blocks = self.parameters[1:]
        return [
            (blocks[k + 1], blocks[k + 2], blocks[k])
            for k in range(0, len(blocks) - 2, 3)
        ]


def _checksum(body: bytes) -> int:
    return ~sum(body) & 0xFF


# Longest packet of Protocol 2.0 [bytes], as in dynamixel-sdk. A whole control table
# fits into it.
_LONGEST = 1024
_RESERVED = 0x00
_BEFORE_LENGTH = 5  # bytes before LENGTH


# Bit of the error byte of Protocol 2.0 that reports a hardware error.
ALERT = 0x80


class Packet2(_Packet):
    """A packet of Protocol 2.0, of up to 1024 bytes.

    It is FF FF FD 00 ID LENGTH CODE PARAMETERS CRC, with two bytes for LENGTH and for
    CRC. The code of a status packet is 0x55, and its first parameter an error. LENGTH
    counts what follows it. In code and parameters, a byte FD is inserted after each FF
    FF FD, so that nothing there looks like a header.
    """

    header: ClassVar[bytes] = b"\xff\xff\xfd"
    width: ClassVar[int] = 2

    def encode(self) -> bytes:
        """Return the packet's bytes."""
        return self._framed(_stuffed(bytes([self.code]) + self.parameters))

    @classmethod
    def size(cls, data: bytearray) -> int | None:
        """Return the length of the packet at the start of `data`; see `Packet1`."""
        if len(data) < _BEFORE_LENGTH + 2:
            return None
        reserved, number = data[3:5]
        end = _BEFORE_LENGTH + 2 + int.from_bytes(data[5:7], "little")
        possible = reserved == _RESERVED and number <= BROADCAST and number != 0xFD
        return end if possible and 10 <= end <= _LONGEST else 0

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Return the packet with exactly these bytes."""
        body = data[7:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
        intact = _crc(data[:-2]) == int.from_bytes(data[-2:], "little")
        return cls(data[4], body[0], body[1:], intact)

    @classmethod
    def answer(
        cls,
        number: int,
        code: int,
        fault: Fault,
        refused: Refusal | None,
        data: bytes,
    ) -> Packet2:
        """Return the status packet of a servo, by ID, that answers an instruction."""
        error = (refused or 0) | (ALERT if fault else 0)
        if code in FAST_READING:
            body = bytes([error, number]) + data
            return FastStatus(BROADCAST, Instruction.STATUS, body)
        return cls(number, Instruction.STATUS, bytes([error]) + data)

    @property
    def status(self) -> Status | None:
        """Content of a status packet; None if the packet is broken or no status."""
        if not self.intact or self.code != Instruction.STATUS or not self.parameters:
            return None
        error, data = self.parameters[0], self.parameters[1:]
        number = error & ~ALERT
        if number > max(Refusal):
            return None
        fault = "hardware error" if error & ALERT else ""
        return Status(fault, Refusal(number) if number else None, data)

    @classmethod
    def group_read(cls, numbers: Sequence[int], address: int, size: int) -> Packet2:
        """Return an instruction to read the same block of several servos."""
        data = cls.to_bytes(address, size) + bytes(numbers)
        return cls(BROADCAST, Instruction.SYNC_READ, data)

    @property
    def asked(self) -> list[tuple[int, int, int]]:
        """ID, address and length for each servo of a group read; see `Packet1`."""
        parameters = self.parameters
        match self.code:
            case Instruction.SYNC_READ | Instruction.FAST_SYNC_READ:
                block = self.numbers(parameters)
                return [(number, *block) for number in parameters[4:]]
            case Instruction.BULK_READ | Instruction.FAST_BULK_READ:
                starts = range(0, len(parameters) - 4, 5)
                return [
                    (parameters[k], *self.numbers(parameters[k + 1 :])) for k in starts
                ]
        return []

    def _framed(self, body: bytes) -> bytes:
        length = len(body) + 2
        head = bytes([_RESERVED, self.id]) + length.to_bytes(2, "little")
        packet = self.header + head + body
        return packet + _crc(packet).to_bytes(2, "little")


class FastStatus(Packet2):
    """The status packet that answers a fast read of one servo.

    No FD is inserted, because ROBOTIS's masters do not remove it from this packet.
    """

    def encode(self) -> bytes:
        """Return the packet's bytes."""
        return self._framed(bytes([self.code]) + self.parameters)


def _stuffed(body: bytes) -> bytes:
    return body.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")


def _remainder(byte: int) -> int:
    """Return the remainder of a byte followed by 16 zero bits, for 0x8005."""
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


# Longest pause within a packet [s]. Masters wait 0.2 s for a reply before they repeat
# a packet.
_PATIENCE = 0.1

Packet: TypeAlias = Packet1 | Packet2


class PacketReader:
    """Finds packets in a stream of bytes that arrives in pieces and with noise.

    A packet that is incomplete after 0.1 s is dropped, so that half a packet never
    swallows the next one. The buffer is always shorter than the longest packet.

    Attributes:
        dropped: Number of bytes so far that belonged to no packet.
    """

    def __init__(self, kind: type[Packet1] | type[Packet2]):
        self.dropped = 0
        self._kind = kind
        self._buffer = bytearray()
        self._last = -float("inf")

    @property
    def pending(self) -> int:
        """Number of bytes of the incomplete packet."""
        return len(self._buffer)

    def feed(self, data: bytes, time: float) -> Iterator[Packet]:
        """Take `data` that arrived at a time [s]; yield the packets it completes."""
        if time - self._last > _PATIENCE:
            self._drop(len(self._buffer))
        self._last = time
        self._buffer += data
        while (packet := self._next()) is not None:
            yield packet

    def _next(self) -> Packet | None:
        buffer, header = self._buffer, self._kind.header
        while True:
            start = buffer.find(header)
            if start < 0:  # the last bytes may begin a header
                parts = (header[:n] for n in range(len(header) - 1, -1, -1))
                start = len(buffer) - len(next(p for p in parts if buffer.endswith(p)))
            self._drop(start)
            size = self._kind.size(buffer)
            if size is None or len(buffer) < size:
                return None
            if size == 0:
                self._drop(1)
                continue
            packet = self._kind.decode(bytes(buffer[:size]))
            if packet.intact:
                del buffer[:size]
            else:  # a packet may begin within the invalid one
                self._drop(len(header))
            return packet

    def _drop(self, count: int) -> None:
        self.dropped += count
        del self._buffer[:count]
