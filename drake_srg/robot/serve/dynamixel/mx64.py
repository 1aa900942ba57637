"""Emulates the firmware of a Dynamixel MX-64, with Protocol 1.0 or 2.0."""

from __future__ import annotations

import math
from collections.abc import Callable

from drake_srg.robot.serve.dynamixel.protocol import (
    BROADCAST,
    FAST_READING,
    Fault,
    Instruction,
    Packet,
    Refusal,
    RefusedError,
)
from drake_srg.robot.serve.dynamixel.registers import (
    CLOCKWISE,
    FULL_PWM,
    FULL_TORQUE,
    SPEED_UNIT,
    TURN,
    VELOCITY_UNIT,
    ControlTable1,
    ControlTable2,
    Mode,
    encode_directed,
)
from drake_srg.robot.serve.dynamixel.servo import (
    Motor,
    MotorCommand,
    Profile,
    Servo,
    Shape,
)


class Mx64(Servo):
    """An MX-64 with Protocol 1.0.

    Once a master writes goal position, torque enable or torque control mode, the servo
    commands its motor:

    - in torque control mode: the goal torque
    - otherwise, with torque enabled: the goal position, approached at the moving speed
    - otherwise: zero torque

    The torque limit is in 1/1023 of the stall torque; values above `drive.full_scale`
    have no further effect. In torque control, it limits the goal torque in the same
    units, not the PWM: with both at 20 %, the vendor's log has a load of 420 of 1023.

    PID gains, punch, goal acceleration, baud rate, return delay and LEDs are stored
    without effect. Factory reset and endless turning are refused.
    """

    def __init__(self, motor: Motor, warn: Callable[[str, str], None], number: int = 1):
        self.table: ControlTable1 = ControlTable1()
        super().__init__(motor, warn, number)

    def reboot(self) -> None:
        """Restart, as after a loss of power: torque off, RAM at its defaults."""
        super().reboot()
        self._show()
        self._follow(0.0)

    # Motor.

    def command(self) -> MotorCommand | None:
        """Return the command to the motor; None if no master commands it."""
        if not self._engaged:
            return None
        table = self.table
        limit = self._motor.limit(self._output_limit())
        if self._positioning:
            return MotorCommand(self._profile.position, math.nan, limit)
        if not table["torque_control_mode"]:
            return MotorCommand(math.nan, 0.0, limit)
        goal = table["goal_torque"]
        current = min(goal & ~CLOCKWISE, table["torque_limit"]) * table.current_unit
        torque = self._motor.torque(current if goal & CLOCKWISE else -current)
        return MotorCommand(math.nan, torque, 1.0)

    @property
    def _positioning(self) -> bool:
        table = self.table
        return bool(table["torque_enable"] and not table["torque_control_mode"])

    @property
    def _goal(self) -> float:
        """Angle of the goal position [rad]."""
        table, counts = self.table, self.table["goal_position"]
        if table.multi_turn:
            counts = (counts - table["multi_turn_offset"]) * table["resolution_divider"]
        return self._motor.encoder.to_angle(counts)

    def _show(self) -> None:
        table, state, motor = self.table, self._state, self._motor
        counts = motor.encoder.to_counts(state.angle)
        if table.multi_turn:
            position = round(counts / table["resolution_divider"])
            table["present_position"] = position + table["multi_turn_offset"]
        else:
            table["present_position"] = round(counts) % TURN
        table["present_speed"] = encode_directed(state.speed / SPEED_UNIT)
        duty = motor.full_duty * state.pwm
        table["present_load"] = encode_directed(duty * FULL_TORQUE)
        current = 2048 - round(state.current / table.current_unit)
        table["current"] = min(max(current, 0), 4095)
        table["moving"] = int(table["present_speed"] != 0)

    def _follow(self, step: float) -> None:
        table = self.table
        if self._positioning and self._engaged:
            self._profile.max_velocity = table["moving_speed"] * SPEED_UNIT or math.inf
            self._profile.approach(self._goal, step)
        else:
            self._profile.rest(self._state.angle)
            if not table["torque_enable"]:
                table["goal_position"] = table["present_position"]

    def _output_limit(self) -> float:
        return self.table["torque_limit"] / FULL_TORQUE

    def _shut_down(self, faults: Fault) -> None:
        if self.table["torque_limit"]:
            self._warn(str(faults), f"{faults}: off until a torque limit is written")
        self.table["torque_limit"] = self.table["torque_enable"] = 0

    def _wrote(self, written: set[str]) -> None:
        table = self.table
        if "goal_position" in written:
            table["torque_enable"] = 1
        if "torque_limit" in written and table["torque_limit"]:
            self._recover()
        moving = {"goal_position", "torque_enable", "torque_control_mode"}
        if table["torque_control_mode"]:
            moving.add("goal_torque")
        self._engaged |= bool(written & moving)


