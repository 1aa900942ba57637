"""The firmware of a Dynamixel servo, as far as both protocols share it."""

from __future__ import annotations

import abc
from collections.abc import Callable

from drake_srg.bridges.dynamixel.motor import Motor, MotorCommand, MotorState
from drake_srg.bridges.dynamixel.profile import Profile
from drake_srg.bridges.dynamixel.protocol import (
    BROADCAST,
    GROUP_READING,
    Fault,
    Instruction,
    Packet,
    Refusal,
    RefusedError,
)
from drake_srg.bridges.dynamixel.registers import VOLTAGE_UNIT, ControlTable

# The e-manual defines an overload as "persistent load exceeds maximum output". Here:
# the output is at its limit, and above a fifth of the stall torque (what ROBOTIS
# recommends for continuous load), for this time. A user saw an MX-64 shut down after
# 10 s at 4 A, after 20 s at 2 A, and not at 1 A (forum.robotis.com, "Moment of
# dynamixel").
_OVERLOAD_TIME = 10.0  # s
_STEPS = 1023  # of the load that the servo measures, up to the stall torque
_SUSTAINED = _STEPS // 5

_WRITING = (
    Instruction.WRITE,
    Instruction.REG_WRITE,
    Instruction.SYNC_WRITE,
    Instruction.BULK_WRITE,
)


