"""What a Dynamixel MX-64 does with its registers, its motor simulated elsewhere."""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Callable

from drake_srg.bridges.dynamixel.protocol import (
    BROADCAST,
    ControlTable,
    Error,
    Instruction,
    Packet,
    RefusedError,
)
from drake_srg.gripper.motor_temperature import MotorTemperatureConfig, motor_load
from drake_srg.gripper.tendon import TendonDriveConfig

_COUNTS = 4096 / math.tau  # of the encoder, per rad
# Position with the fingers open and the wires taut: 2500 counts from there, clockwise
# and so downwards, are the middle of a turn. SAKE's 100 % are 2500 counts, 29.1 mm of
# wire, about what a finger takes over all of the range of both its joints (28.8 mm
# here). Calibrated on nothing, the fingers end where their pads meet: after 19.7 mm,
# and up to 1.7 mm more that the wires stretch under 43 N, which goes back while the
# zero is read. That is then at 1456 to 1537, the fingers fully open at 70 to 74 %.
_OPEN = 3298
# Units, e-manual.
_SPEED = 0.114 * math.tau / 60  # rad/s
_CURRENT = 4.5e-3  # A
_VOLTAGE = 0.1  # V
_FULL = 1023  # a torque limit or load of 100 %: the stall torque
_CLOCKWISE = 1024  # bit of speeds, loads and torques

# A servo is overloaded when "persistent load exceeds maximum output" (e-manual): when
# its output is at the torque limit, and above what ROBOTIS recommends for long, a fifth
# of the stall torque, for this time. A user saw an MX-64 shut down after 10 s with 4 A,
# 20 s with 2 A, and not with 1 A (forum.robotis.com, "Moment of dynamixel").
_OVERLOAD_TIME = 10.0  # s
_SUSTAINED = _FULL // 5

_WRITING = (Instruction.WRITE, Instruction.REG_WRITE, Instruction.SYNC_WRITE)


@dc.dataclass(frozen=True)
class MotorCommand:
    """What the servo wants of its motor.

    Attributes:
        position: Spool angle [rad], NaN where `torque` applies.
        torque: Fraction of full PWM's torque, positive to wind; NaN where `position`
            applies.
        limit: kappa, fraction of full PWM, 0 .. 1.
    """

    position: float
    torque: float
    limit: float

    def same(self, other: MotorCommand | None) -> bool:
        """Whether both say the same; NaN is NaN."""
        return repr(self) == repr(other)


