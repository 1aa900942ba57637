"""Control tables: the registers of a servo, by name and by address.

Source: ROBOTIS's public e-manual (emanual.robotis.com: "MX-64", "MX-64(2.0)").
"""

from __future__ import annotations

import abc
import dataclasses as dc
import enum
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import ClassVar

from drake_srg.robot.serve.dynamixel.protocol import (
    Fault,
    Packet1,
    Packet2,
    Refusal,
    RefusedError,
)

TURN = 4096  # counts of a position per turn
VOLTAGE_UNIT = 0.1  # V, of limits and of the present voltage


@dc.dataclass(frozen=True)
class Register:
    """An entry of a control table.

    Attributes:
        address: Address of the first byte.
        name: The manual's name.
        size: Size in bytes: 1, 2 or 4.
        default: Value at power on.
        limits: Smallest and largest value that may be written; None if read only.
        signed: Whether the value is in two's complement.
        values: The only values that may be written; empty: all within the limits.
    """

    address: int
    name: str
    size: int
    default: int = 0
    limits: tuple[int, int] | None = None
    signed: bool = False
    values: tuple[int, ...] = ()

    @property
    def places(self) -> range:
        """Addresses of the register's bytes."""
        return range(self.address, self.address + self.size)

    def encode(self, value: int) -> bytes:
        """Return the bytes of a value.

        Raises:
            OverflowError: If the value does not fit.
        """
        return value.to_bytes(self.size, "little", signed=self.signed)

    def decode(self, data: bytes | bytearray) -> int:
        """Return the value of the register's bytes."""
        return int.from_bytes(data, "little", signed=self.signed)

    def check(self, value: int, where: str) -> None:
        """Check a value that was written.

        Raises:
            RefusedError: If the register cannot take the value.
        """
        if self.limits is None:
            raise RefusedError(Refusal.ACCESS, f"{where}: {self.name} is read only")
        low, high = self.limits
        if not low <= value <= high or (self.values and value not in self.values):
            allowed = ", ".join(map(str, self.values)) or f"{low} to {high}"
            raise RefusedError(
                Refusal.RANGE, f"{where}: {self.name} must be {allowed}, got {value}"
            )


@dc.dataclass(frozen=True)
class ServoState:
    """A servo's state. Velocity and load are positive if they raise the position.

    Attributes:
        torque: Whether the torque is on.
        marked: Whether the LED is on; a reboot turns it off.
        position: Position [counts].
        velocity: Velocity [rad/s].
        load: The servo's estimate of its torque, as a fraction of the stall torque.
        fault: Faults of the servo; empty: none.
    """

    torque: bool
    marked: bool
    position: int
    velocity: float
    load: float
    fault: str