class Servo(abc.ABC):
    """A servo that answers packets, senses its motor and commands it.

    It commands nothing until a master writes a register that moves the motor. After
    `release` it again commands nothing and ignores the load, until the next such write.

    Angles and speeds are positive clockwise, which lowers the position.

    Args:
        motor: The motor.
        warn: Called with a kind and a message for each refusal and each shutdown.
        number: Its ID.

    Attributes:
        table: The registers.
        writes: Number of write packets for this servo so far, good and bad.
    """

    table: ControlTable

    def __init__(self, motor: Motor, warn: Callable[[str, str], None], number: int = 1):
        self.writes = 0
        self.table["id"] = number
        self._motor = motor
        self._warn = warn
        self._registered = b""  # parameters of a write that waits for an action
        self._engaged = False  # whether a master commands the motor
        self._overload = False
        self._time = self._unloaded_at = 0.0
        self._state = MotorState()
        self._profile = Profile()

    # Motor.

    def sense(
        self, time: float, angle: float, speed: float, pwm: float, temperature: float
    ) -> None:
        """Take the motor's state into the registers.

        Args:
            time: Simulated time [s].
            angle: Of the output shaft [rad].
            speed: Of the output shaft [rad/s].
            pwm: Fraction of full scale.
            temperature: Temperature of the motor [degrees Celsius].
        """
        table = self.table
        step, self._time = max(time - self._time, 0.0), time
        self._state = state = self._motor.sense(angle, speed, pwm, temperature)
        voltage = round(self._motor.supply_voltage / VOLTAGE_UNIT)
        table["present_voltage"] = min(voltage, 255)
        table["present_temperature"] = min(max(round(state.temperature), 0), 255)
        table["realtime_tick"] = int(time * 1000) % 32768
        self._show()
        self._protect()
        self._follow(step)

    @abc.abstractmethod
    def command(self) -> MotorCommand | None:
        """Return the command to the motor, or None if the servo has none."""

    def release(self) -> None:
        """Leave the motor to another source of commands."""
        self._engaged = False

    @abc.abstractmethod
    def reboot(self) -> None:
        """Start anew, as after a loss of power: torque off, RAM at its defaults."""

    @abc.abstractmethod
    def _show(self) -> None:
        """Take the motor's state into the registers that only this protocol has."""

    @abc.abstractmethod
    def _follow(self, step: float) -> None:
        """Move the target on by a step [s]."""

    @abc.abstractmethod
    def _output_limit(self) -> float:
        """Return the largest load that the registers allow, over the stall torque."""

    @abc.abstractmethod
    def _shut_down(self, faults: Fault) -> None:
        """Switch the motor off because of these faults."""

    def _protect(self) -> None:
        """Shut down if load, temperature or voltage require it."""
        full = self._motor.full_duty
        load = round(abs(self._state.pwm) * full * _STEPS) if self._engaged else 0
        available = round(min(self._output_limit(), full) * _STEPS)
        if load < max(available, _SUSTAINED + 1):
            self._unloaded_at = self._time
        elif self._time - self._unloaded_at > _OVERLOAD_TIME:
            self._overload = True
        if faults := self._faults & self.table["shutdown"]:
            self._shut_down(faults)

    def _recover(self) -> None:
        """Forget an overload."""
        self._overload = False
        self._unloaded_at = self._time

    @property
    def _faults(self) -> Fault:
        """What is wrong with the servo itself now."""
        table, faults = self.table, Fault(0)
        low, high = table["min_voltage_limit"], table["max_voltage_limit"]
        if not low <= table["present_voltage"] <= high:
            faults |= Fault.VOLTAGE
        if table["present_temperature"] > table["temperature_limit"]:
            faults |= Fault.OVERHEATING
        return faults | Fault.OVERLOAD if self._overload else faults

    @property
    def _shown_faults(self) -> Fault:
        """The faults that status packets tell."""
        return self._faults

    # Packets.

    def answer(self, packet: Packet) -> bytes:
        """Carry out an instruction; return the status packet, or no bytes."""
        own, level = self.table["id"], self.table["status_return_level"]
        code = packet.code
        if packet.id not in (own, BROADCAST):
            return b""
        self.writes += code in _WRITING
        data: bytes | None = None
        refused: Refusal | None = None
        try:
            if not packet.intact:
                raise RefusedError(Refusal.CHECKSUM, "wrong checksum")
            data = self._execute(packet)
        except RefusedError as refusal:
            refused = refusal.kind
            self._warn(refused.name.lower(), f"refused a packet: {refusal}")
        if code == Instruction.PING:
            silent = False
        elif code in GROUP_READING:  # answered although it is broadcast
            silent = level == 0 or (data is None and refused is not Refusal.ACCESS)
        elif packet.id == BROADCAST:
            silent = True
        else:
            silent = level < (1 if code == Instruction.READ else 2)
        if silent:
            return b""
        answer = self.table.packets.answer
        return answer(own, code, self._shown_faults, refused, data or b"").encode()

    def _execute(self, packet: Packet) -> bytes | None:
        """Carry out an instruction; return its data, None if it asks another servo.

        Raises:
            RefusedError: If it is invalid.
        """
        parameters = packet.parameters
        width = packet.width
        head = 2 * width  # bytes of an address and a length
        match packet.code:
            case Instruction.PING:
                table = self.table
                return b"".join(
                    table.read(register.address, register.size)
                    for register in map(table.register, table.identity)
                )
            case Instruction.READ if len(parameters) == head:
                return self.table.read(*packet.numbers(parameters))
            case Instruction.WRITE if len(parameters) > width:
                self._write(parameters)
            case Instruction.REG_WRITE if len(parameters) > width:
                self._register(parameters)
            case Instruction.ACTION if self._registered:
                registered = self._registered
                self._register(b"")
                self._write(registered)
            case Instruction.SYNC_WRITE if len(parameters) >= head:
                length = packet.numbers(parameters)[1]
                for start in range(head, len(parameters) - length, length + 1):
                    if parameters[start] == self.table["id"]:
                        data = parameters[start + 1 : start + 1 + length]
                        self._write(parameters[:width] + data)
            case code if code in GROUP_READING and packet.asked:
                for number, address, length in packet.asked:
                    if number == self.table["id"]:
                        return self.table.read(address, length)
                return None
            case _:
                raise RefusedError(
                    Refusal.INSTRUCTION,
                    f"invalid instruction {packet.code} with {len(parameters)} "
                    "parameters",
                )
        return b""

    def _write(self, parameters: bytes) -> None:
        """Write registers: an address, then data."""
        packets = self.table.packets
        address, data = packets.number(parameters), parameters[packets.width :]
        self._wrote(self.table.write(address, data))
        self._follow(0.0)

    def _register(self, parameters: bytes) -> None:
        """Keep the parameters of a write for an action; none to forget them."""
        self._registered = parameters
        self.table["registered"] = int(bool(parameters))

    @abc.abstractmethod
    def _wrote(self, written: set[str]) -> None:
        """Do what registers ask that have been written."""