_WATCHDOG_UNIT = 0.02  # s
# Largest lead of the moving target in velocity control [rad]. At this error, the
# gripper's servo gives full PWM.
_LEAD = 0.5
# Largest distance from a goal that counts as in position [counts]: an assumption,
# because the manual gives no figure.
_IN_POSITION = 10
_ARRIVED, _ONGOING = 0x01, 0x02  # bits of the moving status
_CLEAR_TURNS = b"\x01\x44\x58\x4c\x22"
# Registers that a factory reset keeps, by its parameter.
_KEPT = {0xFF: (), 0x01: ("id",), 0x02: ("id", "baud_rate")}


class Mx64P2(Servo):
    """An MX-64 with Protocol 2.0.

    Once a master writes torque enable, or the operating mode's goal while torque is on,
    the servo commands its motor:

    - without torque: zero torque
    - in current mode: the goal current
    - in PWM mode: the goal PWM
    - in velocity mode: a position that moves at the goal velocity
    - in the position modes: the goal position, approached by the profile

    In modes other than PWM mode, goal PWM limits the PWM. In current-based position
    mode, goal current limits the current.

    Gains, baud rate, return delay, secondary ID and LED are stored without effect.
    """

    def __init__(self, motor: Motor, warn: Callable[[str, str], None], number: int = 1):
        self.table: ControlTable2 = ControlTable2()
        super().__init__(motor, warn, number)
        self.reboot()

    def reboot(self) -> None:
        """Restart, as after a loss of power: torque off, RAM at its defaults."""
        super().reboot()
        self._heard = self._time  # time of the last instruction [s]
        self._turns = 0  # full turns to subtract from positions [counts]
        self._in_first_turn = True  # whether to subtract all full turns
        self._profile = Profile(self._state.angle)
        self._shape = Shape.STEP
        self._show()
        self.table.reset_goals()

    # Motor.

    def command(self) -> MotorCommand | None:
        """Return the command to the motor; None if no master commands it."""
        if not self._engaged:
            return None
        table, motor, speed = self.table, self._motor, self._state.speed
        if not table["torque_enable"]:
            return MotorCommand(math.nan, 0.0, 1.0)
        duty = table["goal_pwm"] / FULL_PWM
        current = table["goal_current"] * table.current_unit
        limit, target = motor.limit(duty), self._profile.position
        match table.mode:
            case Mode.PWM:
                torque = motor.torque_of_duty(table.direction * duty, speed)
                return MotorCommand(math.nan, torque, 1.0)
            case Mode.CURRENT:
                torque = motor.torque(table.direction * current)
                return MotorCommand(math.nan, torque, limit)
            case Mode.CURRENT_BASED_POSITION:
                towards = math.copysign(speed, speed * (target - self._state.angle))
                limit = min(limit, motor.limit_of_current(current, towards))
        return MotorCommand(target, math.nan, limit)

    @property
    def _goal(self) -> float:
        """Angle of the goal position [rad]."""
        counts = self.table["goal_position"] - self.table.offset + self._turns
        return self._motor.encoder.to_angle(-counts if self.table.reverse else counts)

    def _counts(self, angle: float) -> int:
        """Return the encoder's counts at an angle [rad], with the drive's sign."""
        counts = round(self._motor.encoder.to_counts(angle))
        return -counts if self.table.reverse else counts

    def _show(self) -> None:
        table, state = self.table, self._state
        sign = table.direction
        counts = self._counts(state.angle)
        if self._in_first_turn or table.mode is Mode.POSITION:
            self._turns = counts // TURN * TURN
            self._in_first_turn = False
        offset = table.offset - self._turns
        planned = self._profile
        duty = self._motor.full_duty * state.pwm
        for name, value in {
            "present_position": counts + offset,
            "present_velocity": sign * state.speed / VELOCITY_UNIT,
            "present_pwm": sign * duty * FULL_PWM,
            "present_current": sign * state.current / table.current_unit,
            "position_trajectory": self._counts(planned.position) + offset,
            "velocity_trajectory": sign * planned.velocity / VELOCITY_UNIT,
        }.items():
            table[name] = round(value)
        ongoing = self._positioning and planned.position != self._goal
        fast = abs(table["present_velocity"]) > table["moving_threshold"]
        table["moving"] = int(ongoing or fast)
        way = abs(table["present_position"] - table["goal_position"])
        arrived = self._positioning and not ongoing and way <= _IN_POSITION
        table["moving_status"] = self._shape | ongoing * _ONGOING | arrived * _ARRIVED

    @property
    def _positioning(self) -> bool:
        return bool(self.table["torque_enable"] and self.table.goal == "goal_position")

    @property
    def _goal_velocity(self) -> float:
        """The goal velocity, positive clockwise [rad/s]."""
        return self.table.direction * self.table["goal_velocity"] * VELOCITY_UNIT

    def _follow(self, step: float) -> None:
        table, profile, angle = self.table, self._profile, self._state.angle
        if not table["torque_enable"]:
            table["goal_position"] = table["present_position"]
        if self._engaged and self._positioning:
            profile.approach(self._goal, step)
        elif self._engaged and table["torque_enable"] and table.mode is Mode.VELOCITY:
            profile.run(self._goal_velocity, step)
            ahead = min(max(profile.position - angle, -_LEAD), _LEAD)
            profile.position = angle + ahead
        else:
            profile.rest(angle)

    def _plan(self) -> None:
        """Make a profile for a new goal."""
        table, profile = self.table, self._profile
        way = self._goal - profile.position
        profile.max_velocity, profile.max_acceleration = table.profile(way)
        if table.mode is Mode.VELOCITY:
            change = self._goal_velocity - profile.velocity
            profile.max_acceleration = table.ramp(change)
        self._shape = profile.shape(way) if self._positioning else Shape.STEP

    def _output_limit(self) -> float:
        table = self.table
        limits = [abs(table["goal_pwm"]) / FULL_PWM]
        if table.mode in (Mode.CURRENT, Mode.CURRENT_BASED_POSITION):
            limits.append(
                self._motor.load(abs(table["goal_current"]) * table.current_unit)
            )
        return min(limits)

    def _protect(self) -> None:
        table = self.table
        super()._protect()
        table["hardware_error_status"] |= self._faults
        allowed = table["bus_watchdog"] * _WATCHDOG_UNIT
        if table["torque_enable"] and 0.0 < allowed < self._time - self._heard:
            table["bus_watchdog"] = -1
            table.reset(("profile_velocity", "profile_acceleration"))
            table.stop()
            self._profile.rest(self._state.angle)
            self._plan()

    def _shut_down(self, faults: Fault) -> None:
        if self.table["torque_enable"]:
            self._warn(str(faults), f"{faults}: off until a reboot")
        self.table["torque_enable"] = 0

    # Packets.

    def answer(self, packet: Packet) -> bytes:
        """Carry out an instruction; return the status packet, or no bytes."""
        if packet.code == Instruction.STATUS:  # of another servo
            return b""
        self._heard = self._time
        return super().answer(packet)

    @property
    def _shown_faults(self) -> Fault:
        return Fault(self.table["hardware_error_status"])

    def _execute(self, packet: Packet) -> bytes | None:
        parameters, own = packet.parameters, self.table["id"]
        match packet.code:
            # Servos share the reply to a fast read. Only fast reads of a single servo
            # are supported.
            case code if code in FAST_READING and len(packet.asked) > 1:
                return None
            case Instruction.BULK_WRITE if parameters[4:]:
                start = 0
                while start + 5 <= len(parameters):
                    block = parameters[start + 1 :]
                    end = 4 + packet.numbers(block)[1]
                    if parameters[start] == own and end <= len(block):
                        self._write(block[:2] + block[4:end])
                    start += 1 + end
            case Instruction.REBOOT if not parameters:
                self.reboot()
            case Instruction.FACTORY_RESET if len(parameters) == 1:
                self._reset(packet)
            case Instruction.CLEAR if parameters == _CLEAR_TURNS:
                if self.table["moving"]:
                    raise RefusedError(Refusal.FAILED, "cannot clear turns in motion")
                self._in_first_turn = True
                self._show()
                self.table.stop()
            case _:
                return super()._execute(packet)
        return b""

    def _reset(self, packet: Packet) -> None:
        """Restore the factory's values."""
        table, option = self.table, packet.parameters[0]
        if option not in _KEPT or (option == 0xFF and packet.id == BROADCAST):
            raise RefusedError(Refusal.RANGE, f"cannot reset with option {option}")
        kept = {name: table[name] for name in _KEPT[option]}
        table.reset(register.name for register in table.registers)
        for name, value in kept.items():
            table[name] = value
        self.reboot()

    def _wrote(self, written: set[str]) -> None:
        table = self.table
        if written & {"operating_mode", "drive_mode"}:
            self._in_first_turn = True
        table.limit_goals()
        self._show()
        if "operating_mode" in written:
            table.reset_goals()
        if "torque_enable" in written:
            self._engaged = True
            if table["hardware_error_status"] & table["shutdown"]:
                table["torque_enable"] = 0
        if table.goal in written and table["torque_enable"]:
            self._engaged = True
            self._plan()
