"""The firmware of a Dynamixel MX-64 with Protocol 1.0."""

from __future__ import annotations

import math
from collections.abc import Callable

from drake_srg.bridges.dynamixel.motor import Motor, MotorCommand
from drake_srg.bridges.dynamixel.protocol import Fault
from drake_srg.bridges.dynamixel.registers import (
    CLOCKWISE,
    FULL_TORQUE,
    SPEED_UNIT,
    TURN,
    ControlTable1,
    encode_directed,
)
from drake_srg.bridges.dynamixel.servo import Servo


class Mx64(Servo):
    """An MX-64 with Protocol 1.0.

    Goal position, torque enable and torque control mode move the motor. From then on it
    commands

    - in torque control mode: the goal torque
    - otherwise, with torque enabled: the goal position, approached at the moving speed
    - otherwise: zero torque

    The torque limit is in 1/1023 of the stall torque; values above `drive.full_scale`
    allow no more than that.

    PID gains, punch, goal acceleration, baud rate, return delay and LEDs are stored
    without effect. Factory reset and endless turning are refused.
    """

    def __init__(self, motor: Motor, warn: Callable[[str, str], None], number: int = 1):
        self.table: ControlTable1 = ControlTable1()
        super().__init__(motor, warn, number)

    def reboot(self) -> None:
        """See `Servo`."""
        table = self.table
        table.reset(r.name for r in table.registers if r.address >= table.ram)
        self._registered = b""
        self._recover()
        self._show()
        self._follow(0.0)

    # Motor.

    def command(self) -> MotorCommand | None:
        """See `Servo`."""
        if not self._engaged:
            return None
        table = self.table
        limit = self._motor.limit(self._output_limit())
        if self._positioning:
            return MotorCommand(self._profile.position, math.nan, limit)
        torque = 0.0
        if table["torque_control_mode"]:
            goal = table["goal_torque"]
            current = (goal & ~CLOCKWISE) * table.current_unit
            torque = self._motor.torque(current if goal & CLOCKWISE else -current)
        return MotorCommand(math.nan, torque, limit)

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
