"""Emulates the part of a Dynamixel servo's firmware that both protocols share."""

from __future__ import annotations

import abc
import dataclasses as dc
import enum
import math
from collections.abc import Callable

from drake_srg.gripper.driver import WireMotor
from drake_srg.gripper.tendon import motor_load
from drake_srg.robot.serve.dynamixel.protocol import (
    BROADCAST,
    GROUP_READING,
    Fault,
    Instruction,
    Packet,
    Refusal,
    RefusedError,
)
from drake_srg.robot.serve.dynamixel.registers import TURN, VOLTAGE_UNIT, ControlTable


class Shape(enum.IntEnum):
    """Shapes of a profile's velocity, as in the moving status of Protocol 2.0."""

    STEP = 0x00
    RECTANGULAR = 0x10
    TRIANGULAR = 0x20
    TRAPEZOIDAL = 0x30


@dc.dataclass
class Profile:
    """A target that moves with limited velocity and acceleration.

    The velocity stays continuous when the goal or the limits change.

    Attributes:
        position: Position of the target [rad].
        velocity: Velocity of the target [rad/s].
        max_velocity: Largest velocity [rad/s]; infinite: reach goals at once.
        max_acceleration: Largest acceleration [rad/s²]; infinite: no ramps.
    """

    position: float = 0.0
    velocity: float = 0.0
    max_velocity: float = math.inf
    max_acceleration: float = math.inf

    def rest(self, position: float) -> None:
        """Stop at a position [rad]."""
        self.position, self.velocity = position, 0.0

    def shape(self, way: float) -> Shape:
        """Return the shape of a motion from rest over a distance [rad]."""
        if math.isinf(self.max_velocity):
            return Shape.STEP
        if math.isinf(self.max_acceleration):
            return Shape.RECTANGULAR
        reached = self.max_velocity**2 <= self.max_acceleration * abs(way)
        return Shape.TRAPEZOIDAL if reached else Shape.TRIANGULAR

    def approach(self, goal: float, step: float) -> None:
        """Move for a step [s] towards a goal [rad], to arrive there at rest."""
        way, velocity = goal - self.position, self.max_velocity
        if math.isinf(velocity):
            self.rest(goal)
        elif step > 0.0:
            if not math.isinf(self.max_acceleration):
                # Largest velocity v after this step from which the next steps can
                # still stop at the goal: v² + a step v = 2 a way.
                half = self.max_acceleration * step / 2
                square = 2 * self.max_acceleration * abs(way)
                divisor = half + math.hypot(half, square**0.5)  # 0: cannot accelerate
                velocity = min(velocity, square / divisor) if divisor else 0.0
            self._change(math.copysign(velocity, way), step)
            if abs(way) <= self.velocity * step * math.copysign(1.0, way):
                self.rest(goal)
            else:
                self.position += self.velocity * step

    def run(self, velocity: float, step: float) -> None:
        """Accelerate towards a velocity [rad/s] for a step [s], and move."""
        self._change(velocity, step)
        self.position += self.velocity * step

    def _change(self, velocity: float, step: float) -> None:
        change = velocity - self.velocity
        # A step of zero length changes nothing, even with infinite acceleration.
        most = self.max_acceleration * step if step > 0.0 else 0.0
        self.velocity += math.copysign(min(abs(change), most), change)


_COUNTS = TURN / math.tau  # per rad


@dc.dataclass(frozen=True)
class Encoder:
    """Converts between angles and counts over all turns.

    Angles are positive clockwise, which lowers the position.

    Attributes:
        zero: Counts at angle 0.
    """

    zero: int

    def to_counts(self, angle: float) -> float:
        """Return the counts at an angle [rad]."""
        return self.zero - angle * _COUNTS

    def to_angle(self, counts: float) -> float:
        """Return the angle at counts [rad]."""
        return (self.zero - counts) / _COUNTS


