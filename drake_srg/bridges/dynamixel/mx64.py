"""The firmware of a Dynamixel MX-64; its motor is simulated elsewhere."""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Callable

from drake_srg.bridges.dynamixel.encoder import encoder_position, goal_angle
from drake_srg.bridges.dynamixel.protocol import (
    BROADCAST,
    Error,
    Instruction,
    Packet,
    RefusedError,
)
from drake_srg.bridges.dynamixel.registers import (
    CLOCKWISE,
    CURRENT_UNIT,
    FULL_TORQUE,
    SPEED_UNIT,
    VOLTAGE_UNIT,
    ControlTable,
    encode_directed,
)
from drake_srg.gripper.motor_temperature import MotorTemperatureConfig, motor_load
from drake_srg.gripper.tendon import TendonDriveConfig

# The e-manual defines an overload as "persistent load exceeds maximum output". Here:
# the output is at the torque limit, and above a fifth of the stall torque (what ROBOTIS
# recommends for continuous load), for this time. A user saw an MX-64 shut down after
# 10 s at 4 A, after 20 s at 2 A, and not at 1 A (forum.robotis.com, "Moment of
# dynamixel").
_OVERLOAD_TIME = 10.0  # s
_SUSTAINED = FULL_TORQUE // 5

_WRITING = (Instruction.WRITE, Instruction.REG_WRITE, Instruction.SYNC_WRITE)


@dc.dataclass(frozen=True)
class MotorCommand:
    """The servo's command to its motor.

    Attributes:
        position: Spool angle [rad]; NaN if `torque` applies.
        torque: Fraction of the torque at full PWM, positive to wind; NaN if `position`
            applies.
        limit: Force limit kappa, fraction of full PWM, 0 .. 1.
    """

    position: float
    torque: float
    limit: float

    def same(self, other: MotorCommand | None) -> bool:
        """Return whether two commands are equal, where NaN equals NaN."""
        return repr(self) == repr(other)