class ControlTable(abc.ABC):
    """The registers of a servo, as numbers by name, and as bytes for masters.

    Attributes:
        packets: Class of the protocol's packets.
        registers: All registers, in the order of their addresses.
        ram: First address of the RAM. Registers below are in the EEPROM.
        size: Size of the table [bytes].
        identity: Registers in the reply to a ping.
        reads: Registers with a servo's state; see `state`.
        effort: Register that limits the torque.
        full_effort: Value of `effort` for the full torque.
        current_unit: Unit of currents in registers [A].
    """

    packets: ClassVar[type[Packet1] | type[Packet2]]
    registers: ClassVar[Sequence[Register]]
    ram: ClassVar[int]
    size: ClassVar[int]
    identity: ClassVar[Sequence[str]] = ()
    reads: ClassVar[Sequence[str]]
    effort: ClassVar[str]
    full_effort: ClassVar[int]
    current_unit: ClassVar[float]

    def __init__(self) -> None:
        self._bytes = bytearray(self.size)
        self._by_name = {register.name: register for register in self.registers}
        self._at = {place: r for r in self.registers for place in r.places}
        self.reset(self._by_name)

    def __getitem__(self, name: str) -> int:
        register = self._by_name[name]
        end = register.address + register.size
        return register.decode(self._bytes[register.address : end])

    def __setitem__(self, name: str, value: int) -> None:
        register = self._by_name[name]
        value &= (1 << 8 * register.size) - 1
        end = register.address + register.size
        self._bytes[register.address : end] = value.to_bytes(register.size, "little")

    def register(self, name: str) -> Register:
        """Return the register with a name."""
        return self._by_name[name]

    def reset(self, names: Iterable[str]) -> None:
        """Give registers their values at power on."""
        for name in names:
            self[name] = self._by_name[name].default

    def read(self, address: int, length: int) -> bytes:
        """Return bytes of the table, including those between registers.

        Raises:
            RefusedError: If the range exceeds the table.
        """
        if address + length > self.size:
            raise RefusedError(
                Refusal.ACCESS,
                f"cannot read {length} bytes at {address}: the table has {self.size} "
                "bytes",
            )
        return bytes(self._bytes[place] for place in self._places(address, length))

    def write(self, address: int, data: bytes) -> set[str]:
        """Write all bytes or none, and return the names of the registers written.

        Raises:
            RefusedError: If a register is missing or read only, or a value is invalid.
        """
        where = f"cannot write {data.hex(' ')} at {address}"
        if not data or address + len(data) > self.size:
            raise RefusedError(Refusal.ACCESS, f"{where}: no register there")
        places = self._places(address, len(data))
        touched = {
            self._at[place].name: self._at[place]
            for place in places
            if place in self._at
        }
        self._check_places(places, touched.values(), where)
        if self.locked and min(places) < self.ram:
            raise RefusedError(Refusal.ACCESS, f"{where}: the EEPROM is locked")
        before = self._bytes.copy()
        for place, byte in zip(places, data, strict=True):
            self._bytes[place] = byte
        try:
            for name, register in touched.items():
                register.check(self[name], where)
            self._check_limits(touched.keys(), where)
        except RefusedError:
            self._bytes = before
            raise
        return set(touched)

    @classmethod
    @abc.abstractmethod
    def state(cls, values: Mapping[str, int], fault: str) -> ServoState:
        """Return the state from values of `reads`, and the fault of a `Status`."""

    @property
    @abc.abstractmethod
    def locked(self) -> bool:
        """Whether the EEPROM is locked."""

    def _places(self, address: int, length: int) -> Sequence[int]:
        """Return the addresses at which the bytes of a range are stored."""
        return range(address, address + length)

    @abc.abstractmethod
    def _check_places(
        self, places: Sequence[int], touched: Collection[Register], where: str
    ) -> None:
        """Check that these addresses may be written at once.

        Raises:
            RefusedError: If they may not.
        """

    @abc.abstractmethod
    def _check_limits(self, written: Collection[str], where: str) -> None:
        """Check registers that were written against the limits in other registers.

        Raises:
            RefusedError: If a value exceeds a limit.
        """

    def _check_goal(
        self, name: str, low: int, high: int, written: Collection[str], where: str
    ) -> None:
        if name in written and not low <= self[name] <= high:
            raise RefusedError(
                Refusal.LIMIT,
                f"{where}: {name} must be {low} to {high}, got {self[name]}",
            )


# Units of the MX-64 with Protocol 1.0.
SPEED_UNIT = 0.114 * math.tau / 60  # rad/s
FULL_TORQUE = 1023  # torque limit or load of 100 %: the stall torque
CLOCKWISE = 1024  # direction bit of speeds, loads and torques


