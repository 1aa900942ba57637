"""The master of a bus of Dynamixel servos, over a serial device or a socket."""

from __future__ import annotations

import array
import contextlib
import dataclasses as dc
import fcntl
import os
import select
import socket
import termios
import tty
from collections.abc import Mapping, Sequence
from typing import Protocol

from drake_srg.robot.serve.dynamixel.protocol import (
    BROADCAST,
    Instruction,
    Packet,
    PacketReader,
    Refusal,
)
from drake_srg.robot.serve.dynamixel.registers import TABLES, ServoState

# With ASYNC_LOW_LATENCY (linux/tty_flags.h), an FTDI adapter such as the U2D2 passes on
# bytes as they arrive; otherwise, it keeps them for up to 16 ms. The flags are the
# fifth int of `serial_struct` (linux/serial.h), which fits into 32 ints.
_LOW_LATENCY, _FLAGS, _SERIAL = 1 << 13, 4, 32
_CHUNK = 4096  # bytes read at once
_PATIENCE = 2.0  # for a TCP connection [s]
# Most reads that `drain` ignores.
_LONGEST_NOISE = 64


class Line:
    """Sends and receives bytes over a descriptor, which it owns.

    Args:
        descriptor: The descriptor of a serial device, a terminal or a socket.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor: int | None = descriptor

    def write(self, data: bytes) -> None:
        """Send all of `data`.

        Raises:
            OSError: If the line is closed.
        """
        while data:
            data = data[os.write(self._open, data) :]

    def read(self, timeout: float) -> bytes:
        """Return the bytes that have arrived; b"" if none do within `timeout` [s].

        Raises:
            OSError: If the line is closed, by either side.
        """
        ready, _, _ = select.select([self._open], [], [], timeout)
        if not ready:
            return b""
        data = os.read(self._open, _CHUNK)
        if not data:
            raise ConnectionResetError("the other side has closed the line")
        return data

    def drain(self, silence: float = 0.0) -> None:
        """Ignore bytes until none have arrived for a time [s].

        Raises:
            OSError: If the line is closed.
        """
        for _ in range(_LONGEST_NOISE):
            if not self.read(silence):
                return

    def close(self) -> None:
        """Close the line. A second call does nothing."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None

    @property
    def _open(self) -> int:
        if self._descriptor is None:
            raise ConnectionResetError("the line is closed")
        return self._descriptor


def open_line(port: str, baud: int) -> Line:
    """Open the line at a port.

    Args:
        port: `tcp:HOST:PORT`, or the path of a serial device or pseudo terminal.
        baud: Baud rate of a serial device [bit/s].

    Raises:
        ValueError: If `port` or `baud` is invalid.
        OSError: If the port cannot be opened.
    """
    if port.startswith("tcp:"):
        return Line(_connected(port))
    if not port.startswith("/"):
        raise ValueError(f"port: must be tcp:HOST:PORT or a device, got {port!r}")
    speed = getattr(termios, f"B{baud}", None)
    if speed is None:
        known = sorted(
            int(b[1:]) for b in dir(termios) if b[:1] == "B" and b[1:].isdecimal()
        )
        raise ValueError(f"baud: must be one of {known}, got {baud}")
    descriptor = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_CLOEXEC)
    try:
        tty.setraw(descriptor, termios.TCSANOW)
        mode = termios.tcgetattr(descriptor)
        mode[4] = mode[5] = speed
        mode[2] |= termios.CLOCAL | termios.CREAD
        termios.tcsetattr(descriptor, termios.TCSANOW, mode)
        termios.tcflush(descriptor, termios.TCIOFLUSH)
        _ask_for_low_latency(descriptor)
    except termios.error as error:
        os.close(descriptor)
        raise OSError(*error.args) from None
    except OSError:
        os.close(descriptor)
        raise
    return Line(descriptor)


def _ask_for_low_latency(descriptor: int) -> None:
    """Have a serial device pass on bytes as they arrive, if it can."""
    settings = array.array("i", [0] * _SERIAL)
    # Pseudo terminals cannot, and macOS does not know the request.
    with contextlib.suppress(OSError, AttributeError):
        fcntl.ioctl(descriptor, termios.TIOCGSERIAL, settings)
        settings[_FLAGS] |= _LOW_LATENCY
        fcntl.ioctl(descriptor, termios.TIOCSSERIAL, settings)


def _connected(port: str) -> int:
    """Return the descriptor of a socket that is connected to tcp:HOST:PORT."""
    host, _, number = port.removeprefix("tcp:").rpartition(":")
    if not host or not number.isdecimal() or not 0 < int(number) < 65536:
        raise ValueError(f"port: must be tcp:HOST:PORT or a device, got {port!r}")
    connection = socket.create_connection((host.strip("[]"), int(number)), _PATIENCE)
    connection.settimeout(None)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection.detach()


class BusError(Exception):
    """Communication with a servo has failed."""


class NoReplyError(BusError):
    """A servo does not reply, or only with noise."""


class RefusedByServoError(BusError):
    """A servo refuses an instruction."""


class ByteLine(Protocol):
    """The interface of a serial line for a master; see `Line`."""

    def write(self, data: bytes) -> None:
        """Send all bytes."""

    def read(self, timeout: float) -> bytes:
        """Return the bytes that arrive within a time [s], or b""."""

    def drain(self, silence: float = 0.0) -> None:
        """Ignore bytes until none have arrived for a time [s]."""

    def close(self) -> None:
        """Close the line."""


