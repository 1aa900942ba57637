"""The control table of a Dynamixel MX-64 with Protocol 1.0.

Source: ROBOTIS's public e-manual (emanual.robotis.com: "MX-64").
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import ClassVar

from drake_srg.bridges.dynamixel.protocol import Refusal, RefusedError
from drake_srg.bridges.dynamixel.registers import ControlTable, Register

# Units.
SPEED_UNIT = 0.114 * math.tau / 60  # rad/s
CURRENT_UNIT = 4.5e-3  # A
FULL_TORQUE = 1023  # torque limit or load of 100 %, which is the stall torque
CLOCKWISE = 1024  # direction bit of speeds, loads and torques


class ControlTable1(ControlTable):
    """The registers of an MX-64 with Protocol 1.0."""

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

    @property
    def multi_turn(self) -> bool:
        """Whether positions count turns: both angle limits are 4095."""
        return self["cw_angle_limit"] == self["ccw_angle_limit"] == 4095

    @property
    def locked(self) -> bool:
        """See `ControlTable`."""
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
        goal = self["goal_position"]
        limited = "goal_position" in written and not self.multi_turn
        if limited and not low <= goal <= high:
            raise RefusedError(
                Refusal.LIMIT,
                f"{where}: goal_position must be {low} to {high}, got {goal}",
            )


def encode_directed(value: float) -> int:
    """Encode a value as size and direction; positive winds, which is clockwise."""
    size = min(abs(round(value)), FULL_TORQUE)
    return size | CLOCKWISE if size and value > 0 else size


def decode_directed(value: int) -> int:
    """Return the number that `encode_directed` has encoded, positive clockwise."""
    size = value & FULL_TORQUE
    return size if value & CLOCKWISE else -size