class Mx64:
    """The servo: answers packets, reads its motor, commands it.

    Until something is written that moves the motor (goal position, torque enable,
    torque control mode) it has no command. From then on, with torque control mode:
    the goal torque; without, and with torque enabled: the goal position, approached
    with the moving speed; else no torque at all. The torque limit counts in 1/1023 of
    the stall torque; beyond `drive.full_scale` it allows no more than that.

    The motor may be taken from it, see `release`: then it commands nothing, and does
    not look at the load, until it is written again that the motor moves.

    Clockwise, positions fall and the gripper closes. PID gains, punch, goal
    acceleration, baud rate, return delay and LEDs are kept and do nothing; factory
    reset and endless turning are refused.

    Args:
        drive: The motor.
        heat: Its currents and its supply.
        warn: Called with a kind and words on what is refused, and of shutdowns.

    Attributes:
        table: The registers.
        writes: Packets for it that would write, good and bad, so far.
    """

    def __init__(
        self,
        drive: TendonDriveConfig,
        heat: MotorTemperatureConfig,
        warn: Callable[[str, str], None],
    ):
        self.table = ControlTable()
        self.table["present_voltage"] = min(round(heat.supply_voltage / _VOLTAGE), 255)
        self.writes = 0
        self._drive, self._heat = drive, heat
        self._warn = warn
        self._registered: tuple[int, bytes] | None = None
        self._engaged = False  # whether a master has moved the motor
        self._overload = False
        self._time = self._unloaded_at = 0.0
        self._target = 0.0  # angle that the profile of the moving speed has reached

    # The motor.

    def sense(
        self, time: float, angle: float, speed: float, pwm: float, temperature: float
    ) -> None:
        """Take what the motor does at a time [s].

        Args:
            time: Simulated time.
            angle: Of the spool [rad].
            speed: Of the spool [rad/s].
            pwm: Fraction of full scale.
            temperature: In degrees Celsius.
        """
        table, drive = self.table, self._drive
        step, self._time = max(time - self._time, 0.0), time
        amperes = motor_load(drive, pwm, speed) * self._heat.stall_current
        table["present_position"] = self._position(angle)
        table["present_speed"] = _directed(speed / _SPEED)
        table["present_load"] = load = _directed(drive.full_scale * pwm * _FULL)
        table["present_temperature"] = min(max(round(temperature), 0), 255)
        table["current"] = min(max(2048 - round(amperes / _CURRENT), 0), 4095)
        table["moving"] = int(table["present_speed"] != 0)
        table["realtime_tick"] = int(time * 1000) % 32768
        self._protect(load & ~_CLOCKWISE if self._engaged else 0)
        if not (self._positioning and self._engaged):
            self._target = angle
            if not table["torque_enable"]:
                table["goal_position"] = table["present_position"]
        else:
            distance = self._goal_angle() - self._target
            if allowed := table["moving_speed"] * _SPEED:  # 0: as fast as it can
                distance = math.copysign(min(abs(distance), allowed * step), distance)
            self._target += distance

    def command(self) -> MotorCommand | None:
        """Return what the motor has to do; None: the servo does not care."""
        if not self._engaged:
            return None
        table, full = self.table, self._drive.full_scale
        limit = min(table["torque_limit"] / _FULL / full, 1.0)
        if self._positioning:
            target = self._target if table["moving_speed"] else self._goal_angle()
            return MotorCommand(target, math.nan, limit)
        torque = 0.0
        if table["torque_control_mode"]:
            goal = table["goal_torque"]
            sign = 1.0 if goal & _CLOCKWISE else -1.0
            amperes = (goal & ~_CLOCKWISE) * _CURRENT
            torque = sign * amperes / self._heat.stall_current / full
        return MotorCommand(math.nan, torque, limit)

    def release(self) -> None:
        """Leave the motor to somebody else."""
        self._engaged = False

    @property
    def _positioning(self) -> bool:
        table = self.table
        return bool(table["torque_enable"] and not table["torque_control_mode"])

    def _position(self, angle: float) -> int:
        counts = _OPEN - angle * _COUNTS
        table = self.table
        if table.multi_turn:
            return (
                round(counts / table["resolution_divider"]) + table["multi_turn_offset"]
            )
        return round(counts) % 4096

    def _goal_angle(self) -> float:
        table, counts = self.table, self.table["goal_position"]
        if table.multi_turn:
            counts = (counts - table["multi_turn_offset"]) * table["resolution_divider"]
        return (_OPEN - counts) / _COUNTS

    def _protect(self, load: int) -> None:
        """Shut down where load or temperature ask for it."""
        table = self.table
        available = min(table["torque_limit"], round(self._drive.full_scale * _FULL))
        if load < max(available, _SUSTAINED + 1):
            self._unloaded_at = self._time
        elif self._time - self._unloaded_at > _OVERLOAD_TIME:
            self._overload = True
        if errors := self._errors & table["shutdown"]:
            if table["torque_limit"]:
                kind = _words(errors)
                self._warn(kind, f"{kind}; off until a torque limit is written")
            table["torque_limit"] = table["torque_enable"] = 0

    @property
    def _errors(self) -> Error:
        """What is wrong with the servo itself."""
        table, errors = self.table, Error(0)
        low, high = table["min_voltage_limit"], table["max_voltage_limit"]
        if not low <= table["present_voltage"] <= high:
            errors |= Error.VOLTAGE
        if table["present_temperature"] > table["temperature_limit"]:
            errors |= Error.OVERHEATING
        return errors | Error.OVERLOAD if self._overload else errors

    # Packets.

    def answer(self, packet: Packet) -> bytes:
        """Carry out an instruction; return the status packet, or nothing."""
        table = self.table
        own, level = table["id"], table["status_return_level"]
        if packet.id not in (own, BROADCAST):
            return b""
        self.writes += packet.code in _WRITING
        data, error = b"", Error(0)
        try:
            if not packet.intact:
                raise RefusedError(Error.CHECKSUM, "a packet with a wrong checksum")
            data = self._execute(packet.code, packet.parameters)
        except RefusedError as refusal:
            error = refusal.error
            self._warn(_words(error), f"{refusal}; not obeyed")
        if packet.code == Instruction.PING:
            silent = False
        elif packet.code == Instruction.BULK_READ:
            silent = level == 0 or not data
        elif packet.id == BROADCAST:
            silent = True
        else:
            silent = level < (1 if packet.code == Instruction.READ else 2)
        return b"" if silent else Packet(own, error | self._errors, data).encode()

    def _execute(self, code: int, parameters: bytes) -> bytes:
        data = b""
        match code:
            case Instruction.PING:
                pass
            case Instruction.READ if len(parameters) == 2:
                data = self.table.read(*parameters)
            case Instruction.WRITE if len(parameters) > 1:
                self._write(parameters[0], parameters[1:])
            case Instruction.REG_WRITE if len(parameters) > 1:
                self._registered = parameters[0], parameters[1:]
                self.table["registered"] = 1
            case Instruction.ACTION if self._registered:
                registered, self._registered = self._registered, None
                self.table["registered"] = 0
                self._write(*registered)
            case Instruction.SYNC_WRITE if len(parameters) > 1:
                self._sync_write(parameters[0], parameters[1], parameters[2:])
            case Instruction.BULK_READ:
                data = self._bulk_read(parameters[1:])
            case _:
                raise RefusedError(
                    Error.INSTRUCTION,
                    f"instruction {code} with {len(parameters)} parameters",
                )
        return data

    def _write(self, address: int, data: bytes) -> None:
        table = self.table
        written = table.write(address, data)
        if "goal_position" in written:
            table["torque_enable"] = 1
        if "torque_limit" in written and table["torque_limit"]:
            self._overload = False
            self._unloaded_at = self._time
        moving = {"goal_position", "torque_enable", "torque_control_mode"}
        if table["torque_control_mode"]:
            moving.add("goal_torque")
        self._engaged |= bool(written & moving)

    def _sync_write(self, address: int, length: int, blocks: bytes) -> None:
        for start in range(0, len(blocks) - length, length + 1):
            if blocks[start] == self.table["id"]:
                self._write(address, blocks[start + 1 : start + 1 + length])

    def _bulk_read(self, blocks: bytes) -> bytes:
        for start in range(0, len(blocks) - 2, 3):
            length, number, address = blocks[start : start + 3]
            if number == self.table["id"]:
                return self.table.read(address, length)
        return b""


def _words(errors: Error) -> str:
    names = (error.name or "" for error in Error if error & errors)
    return ", ".join(names).lower().replace("_", " ")


def _directed(value: float) -> int:
    """A value as size and direction; positive is winding, and so clockwise."""
    size = min(abs(round(value)), _FULL)
    return size | _CLOCKWISE if size and value > 0 else size