@dc.dataclass(frozen=True)
class Reply:
    """A servo's status packet.

    Attributes:
        values: Values of the requested registers, by name.
        fault: Faults that the servo reports; empty: none.
    """

    values: Mapping[str, int]
    fault: str


class ServoBus:
    """Reads and writes the registers of servos by name.

    A reply counts only if the exchange had no noise: every packet must be intact, from
    the right servos in their order, and with the right number of bytes. Otherwise the
    bus repeats the instruction. This does no harm, because all instructions that it
    uses are idempotent.

    A reply is never older than `timeout` times the number of tries. Open a new line
    after a `NoReplyError`, because a late reply may still be on its way.

    Args:
        protocol: Dynamixel protocol, 1 or 2.
        timeout: Longest silence before or within a reply [s].
        retries: How often an instruction is repeated.

    Raises:
        ValueError: If `protocol` is unknown.
    """

    def __init__(
        self,
        line: ByteLine,
        protocol: int = 1,
        timeout: float = 0.02,
        retries: int = 2,
    ) -> None:
        if protocol not in TABLES:
            raise ValueError(f"protocol: must be 1 or 2, got {protocol}")
        self.table = TABLES[protocol]
        self._line, self._timeout, self._retries = line, timeout, retries
        self._registers = {r.name: r for r in self.table.registers}

    def read_all(self, numbers: Sequence[int], *names: str) -> dict[int, Reply]:
        """Read the same registers of several servos at once; return replies by ID.

        Raises:
            BusError: If one of the servos does not reply, or refuses.
        """
        packet = self.table.packets.group_read(numbers, *self._block(names))
        return self._replies(packet, numbers, names)

    def write(self, number: int, name: str, value: int) -> None:
        """Write a register of a servo.

        Raises:
            BusError: If the servo does not reply, or refuses.
        """
        register = self._registers[name]
        to_bytes = self.table.packets.to_bytes
        data = to_bytes(register.address) + register.encode(value)
        packet = self._packet(number, Instruction.WRITE, data)
        self._exchange(packet, [(number, 0)])

    def sync_write(self, name: str, values: Mapping[int, int]) -> None:
        """Write a register of several servos, values by ID. They do not reply.

        Raises:
            OSError: If the line is closed.
        """
        register = self._registers[name]
        data = self.table.packets.to_bytes(register.address, register.size)
        for number, value in values.items():
            data += bytes([number]) + register.encode(value)
        self._line.write(self._packet(BROADCAST, Instruction.SYNC_WRITE, data).encode())

    def read_states(self, numbers: Sequence[int]) -> dict[int, ServoState]:
        """Return the states of several servos, by ID.

        Raises:
            BusError: If one of the servos does not reply, or refuses.
        """
        replies = self.read_all(numbers, *self.table.reads)
        return {
            k: self.table.state(reply.values, reply.fault)
            for k, reply in replies.items()
        }

    def close(self) -> None:
        """Close the line."""
        self._line.close()

    def _packet(self, number: int, code: Instruction, data: bytes = b"") -> Packet:
        return self.table.packets(number, code, data)

    def _block(self, names: Sequence[str]) -> tuple[int, int]:
        """Return address and size [bytes] of the block that holds these registers."""
        registers = [self._registers[name] for name in names]
        first = min(register.address for register in registers)
        return first, max(register.places.stop for register in registers) - first

    def _replies(
        self, packet: Packet, numbers: Sequence[int], names: Sequence[str]
    ) -> dict[int, Reply]:
        first, size = self._block(names)
        statuses = self._exchange(packet, [(number, size) for number in numbers])
        replies = {}
        for number, (fault, data) in zip(numbers, statuses, strict=True):
            values = {}
            for name in names:
                register = self._registers[name]
                start = register.address - first
                values[name] = register.decode(data[start : start + register.size])
            replies[number] = Reply(values, fault)
        return replies

    def _exchange(
        self, packet: Packet, expected: Sequence[tuple[int, int]]
    ) -> list[tuple[str, bytes]]:
        """Send an instruction and return fault and data of each reply.

        Args:
            packet: The instruction.
            expected: ID and number of data bytes of each reply, in their order.

        Raises:
            BusError: If a servo does not reply, or refuses.
        """
        for tried in range(1 + self._retries):
            self._line.drain(self._timeout if tried else 0.0)
            self._line.write(packet.encode())
            statuses = self._collect(expected)
            if statuses is not None:
                return statuses
        asked = ", ".join(str(number) for number, _ in expected)
        raise NoReplyError(
            f"servo {asked}: no intact reply within {1e3 * self._timeout:g} ms, tried "
            f"{1 + self._retries} times"
        )

    def _collect(
        self, expected: Sequence[tuple[int, int]]
    ) -> list[tuple[str, bytes]] | None:
        """Return fault and data of each reply; None if there was noise or silence.

        Raises:
            RefusedByServoError: If a servo refuses.
        """
        reader = PacketReader(self.table.packets)
        replies: list[Packet] = []
        while len(replies) < len(expected):
            data = self._line.read(self._timeout)
            replies += reader.feed(data, 0.0)
            if not data or reader.dropped:
                return None
        if len(replies) > len(expected) or reader.pending:
            return None
        statuses = []
        for reply, (number, size) in zip(replies, expected, strict=True):
            status = reply.status
            if status is None or reply.id != number:
                return None
            if status.refusal is Refusal.CHECKSUM:
                return None
            if status.refusal is not None:
                reason = status.refusal.name.lower()
                raise RefusedByServoError(f"servo {number}: refuses ({reason})")
            if len(status.data) != size:
                return None
            statuses.append((status.fault, status.data))
        return statuses
