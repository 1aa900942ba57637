"""Dynamixel Protocol 1.0: packets, and the registers of an MX-64.

From ROBOTIS's public e-manual (emanual.robotis.com: "Protocol 1.0", "MX-64").
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
    """What a packet asks for."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    SYNC_WRITE = 0x83
    BULK_READ = 0x92


class Error(enum.IntFlag):
    """What a status packet complains of."""

    VOLTAGE = 1
    ANGLE_LIMIT = 2
    OVERHEATING = 4
    RANGE = 8
    CHECKSUM = 16
    OVERLOAD = 32
    INSTRUCTION = 64


class RefusedError(Exception):
    """An instruction that is not carried out.

    Attributes:
        error: For the status packet.
    """

    def __init__(self, error: Error, reason: str):
        super().__init__(reason)
        self.error = error


@dc.dataclass(frozen=True)
class Packet:
    """An instruction, or with its error as `code`, a status packet."""

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
    """Finds packets in a stream of bytes, however it is cut and whatever is between.

    What is not complete within `patience` is dropped: half a packet must not take in
    the next one. It keeps less than one packet, 259 bytes.

    Args:
        patience: Longest pause within a packet [s]; masters wait 0.2 s for a reply
            before they send it again.

    Attributes:
        dropped: Bytes, so far, that belonged to no packet.
    """

    def __init__(self, patience: float = 0.1):
        self.dropped = 0
        self._patience = patience
        self._buffer = bytearray()
        self._last = -float("inf")

    def feed(self, data: bytes, time: float) -> Iterator[Packet]:
        """Yield the packets that are complete with `data`, which came at a time [s]."""
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
            if buffer[2] == 0xFF or buffer[3] < 2:  # no ID, no length
                self._drop(1)
                continue
            end = 4 + buffer[3]
            if len(buffer) < end:
                return None
            body, checksum = bytes(buffer[2 : end - 1]), buffer[end - 1]
            packet = Packet(body[0], body[2], body[3:], _checksum(body) == checksum)
            if packet.intact:
                del buffer[:end]
            else:  # a packet may begin within what is none
                self._drop(len(_HEADER))
            return packet

    def _drop(self, count: int) -> None:
        self.dropped += count
        del self._buffer[:count]


@dc.dataclass(frozen=True)
class Register:
    """A number in the control table.

    Attributes:
        address: Of its first byte.
        name: As in the manual.
        size: In bytes, 1 or 2.
        default: Value at power on.
        limits: Smallest and largest value that may be written; None: read only.
        signed: Whether it is in two's complement.
    """

    address: int
    name: str
    size: int
    default: int = 0
    limits: tuple[int, int] | None = None
    signed: bool = False


REGISTERS = (
    # EEPROM
    Register(0, "model_number", 2, 310),
    Register(2, "firmware_version", 1, 41),
    Register(3, "id", 1, 1, (0, 252)),
    Register(4, "baud_rate", 1, 34, (0, 254)),
    Register(5, "return_delay_time", 1, 250, (0, 254)),
    Register(6, "cw_angle_limit", 2, 0, (0, 4095)),
    Register(8, "ccw_angle_limit", 2, 4095, (0, 4095)),
    Register(11, "temperature_limit", 1, 80, (0, 99)),
    Register(12, "min_voltage_limit", 1, 60, (50, 250)),
    Register(13, "max_voltage_limit", 1, 240, (50, 250)),
    Register(14, "max_torque", 2, 1023, (0, 1023)),
    Register(16, "status_return_level", 1, 2, (0, 2)),
    Register(17, "alarm_led", 1, 36, (0, 127)),
    Register(18, "shutdown", 1, 36, (0, 127)),
    Register(20, "multi_turn_offset", 2, 0, (-24576, 24576), signed=True),
    Register(22, "resolution_divider", 1, 1, (1, 4)),
    # RAM
    Register(24, "torque_enable", 1, 0, (0, 1)),
    Register(25, "led", 1, 0, (0, 1)),
    Register(26, "d_gain", 1, 0, (0, 254)),
    Register(27, "i_gain", 1, 0, (0, 254)),
    Register(28, "p_gain", 1, 32, (0, 254)),
    Register(30, "goal_position", 2, 0, (-28672, 28672), signed=True),
    Register(32, "moving_speed", 2, 0, (0, 1023)),
    Register(34, "torque_limit", 2, 1023, (0, 1023)),
    Register(36, "present_position", 2, signed=True),
    Register(38, "present_speed", 2),
    Register(40, "present_load", 2),
    Register(42, "present_voltage", 1, 120),
    Register(43, "present_temperature", 1, 25),
    Register(44, "registered", 1),
    Register(46, "moving", 1),
    Register(47, "lock", 1, 0, (0, 1)),
    Register(48, "punch", 2, 0, (0, 1023)),
    Register(50, "realtime_tick", 2),
    Register(68, "current", 2, 2048),
    Register(70, "torque_control_mode", 1, 0, (0, 1)),
    Register(71, "goal_torque", 2, 0, (0, 2047)),
    Register(73, "goal_acceleration", 1, 0, (0, 254)),
)
_RAM = 24
_SIZE = 74
_BY_NAME = {register.name: register for register in REGISTERS}