class Mx64:
    """A servo that answers packets, senses its motor and commands it.

    It commands nothing until a master writes a register that moves the motor (goal
    position, torque enable, torque control mode). From then on it commands

    - in torque control mode: the goal torque
    - otherwise, with torque enabled: the goal position, approached at the moving speed
    - otherwise: zero torque

    The torque limit is in 1/1023 of the stall torque; values above `drive.full_scale`
    allow no more than that.

    After `release` it commands nothing and ignores the load, until a master again
    writes a register that moves the motor.

    Turning clockwise lowers the position and closes the gripper. PID gains, punch, goal
    acceleration, baud rate, return delay and LEDs are stored without effect. Factory
    reset and endless turning are refused.

    Args:
        drive: The motor.
        heat: The motor's stall current and supply voltage.
        warn: Called with a kind and a message for each refusal and each shutdown.

    Attributes:
        table: The registers.
        writes: Number of write packets for this servo so far, good and bad.
    """

    def __init__(
        self,
        drive: TendonDriveConfig,
        heat: MotorTemperatureConfig,
        warn: Callable[[str, str], None],
    ):
        self.table = ControlTable()
        self.table["present_voltage"] = min(
            round(heat.supply_voltage / VOLTAGE_UNIT), 255
        )
        self.writes = 0
        self._drive, self._heat = drive, heat
        self._warn = warn
        self._registered: tuple[int, bytes] | None = None
        self._engaged = False  # whether a master commands the motor
        self._overload = False
        self._time = self._unloaded_at = 0.0
        self._target = 0.0  # angle that the moving-speed profile has reached [rad]

    # Motor.

    def sense(
        self, time: float, angle: float, speed: float, pwm: float, temperature: float
    ) -> None:
        """Take the motor's state into the registers.

        Args:
            time: Simulated time [s].
            angle: Angle of the spool [rad].
            speed: Speed of the spool [rad/s].
            pwm: Fraction of full scale.
            temperature: Temperature of the motor [degrees Celsius].
        """
        table, drive = self.table, self._drive
        step, self._time = max(time - self._time, 0.0), time
        amperes = motor_load(drive, pwm, speed) * self._heat.stall_current
        table["present_position"] = encoder_position(table, angle)
        table["present_speed"] = encode_directed(speed / SPEED_UNIT)
        table["present_load"] = load = encode_directed(
            drive.full_scale * pwm * FULL_TORQUE
        )
        table["present_temperature"] = min(max(round(temperature), 0), 255)
        table["current"] = min(max(2048 - round(amperes / CURRENT_UNIT), 0), 4095)
        table["moving"] = int(table["present_speed"] != 0)
        table["realtime_tick"] = int(time * 1000) % 32768
        self._protect(load & ~CLOCKWISE if self._engaged else 0)
        if not (self._positioning and self._engaged):
            self._target = angle
            if not table["torque_enable"]:
                table["goal_position"] = table["present_position"]
        else:
            distance = goal_angle(table) - self._target
            if allowed := table["moving_speed"] * SPEED_UNIT:  # 0 means no limit
                distance = math.copysign(min(abs(distance), allowed * step), distance)
            self._target += distance

    def command(self) -> MotorCommand | None:
        """Return the command to the motor, or None if the servo has none."""
        if not self._engaged:
            return None
        table, full = self.table, self._drive.full_scale
        limit = min(table["torque_limit"] / FULL_TORQUE / full, 1.0)
        if self._positioning:
            target = self._target if table["moving_speed"] else goal_angle(table)
            return MotorCommand(target, math.nan, limit)
        torque = 0.0
        if table["torque_control_mode"]:
            goal = table["goal_torque"]
            sign = 1.0 if goal & CLOCKWISE else -1.0
            amperes = (goal & ~CLOCKWISE) * CURRENT_UNIT
            torque = sign * amperes / self._heat.stall_current / full
        return MotorCommand(math.nan, torque, limit)

    def release(self) -> None:
        """Leave the motor to another source of commands."""
        self._engaged = False

    @property
    def _positioning(self) -> bool:
        table = self.table
        return bool(table["torque_enable"] and not table["torque_control_mode"])

    def _protect(self, load: int) -> None:
        """Shut down if load, temperature or voltage require it."""
        table = self.table
        available = min(
            table["torque_limit"], round(self._drive.full_scale * FULL_TORQUE)
        )
        if load < max(available, _SUSTAINED + 1):
            self._unloaded_at = self._time
        elif self._time - self._unloaded_at > _OVERLOAD_TIME:
            self._overload = True
        if errors := self._errors & table["shutdown"]:
            if table["torque_limit"]:
                kind = _words(errors)
                self._warn(kind, f"{kind}: off until a torque limit is written")
            table["torque_limit"] = table["torque_enable"] = 0

    @property
    def _errors(self) -> Error:
        """The errors of the servo itself."""
        table, errors = self.table, Error(0)
        low, high = table["min_voltage_limit"], table["max_voltage_limit"]
        if not low <= table["present_voltage"] <= high:
            errors |= Error.VOLTAGE
        if table["present_temperature"] > table["temperature_limit"]:
            errors |= Error.OVERHEATING
        return errors | Error.OVERLOAD if self._overload else errors

    # Packets.

    def answer(self, packet: Packet) -> bytes:
        """Carry out an instruction; return the status packet, or no bytes."""
        table = self.table
        own, level = table["id"], table["status_return_level"]
        if packet.id not in (own, BROADCAST):
            return b""
        self.writes += packet.code in _WRITING
        data, error = b"", Error(0)
        try:
            if not packet.intact:
                raise RefusedError(Error.CHECKSUM, "wrong checksum")
            data = self._execute(packet.code, packet.parameters)
        except RefusedError as refusal:
            error = refusal.error
            self._warn(_words(error), f"refused a packet: {refusal}")
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
                    f"invalid instruction {code} with {len(parameters)} parameters",
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
