"""What both Dynamixel protocols have in common: instructions, packets, refusals.

Source: ROBOTIS's public e-manual (emanual.robotis.com: "Protocol 1.0", "Protocol 2.0").
"""

from __future__ import annotations

import abc
import dataclasses as dc
import enum
from collections.abc import Iterator
from typing import ClassVar, Generic, Self, TypeVar

BROADCAST = 254


class Instruction(enum.IntEnum):
    """Instruction codes. Protocol 1.0 has some of them, with the same meaning."""

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


class Refusal(enum.Enum):
    """Why a servo refuses an instruction."""

    FAILED = enum.auto()
    INSTRUCTION = enum.auto()
    CHECKSUM = enum.auto()
    RANGE = enum.auto()  # a value that its register never takes
    LENGTH = enum.auto()  # a part of a register
    LIMIT = enum.auto()  # beyond a limit that another register sets
    ACCESS = enum.auto()  # no such register, read only, or locked


class RefusedError(Exception):
    """An instruction is refused.

    Attributes:
        kind: Why, for the status packet.
    """

    def __init__(self, kind: Refusal, reason: str):
        super().__init__(reason)
        self.kind = kind


@dc.dataclass(frozen=True)
class Packet(abc.ABC):
    """An instruction or a status packet. Each protocol has its own subclass.

    Attributes:
        id: Of the servo.
        code: Instruction. In a status packet of Protocol 1.0, the error.
        parameters: Data. In a status packet of Protocol 2.0, after the error.
        intact: Whether the checksum is right.
    """

    header: ClassVar[bytes]

    id: int
    code: int
    parameters: bytes = b""
    intact: bool = True

    @abc.abstractmethod
    def encode(self) -> bytes:
        """Return the bytes that go over the wire."""

    @classmethod
    @abc.abstractmethod
    def size(cls, data: bytearray) -> int | None:
        """Return the length of the packet that begins with `data`, a header first.

        None if that takes more bytes to tell, and 0 if no packet begins like this.
        """

    @classmethod
    @abc.abstractmethod
    def decode(cls, data: bytes) -> Self:
        """Return the packet with exactly these bytes."""


P = TypeVar("P", bound=Packet)


class PacketReader(Generic[P]):
    """Finds packets in a stream of bytes, whatever pieces and noise it arrives in.

    A packet that is incomplete after `patience` is dropped, so that half a packet never
    swallows the next one. The buffer is always shorter than the longest packet.

    Args:
        kind: The protocol's packets.
        patience: Longest pause within a packet [s]. Masters wait 0.2 s for a reply
            before they repeat a packet.

    Attributes:
        dropped: Number of bytes so far that belonged to no packet.
    """

    def __init__(self, kind: type[P], patience: float = 0.1):
        self.dropped = 0
        self._kind = kind
        self._patience = patience
        self._buffer = bytearray()
        self._last = -float("inf")

    @property
    def pending(self) -> int:
        """Number of bytes of the incomplete packet."""
        return len(self._buffer)

    def feed(self, data: bytes, time: float) -> Iterator[P]:
        """Yield the packets that `data`, received at a time [s], completes."""
        if time - self._last > self._patience:
            self._drop(len(self._buffer))
        self._last = time
        self._buffer += data
        while (packet := self._next()) is not None:
            yield packet

    def _next(self) -> P | None:
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