class ControlTable:
    """The registers, as numbers by name and as the bytes that masters see."""

    def __init__(self) -> None:
        self._bytes = bytearray(_SIZE)
        for register in REGISTERS:
            self[register.name] = register.default

    def __getitem__(self, name: str) -> int:
        register = _BY_NAME[name]
        data = self._bytes[register.address : register.address + register.size]
        return int.from_bytes(data, "little", signed=register.signed)

    def __setitem__(self, name: str, value: int) -> None:
        register = _BY_NAME[name]
        value &= (1 << 8 * register.size) - 1
        end = register.address + register.size
        self._bytes[register.address : end] = value.to_bytes(register.size, "little")

    @property
    def multi_turn(self) -> bool:
        """Whether positions count turns: both angle limits are 4095."""
        return self["cw_angle_limit"] == self["ccw_angle_limit"] == 4095

    def read(self, address: int, length: int) -> bytes:
        """Return bytes of the table, also those of no register.

        Raises:
            RefusedError: If the table ends before.
        """
        if address + length > _SIZE:
            raise RefusedError(
                Error.RANGE, f"reads {length} bytes at {address}, the table has {_SIZE}"
            )
        return bytes(self._bytes[address : address + length])

    def write(self, address: int, data: bytes) -> set[str]:
        """Write bytes, all or none, and return the names of their registers.

        Raises:
            RefusedError: If one is not to be written, or not that.
        """
        end = address + len(data)
        touched = [
            r for r in REGISTERS if r.address < end and address < r.address + r.size
        ]
        where = f"writes {data.hex(' ')} at {address}"
        if not touched or end > _SIZE:
            raise RefusedError(Error.RANGE, f"{where}, where nothing is")
        if address < _RAM and self["lock"]:
            raise RefusedError(Error.RANGE, f"{where}, the EEPROM is locked")
        before = self._bytes.copy()
        self._bytes[address:end] = data
        try:
            for register in touched:
                self._check(register, where)
            self._check_angles(touched, where)
        except RefusedError:
            self._bytes = before
            raise
        return {register.name for register in touched}

    def _check(self, register: Register, where: str) -> None:
        name, value = register.name, self[register.name]
        if register.limits is None:
            raise RefusedError(Error.RANGE, f"{where}: {name} is read only")
        low, high = register.limits
        if not low <= value <= high:
            raise RefusedError(
                Error.RANGE, f"{where}: {name} {value}; allowed are {low} to {high}"
            )

    def _check_angles(self, written: list[Register], where: str) -> None:
        low, high = self["cw_angle_limit"], self["ccw_angle_limit"]
        if low == high == 0:
            raise RefusedError(
                Error.RANGE, f"{where}: endless turning is not for a gripper"
            )
        goal = self["goal_position"]
        limited = _BY_NAME["goal_position"] in written and not self.multi_turn
        if limited and not low <= goal <= high:
            raise RefusedError(
                Error.ANGLE_LIMIT,
                f"{where}: goal_position {goal}; allowed are {low} to {high}",
            )