class ControlTable1(ControlTable):
    """The registers of an MX-64 with Protocol 1.0."""

    packets: ClassVar[type[Packet1]] = Packet1
    registers: ClassVar[Sequence[Register]] = (
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
    ram: ClassVar[int] = 24
    size: ClassVar[int] = 74
    reads: ClassVar[Sequence[str]] = (
        *("torque_enable", "led"),
        *("present_position", "present_speed", "present_load"),
    )
    effort: ClassVar[str] = "torque_limit"
    full_effort: ClassVar[int] = FULL_TORQUE
    current_unit: ClassVar[float] = 4.5e-3

    @classmethod
    def state(cls, values: Mapping[str, int], fault: str) -> ServoState:
        """Return the state from values of `reads`, and the fault of a `Status`."""
        return ServoState(
            torque=bool(values["torque_enable"]),
            marked=bool(values["led"]),
            position=values["present_position"],
            velocity=-decode_directed(values["present_speed"]) * SPEED_UNIT,
            load=-decode_directed(values["present_load"]) / FULL_TORQUE,
            fault=fault,
        )

    @property
    def multi_turn(self) -> bool:
        """Whether positions count turns: both angle limits are 4095."""
        return self["cw_angle_limit"] == self["ccw_angle_limit"] == 4095

    @property
    def locked(self) -> bool:
        """Whether the EEPROM is locked."""
        return bool(self["lock"])

    def _check_places(
        self, places: Sequence[int], touched: Collection[Register], where: str
    ) -> None:
        if not touched:
            raise RefusedError(Refusal.ACCESS, f"{where}: no register there")

    def _check_limits(self, written: Collection[str], where: str) -> None:
        low, high = self["cw_angle_limit"], self["ccw_angle_limit"]
        if low == high == 0:
            raise RefusedError(
                Refusal.RANGE, f"{where}: a gripper does not support endless turning"
            )
        if not self.multi_turn:
            self._check_goal("goal_position", low, high, written, where)


def encode_directed(value: float) -> int:
    """Encode a value as size and direction bit; positive is clockwise."""
    size = min(abs(round(value)), FULL_TORQUE)
    return size | CLOCKWISE if size and value > 0 else size


def decode_directed(value: int) -> int:
    """Return the value of a number from `encode_directed`; positive is clockwise."""
    size = value & FULL_TORQUE
    return size if value & CLOCKWISE else -size


# Units of the MX-64 with Protocol 2.0.
VELOCITY_UNIT = 0.229 * math.tau / 60  # rad/s
ACCELERATION_UNIT = 214.577 * math.tau / 60**2  # rad/s²
FULL_PWM = 885  # 100 %

_POSITIONS = (1 - 256 * TURN, 256 * TURN - 1)
# Position control of a single turn ignores larger offsets.
_SINGLE_TURN_OFFSET = 1024


class Mode(enum.IntEnum):
    """Operating modes."""

    CURRENT = 0
    VELOCITY = 1
    POSITION = 3
    EXTENDED_POSITION = 4
    CURRENT_BASED_POSITION = 5
    PWM = 16


# Registers that move the motor in modes other than the position modes.
_GOALS = {
    Mode.CURRENT: "goal_current",
    Mode.VELOCITY: "goal_velocity",
    Mode.PWM: "goal_pwm",
}


class DriveMode(enum.IntFlag):
    """Bits of the drive mode."""

    REVERSE = 1
    TIME_BASED = 4


def _indirect(first: int, address: int, data: int) -> list[Register]:
    """Return registers of 28 indirect addresses, from number `first`, and data."""
    addresses, values = [], []
    for n, place in enumerate(range(data, data + 28), start=first):
        where = address + 2 * (place - data)
        addresses.append(Register(where, f"indirect_address_{n}", 2, place, (64, 661)))
        values.append(Register(place, f"indirect_data_{n}", 1, 0, (0, 255)))
    return addresses + values


class ControlTable2(ControlTable):
    """The registers of an MX-64 with Protocol 2.0."""

    packets: ClassVar[type[Packet2]] = Packet2
    registers: ClassVar[Sequence[Register]] = (
        # EEPROM
        Register(0, "model_number", 2, 311),
        Register(2, "model_information", 4),
        Register(6, "firmware_version", 1, 45),
        Register(7, "id", 1, 1, (0, 252)),
        Register(8, "baud_rate", 1, 1, (0, 7)),
        Register(9, "return_delay_time", 1, 250, (0, 254)),
        Register(10, "drive_mode", 1, 0, (0, 5), values=(0, 1, 4, 5)),
        Register(11, "operating_mode", 1, 3, (0, 16), values=tuple(map(int, Mode))),
        Register(12, "secondary_id", 1, 255, (0, 255)),
        Register(13, "protocol_version", 1, 2, (2, 2)),
        Register(20, "homing_offset", 4, 0, (-1044479, 1044479), signed=True),
        Register(24, "moving_threshold", 4, 10, (0, 1023)),
        Register(31, "temperature_limit", 1, 80, (0, 100)),
        Register(32, "max_voltage_limit", 2, 160, (95, 160)),
        Register(34, "min_voltage_limit", 2, 95, (95, 160)),
        Register(36, "pwm_limit", 2, 885, (0, 885)),
        Register(38, "current_limit", 2, 1941, (0, 1941)),
        Register(40, "acceleration_limit", 4, 32767, (0, 32767)),
        Register(44, "velocity_limit", 4, 435, (0, 1023)),
        Register(48, "max_position_limit", 4, 4095, (0, 4095)),
        Register(52, "min_position_limit", 4, 0, (0, 4095)),
        Register(63, "shutdown", 1, 52, (0, 255)),
        # RAM
        Register(64, "torque_enable", 1, 0, (0, 1)),
        Register(65, "led", 1, 0, (0, 1)),
        Register(68, "status_return_level", 1, 2, (0, 2)),
        Register(69, "registered", 1),
        Register(70, "hardware_error_status", 1),
        Register(76, "velocity_i_gain", 2, 1920, (0, 16383)),
        Register(78, "velocity_p_gain", 2, 100, (0, 16383)),
        Register(80, "position_d_gain", 2, 0, (0, 16383)),
        Register(82, "position_i_gain", 2, 0, (0, 16383)),
        Register(84, "position_p_gain", 2, 850, (0, 16383)),
        Register(88, "feedforward_2nd_gain", 2, 0, (0, 16383)),
        Register(90, "feedforward_1st_gain", 2, 0, (0, 16383)),
        Register(98, "bus_watchdog", 1, 0, (0, 127), signed=True),
        Register(100, "goal_pwm", 2, 885, (-885, 885), signed=True),
        Register(102, "goal_current", 2, 1941, (-1941, 1941), signed=True),
        Register(104, "goal_velocity", 4, 0, (-1023, 1023), signed=True),
        Register(108, "profile_acceleration", 4, 0, (0, 32767)),
        Register(112, "profile_velocity", 4, 0, (0, 32767)),
        Register(116, "goal_position", 4, 0, _POSITIONS, signed=True),
        Register(120, "realtime_tick", 2),
        Register(122, "moving", 1),
        Register(123, "moving_status", 1),
        Register(124, "present_pwm", 2, signed=True),
        Register(126, "present_current", 2, signed=True),
        Register(128, "present_velocity", 4, signed=True),
        Register(132, "present_position", 4, signed=True),
        Register(136, "velocity_trajectory", 4, signed=True),
        Register(140, "position_trajectory", 4, signed=True),
        Register(144, "present_voltage", 2, 120),
        Register(146, "present_temperature", 1, 25),
        *_indirect(1, 168, 224),
        *_indirect(29, 578, 634),
    )
    ram: ClassVar[int] = 64
    size: ClassVar[int] = 662
    identity: ClassVar[Sequence[str]] = ("model_number", "firmware_version")
    reads: ClassVar[Sequence[str]] = (
        *("torque_enable", "led", "hardware_error_status"),
        *("present_position", "present_velocity", "present_pwm"),
    )
    effort: ClassVar[str] = "goal_pwm"
    full_effort: ClassVar[int] = FULL_PWM
    current_unit: ClassVar[float] = 3.36e-3

    @classmethod
    def state(cls, values: Mapping[str, int], fault: str) -> ServoState:
        """Return the state from values of `reads`, and the fault of a `Status`."""
        return ServoState(
            torque=bool(values["torque_enable"]),
            marked=bool(values["led"]),
            position=values["present_position"],
            velocity=values["present_velocity"] * VELOCITY_UNIT,
            load=values["present_pwm"] / FULL_PWM,
            fault=str(Fault(values["hardware_error_status"])) or fault,
        )

    @property
    def mode(self) -> Mode:
        """The operating mode."""
        return Mode(self["operating_mode"])

    @property
    def offset(self) -> int:
        """The effective homing offset [counts]."""
        offset = self["homing_offset"]
        ignored = self.mode is Mode.POSITION and abs(offset) > _SINGLE_TURN_OFFSET
        return 0 if ignored else offset

    @property
    def locked(self) -> bool:
        """Whether the EEPROM is locked."""
        return bool(self["torque_enable"])

    @property
    def reverse(self) -> bool:
        """Whether the drive mode reverses the direction of rotation."""
        return bool(self["drive_mode"] & DriveMode.REVERSE)

    @property
    def direction(self) -> int:
        """Sign of velocities, currents and PWM that wind the spool."""
        return 1 if self.reverse else -1

    @property
    def goal(self) -> str:
        """Name of the register that moves the motor in this operating mode."""
        return _GOALS.get(self.mode, "goal_position")

    def stop(self) -> None:
        """Set the goal position to the present one, or the goal of other modes to 0."""
        here = self["present_position"] if self.goal == "goal_position" else 0
        self[self.goal] = here

    def reset_goals(self) -> None:
        """Set goals and profile as after a change of the operating mode.

        According to the manual, goal PWM and goal current go to their limits in all
        modes. Here, the goal that moves the motor becomes 0 instead: otherwise the
        motor would move at full force.
        """
        for what in ("pwm", "current"):
            self[f"goal_{what}"] = self[f"{what}_limit"]
        self.reset(("goal_velocity", "profile_velocity", "profile_acceleration"))
        self.stop()

    def limit_goals(self) -> None:
        """Keep the goals within limits that have changed."""
        for what in ("pwm", "current", "velocity"):
            goal, limit = self[f"goal_{what}"], self[f"{what}_limit"]
            self[f"goal_{what}"] = min(max(goal, -limit), limit)

    def profile(self, way: float) -> tuple[float, float]:
        """Return velocity [rad/s] and acceleration [rad/s²] for a distance [rad]."""
        velocity, ramp = self["profile_velocity"], self["profile_acceleration"]
        if velocity == 0 or way == 0.0:  # no profile, or no motion
            return math.inf, math.inf
        if self["drive_mode"] & DriveMode.TIME_BASED:
            duration = velocity * 1e-3
            rising = min(ramp * 1e-3, duration / 2)
            speed = abs(way) / (duration - rising)
            return speed, speed / rising if rising else math.inf
        return min(velocity, self["velocity_limit"]) * VELOCITY_UNIT, self.ramp(0.0)

    def ramp(self, change: float) -> float:
        """Return the acceleration [rad/s²] for a change of the velocity [rad/s]."""
        ramp = self["profile_acceleration"]
        if ramp == 0:
            return math.inf
        if self["drive_mode"] & DriveMode.TIME_BASED:
            return abs(change) / (ramp * 1e-3)
        return min(ramp, self["acceleration_limit"]) * ACCELERATION_UNIT

    def _places(self, address: int, length: int) -> Sequence[int]:
        return [self._place(place) for place in range(address, address + length)]

    def _place(self, address: int) -> int:
        """Return the address that an indirect data address refers to, or itself."""
        register = self._at.get(address)
        if register is None or not register.name.startswith("indirect_data_"):
            return address
        return self[register.name.replace("data", "address")]

    def _check_places(
        self, places: Sequence[int], touched: Collection[Register], where: str
    ) -> None:
        if not all(place in self._at for place in places):
            raise RefusedError(Refusal.ACCESS, f"{where}: no register there")
        for register in touched:
            if not set(register.places) <= set(places):
                raise RefusedError(
                    Refusal.LENGTH,
                    f"{where}: {register.name} has {register.size} bytes",
                )

    def _check_limits(self, written: Collection[str], where: str) -> None:
        goals = {"goal_pwm", "goal_current", "goal_velocity", "goal_position"}
        if self["bus_watchdog"] < 0 and goals & set(written):
            raise RefusedError(
                Refusal.RANGE, f"{where}: the bus watchdog has triggered"
            )
        for what in ("pwm", "current", "velocity"):
            limit = self[f"{what}_limit"]
            self._check_goal(f"goal_{what}", -limit, limit, written, where)
        if self.mode is Mode.POSITION:
            low, high = self["min_position_limit"], self["max_position_limit"]
            self._check_goal("goal_position", low, high, written, where)


# Registers by protocol.
TABLES: Mapping[int, type[ControlTable]] = {1: ControlTable1, 2: ControlTable2}