# The encoder on the SRG's spool, which turns clockwise to close. Angle 0 is where the
# fingers are open and the wires taut. SAKE's 100 % are 2500 counts, or 29.1 mm of wire.
# This is about the wire that a finger needs for the full range of both joints (28.8 mm
# here), and the value below puts the middle of that range at the middle of a turn.
# Calibration without an object ends where the pads meet: after 19.7 mm, plus up to
# 1.7 mm by which the wires stretch under 43 N. The stretch relaxes while the servo
# reads SAKE's zero. This zero is therefore at 1456 to 1537 counts, and the fingers are
# fully open at 70 to 74 %.
SPOOL = Encoder(3298)
# The encoder on a joint, whose range usually extends to both sides of 0.
JOINT = Encoder(TURN // 2)


@dc.dataclass(frozen=True)
class MotorState:
    """Measurements of a servo's motor.

    Attributes:
        angle: Angle of the output shaft, positive clockwise [rad].
        speed: Speed of the output shaft, positive clockwise [rad/s].
        pwm: PWM, as a fraction of full scale.
        current: Current, positive for a clockwise torque [A].
        temperature: Temperature [degC].
    """

    angle: float = 0.0
    speed: float = 0.0
    pwm: float = 0.0
    current: float = 0.0
    temperature: float = 25.0


@dc.dataclass(frozen=True)
class MotorCommand:
    """A servo's command to its motor.

    Attributes:
        position: Angle of the output shaft [rad]; NaN if `torque` applies.
        torque: Fraction of the torque at full PWM, positive clockwise; NaN if
            `position` applies.
        limit: The force limit kappa, as a fraction of full PWM, 0 .. 1.
    """

    position: float
    torque: float
    limit: float

    def same(self, other: MotorCommand | None) -> bool:
        """Return whether two commands are equal; NaN equals NaN."""
        return repr(self) == repr(other)


class Motor:
    """Converts between units of a servo's firmware and of the simulated motor.

    The firmware has currents [A] and duties, which are fractions of the supply voltage.
    The simulated motor has fractions of full PWM, the mechanism's full scale.

    Args:
        encoder: Encoder of the output shaft.
        supply_voltage: Voltage of the supply, which never sags [V].
        stall_current: Current at stall and full supply voltage [A].
        full_duty: The duty of full PWM.

    Attributes:
        encoder: Encoder of the output shaft.
        supply_voltage: Voltage of the supply [V].
        full_duty: The duty of full PWM.
    """

    def __init__(
        self,
        encoder: Encoder,
        supply_voltage: float = 12.0,
        stall_current: float = 4.1,
        full_duty: float = 1.0,
    ):
        self.encoder = encoder
        self.supply_voltage = supply_voltage
        self.full_duty = full_duty
        self._stall_current = stall_current

    def sense(
        self, angle: float, speed: float, pwm: float, temperature: float
    ) -> MotorState:
        """Return the state for the registers, with the servo's estimate of current."""
        current = self._load_at(pwm, speed) * self._stall_current
        return MotorState(angle, speed, pwm, current, temperature)

    def load(self, current: float) -> float:
        """Return the fraction of the stall torque at a current [A]."""
        return current / self._stall_current

    def torque(self, current: float) -> float:
        """Return the torque at a current [A], as a fraction of full PWM's."""
        return self.load(current) / self.full_duty

    def limit(self, duty: float) -> float:
        """Return the force limit that corresponds to a duty."""
        return min(abs(duty) / self.full_duty, 1.0)

    def torque_of_duty(self, duty: float, speed: float) -> float:
        """Return the torque command that gives a duty at a speed [rad/s]."""
        return duty / self.full_duty

    def limit_of_current(self, current: float, speed: float) -> float:
        """Return the force limit that limits the current [A] at a speed [rad/s].

        At rest, it allows the torque of that current.
        """
        return min(self.torque(abs(current)), 1.0)

    def _load_at(self, pwm: float, speed: float) -> float:
        """Return the load at a PWM and a speed [rad/s], over the stall torque."""
        return pwm * self.full_duty


class SpoolMotor(Motor):
    """The motor that winds the SRG's wires."""

    def __init__(self, motor: WireMotor):
        heat = motor.temperature
        super().__init__(
            SPOOL, heat.supply_voltage, heat.stall_current, motor.drive.full_scale
        )
        self._drive, self._servo = motor.drive, motor.servo

    def torque_of_duty(self, duty: float, speed: float) -> float:
        """Return the torque command that gives a duty at a speed [rad/s].

        Torque control adds duty to make up for the back-EMF. This is subtracted here.
        """
        useful = self._drive.useful_pwm(duty / self.full_duty)
        return useful - self._added(speed)

    def limit_of_current(self, current: float, speed: float) -> float:
        """Return the force limit that limits the current [A] at a speed [rad/s].

        Speeds are positive towards the goal. There, the limit makes up for the
        back-EMF, as torque control does.
        """
        useful = self.torque(abs(current)) + self._added(speed)
        return min(max(self._drive.pwm_of(useful), 0.0), 1.0)

    def _load_at(self, pwm: float, speed: float) -> float:
        return motor_load(self._drive, pwm, speed)

    def _added(self, speed: float) -> float:
        drive = self._drive
        return (
            self._servo.current_control
            * speed
            / (drive.no_load_speed * drive.full_scale)
        )


# The e-manual defines an overload as "persistent load exceeds maximum output". Here, it
# is an output at its limit for this time, if it exceeds a fifth of the stall torque
# (ROBOTIS's recommendation for continuous load). A user saw an MX-64 shut down after
# 10 s at 4 A, after 20 s at 2 A, and not at 1 A (forum.robotis.com, "Moment of
# dynamixel").
_OVERLOAD_TIME = 10.0  # s
_STEPS = 1023  # steps of the measured load, up to the stall torque
_SUSTAINED = _STEPS // 5

_WRITING = (
    Instruction.WRITE,
    Instruction.REG_WRITE,
    Instruction.SYNC_WRITE,
    Instruction.BULK_WRITE,
)


class Servo(abc.ABC):
    """A servo that answers packets, senses its motor and commands it.

    Until a master writes a register that moves the motor, it commands nothing. After
    `release`, it commands nothing and ignores the load until the next such write.

    Angles and speeds are positive clockwise, which lowers the position.

    Args:
        warn: Called with a kind and a message for each refusal and each shutdown.
        number: The servo's initial ID.

    Attributes:
        table: The servo's registers.
        writes: Number of write packets for this servo so far, valid or not.
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
        """Take the motor's state into the registers, and advance the target.

        Args:
            time: Simulated time [s].
            angle: Angle of the output shaft [rad].
            speed: Speed of the output shaft [rad/s].
            pwm: PWM, as a fraction of full scale.
            temperature: Temperature of the motor [degC].
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
        """Return the command to the motor; None if no master commands it."""

    def release(self) -> None:
        """Leave the motor to another source of commands."""
        self._engaged = False

    def reboot(self) -> None:
        """Restart, as after a loss of power: torque off, RAM at its defaults."""
        table = self.table
        table.reset(r.name for r in table.registers if r.address >= table.ram)
        self._registered = b""
        self._recover()

    @abc.abstractmethod
    def _show(self) -> None:
        """Take the motor's state into the registers that only this protocol has."""

    @abc.abstractmethod
    def _follow(self, step: float) -> None:
        """Advance the target by a step [s]."""

    @abc.abstractmethod
    def _output_limit(self) -> float:
        """Return the largest allowed load, as a fraction of the stall torque."""

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
        """The servo's present faults."""
        table, faults = self.table, Fault(0)
        low, high = table["min_voltage_limit"], table["max_voltage_limit"]
        if not low <= table["present_voltage"] <= high:
            faults |= Fault.VOLTAGE
        if table["present_temperature"] > table["temperature_limit"]:
            faults |= Fault.OVERHEATING
        return faults | Fault.OVERLOAD if self._overload else faults

    @property
    def _shown_faults(self) -> Fault:
        """The faults that status packets report."""
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
        """Carry out an instruction; return its data, None if it is for other servos.

        Raises:
            RefusedError: If the instruction is invalid.
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
        """Keep the parameters of a write until an action; b"" forgets them."""
        self._registered = parameters
        self.table["registered"] = int(bool(parameters))

    @abc.abstractmethod
    def _wrote(self, written: set[str]) -> None:
        """React to registers that were written, by their names."""
