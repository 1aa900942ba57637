"""The control table of a Dynamixel MX-64 with Protocol 2.0, "MX-64(2.0)".

Source: ROBOTIS's public e-manual (emanual.robotis.com: "MX-64(2.0)").
"""

from __future__ import annotations

import enum
import math
from collections.abc import Collection, Sequence
from typing import ClassVar

from drake_srg.bridges.dynamixel.encoder import TURN
from drake_srg.bridges.dynamixel.protocol import Refusal, RefusedError
from drake_srg.bridges.dynamixel.registers import ControlTable, Register

# Units.
VELOCITY_UNIT = 0.229 * math.tau / 60  # rad/s
ACCELERATION_UNIT = 214.577 * math.tau / 60**2  # rad/s²
CURRENT_UNIT = 3.36e-3  # A
FULL_PWM = 885  # 100 %

_POSITIONS = (1 - 256 * TURN, 256 * TURN - 1)
# Without all turns, position control ignores larger offsets.
_SINGLE_TURN_OFFSET = 1024


class Mode(enum.IntEnum):
    """Operating modes."""

    CURRENT = 0
    VELOCITY = 1
    POSITION = 3
    EXTENDED_POSITION = 4
    CURRENT_BASED_POSITION = 5
    PWM = 16


# Registers that move the motor in other modes than position modes.
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
    """Return 28 indirect addresses, from number `first` on, and their data."""
    numbers = range(28)
    return [
        *(
            Register(
                address + 2 * k, f"indirect_address_{first + k}", 2, data + k, (64, 661)
            )
            for k in numbers
        ),
        *(
            Register(data + k, f"indirect_data_{first + k}", 1, 0, (0, 255))
            for k in numbers
        ),
    ]


class ControlTable2(ControlTable):
    """The registers of an MX-64 with Protocol 2.0."""

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

    @property
    def mode(self) -> Mode:
        """The operating mode."""
        return Mode(self["operating_mode"])

    @property
    def offset(self) -> int:
        """The homing offset that counts."""
        offset = self["homing_offset"]
        ignored = self.mode is Mode.POSITION and abs(offset) > _SINGLE_TURN_OFFSET
        return 0 if ignored else offset

    @property
    def locked(self) -> bool:
        """See `ControlTable`."""
        return bool(self["torque_enable"])

    @property
    def reverse(self) -> bool:
        """Whether the drive mode reverses the sense of rotation."""
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
        """Set the goal to where the motor is, or to zero."""
        here = self["present_position"] if self.goal == "goal_position" else 0
        self[self.goal] = here

    def reset_goals(self) -> None:
        """Set goals and profile as after a change of the operating mode.

        The manual sets goal PWM and goal current to their limits in all modes. Here the
        goal that moves the motor does not: it would move with all its force.
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
        """Return the velocity and acceleration for a way, in rad, rad/s and rad/s²."""
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
        """Return the address that indirect data stand for, or the address itself."""
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

    def _check_goal(
        self, name: str, low: int, high: int, written: Collection[str], where: str
    ) -> None:
        if name in written and not low <= self[name] <= high:
            raise RefusedError(
                Refusal.LIMIT,
                f"{where}: {name} must be {low} to {high}, got {self[name]}",
            )
