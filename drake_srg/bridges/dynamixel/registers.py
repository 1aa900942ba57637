"""The control table of a Dynamixel MX-64.

Source: ROBOTIS's public e-manual (emanual.robotis.com: "MX-64").
"""

from __future__ import annotations

import dataclasses as dc
import math

from drake_srg.bridges.dynamixel.protocol import Error, RefusedError

# Units.
SPEED_UNIT = 0.114 * math.tau / 60  # rad/s
CURRENT_UNIT = 4.5e-3  # A
VOLTAGE_UNIT = 0.1  # V
FULL_TORQUE = 1023  # torque limit or load of 100 %, which is the stall torque
CLOCKWISE = 1024  # direction bit of speeds, loads and torques


@dc.dataclass(frozen=True)
class Register:
    """An entry of the control table.

    Attributes:
        address: Address of the first byte.
        name: The manual's name.
        size: Size in bytes, 1 or 2.
        default: Value at power on.
        limits: Smallest and largest value that may be written; None if read only.
        signed: Whether the value is in two's complement.
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
    """The registers, as numbers by name and as the bytes that masters read."""

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
        """Return bytes of the table, including those between registers.

        Raises:
            RefusedError: If the range exceeds the table.
        """
        if address + length > _SIZE:
            raise RefusedError(
                Error.RANGE,
                f"cannot read {length} bytes at {address}: the table has {_SIZE} bytes",
            )
        return bytes(self._bytes[address : address + length])

    def write(self, address: int, data: bytes) -> set[str]:
        """Write all bytes or none, and return the names of the registers written.

        Raises:
            RefusedError: If a register is missing or read only, or a value is invalid.
        """
        end = address + len(data)
        touched = [
            r for r in REGISTERS if r.address < end and address < r.address + r.size
        ]
        where = f"cannot write {data.hex(' ')} at {address}"
        if not touched or end > _SIZE:
            raise RefusedError(Error.RANGE, f"{where}: no register there")
        if address < _RAM and self["lock"]:
            raise RefusedError(Error.RANGE, f"{where}: the EEPROM is locked")
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
                Error.RANGE, f"{where}: {name} must be {low} to {high}, got {value}"
            )

    def _check_angles(self, written: list[Register], where: str) -> None:
        low, high = self["cw_angle_limit"], self["ccw_angle_limit"]
        if low == high == 0:
            raise RefusedError(
                Error.RANGE, f"{where}: a gripper does not support endless turning"
            )
        goal = self["goal_position"]
        limited = _BY_NAME["goal_position"] in written and not self.multi_turn
        if limited and not low <= goal <= high:
            raise RefusedError(
                Error.ANGLE_LIMIT,
                f"{where}: goal_position must be {low} to {high}, got {goal}",
            )


def encode_directed(value: float) -> int:
    """Encode a value as size and direction; positive winds, which is clockwise."""
    size = min(abs(round(value)), FULL_TORQUE)
    return size | CLOCKWISE if size and value > 0 else size
