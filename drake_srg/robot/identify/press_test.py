"""Records the log that `drake-srg identify` reads, through a servo's registers.

It repeats the script that produced the vendor's log, on a real or simulated gripper.
Nothing may be between the fingers.
"""

from __future__ import annotations

import contextlib
import dataclasses as dc
import math
import time as wall
from collections.abc import Callable, Generator, Iterator, Sequence
from typing import Protocol

import numpy as np

from drake_srg.robot.drive.dynamixel.bus import ServoBus
from drake_srg.robot.identify.log import RISE, LogRow
from drake_srg.robot.serve.dynamixel.registers import (
    CLOCKWISE,
    FULL_TORQUE,
    ControlTable1,
    decode_directed,
)

# Time of a packet and its answer [s]. It is the latency of common USB adapters, and
# agrees with the time stamps of the vendor's log.
TRANSACTION = 0.016
_APPROACH, _PRESS = -50, -250  # goals, from closed [counts]
# The spool has stopped if it moves at most this far in a wait [counts]. Give up after
# so many waits, which take 2 s.
_UNMOVED, _MOST_WAITS = 5, 30
# Where presses start, from closed, and the time to get there. The vendor let springs
# open the fingers, in 10 s. From here, the spool reaches its full speed in an approach.
_OPEN, _RELEASE = 450, 1.0  # counts, s
_MULTI_TURN = 4095  # of both angle limits: positions count turns
_ZERO_CURRENT = 2048
_LOOK = 0.25  # between readings of the temperature [s]
# Registers that a test changes and that outlast it, in the order of their restoring.
_KEPT = ("cw_angle_limit", "ccw_angle_limit", "torque_limit")


class RecordingError(Exception):
    """Raised if a test must be given up; the message is one line."""


class Registers(Protocol):
    """The registers of an MX-64 with Protocol 1.0, by their names in the manual."""

    @property
    def time(self) -> float:
        """Time [s]."""

    def read(self, name: str) -> int:
        """Return a register's value."""

    def write(self, name: str, value: int) -> None:
        """Write a register."""

    def sleep(self, duration: float) -> None:
        """Wait [s]."""


class PressTest:
    """Presses the tips of an open gripper against each other, as the vendor did.

    The constructor finds the position where the tips meet.

    Args:
        servo: The gripper's servo.
        calibration: Share of the full torque for a first press, which finds roughly
            where the tips meet.
    """

    def __init__(self, servo: Registers, calibration: float) -> None:
        self._servo = servo
        for name in _KEPT[:2]:
            servo.write(name, _MULTI_TURN)
        servo.write("torque_enable", 0)
        servo.write("torque_control_mode", 1)
        servo.write("goal_torque", CLOCKWISE + int(calibration * FULL_TORQUE))
        servo.sleep(2.0)
        self.zero = servo.read("present_position")
        for _ in range(3):  # the vendor's zero is where its presses stop
            self._release()
            self._approach()
            self.zero = servo.read("present_position")
        # The first press by torque starts with this goal torque, for two packets.
        servo.write("goal_torque", CLOCKWISE + FULL_TORQUE // 100)
        self._release()

    def press(self, test: str, setpoint: float, waits: int | None = None) -> LogRow:
        """Press the tips against each other; return what the registers show.

        Args:
            test: `position` or `torque`.
            setpoint: Limit of the PWM, or goal torque [percent].
            waits: Log the position after this many waits of 50 ms; None: log it when
                the spool counts as stopped.
        """
        servo, started = self._servo, self._servo.time
        self._approach()
        if test == "torque":
            started = servo.time
        self._command(test, setpoint)
        stop, stopped = self._wait(waits)
        load, current = self._measure()
        self._release()
        return LogRow(test, setpoint, load, stop, current, stopped - started)

    def heat(self, setpoint: float, patience: float) -> LogRow:
        """Press until the servo is warmer by `RISE`; return how long this takes.

        Args:
            setpoint: Goal torque [percent].
            patience: Longest time that this may take [s].

        Raises:
            RecordingError: If it takes longer.
        """
        servo = self._servo
        self._approach()
        start, started = servo.read("present_temperature"), servo.time
        self._command("torque", setpoint)
        load, current = self._measure()
        while (now := servo.read("present_temperature")) < start + RISE:
            if servo.time - started > patience:
                raise RecordingError(
                    f"heating {setpoint:g} %: from {start} degC to {now} degC in "
                    f"{patience:g} s, needs {RISE:g} degrees"
                )
            servo.sleep(_LOOK)
        seconds = servo.time - started
        self._release()
        return LogRow("heating", setpoint, load, math.nan, current, seconds, start)

    def _command(self, test: str, setpoint: float) -> None:
        servo, limit = self._servo, int(setpoint / 100 * FULL_TORQUE)
        servo.write("torque_limit", limit)
        if test == "torque":
            servo.write("torque_control_mode", 1)
            servo.write("goal_torque", CLOCKWISE + limit)
        else:
            servo.write("goal_position", self.zero + _PRESS)

    def _approach(self) -> None:
        """Press the tips against each other by position control, at full effort."""
        self._servo.write("torque_control_mode", 0)
        self._servo.write("torque_limit", FULL_TORQUE)
        self._servo.write("goal_position", self.zero + _APPROACH)
        self._servo.sleep(1.0)

    def _release(self) -> None:
        """Open the fingers."""
        self._servo.write("torque_control_mode", 0)
        self._servo.write("torque_limit", FULL_TORQUE)
        self._servo.write("goal_position", self.zero + _OPEN)
        self._servo.sleep(_RELEASE)

    def _wait(self, waits: int | None) -> tuple[int, float]:
        """Return the position to log [counts], and when the spool stopped [s].

        The spool still creeps when it counts as stopped.
        """
        servo, stopped = self._servo, math.nan
        before = logged = servo.read("present_position")
        for wait in range(1, _MOST_WAITS + 1):
            servo.sleep(0.05)
            position = servo.read("present_position")
            if math.isnan(stopped) and abs(position - before) <= _UNMOVED:
                stopped = servo.time
            still = not math.isnan(stopped)
            if wait == waits or (waits is None and still):
                logged = position
            if still and wait >= (waits or 0):
                break
            before = position
        return logged, stopped

    def _measure(self) -> tuple[int, float]:
        """Wait half a second; return load, 0 .. 1023, and mean current [mA]."""
        servo = self._servo
        servo.sleep(0.5)
        currents = []
        for _ in range(5):
            servo.sleep(0.05)
            ticks = _ZERO_CURRENT - servo.read("current")
            currents.append(1e3 * (ticks * ControlTable1.current_unit))
        load = abs(decode_directed(servo.read("present_load")))
        return load, float(np.mean(currents))


class WatchedServo:
    """A servo on a bus; raises an error if it becomes too hot or reports a fault.

    Reading and writing take `TRANSACTION` each, as in the vendor's log.

    Args:
        bus: The bus, with Protocol 1.0.
        number: The servo's ID.
        hottest: Highest allowed temperature [degC].
        clock: Returns the time [s].
        pause: Waits [s].
    """

    def __init__(
        self,
        bus: ServoBus,
        number: int,
        hottest: float,
        clock: Callable[[], float] = wall.monotonic,
        pause: Callable[[float], None] = wall.sleep,
    ) -> None:
        self._bus, self._number, self._hottest = bus, number, hottest
        self._clock, self._pause = clock, pause

    @property
    def time(self) -> float:
        """Time [s]."""
        return self._clock()

    def read(self, name: str) -> int:
        """Return a register's value.

        Raises:
            BusError: If the servo does not reply, or refuses.
            RecordingError: If it reports a fault, or a temperature that is too high.
        """
        begun = self._clock()
        reply = self._bus.read_all([self._number], name)[self._number]
        if reply.fault:
            raise RecordingError(f"servo {self._number}: {reply.fault}")
        value = reply.values[name]
        if name == "present_temperature" and value > self._hottest:
            raise RecordingError(
                f"servo {self._number}: is at {value} degC (allowed: "
                f"{self._hottest:g}): let it cool"
            )
        self._wait_until(begun + TRANSACTION)
        return value

    def write(self, name: str, value: int) -> None:
        """Write a register.

        Raises:
            BusError: If the servo does not reply, or refuses.
        """
        begun = self._clock()
        self._bus.write(self._number, name, value)
        self._wait_until(begun + TRANSACTION)

    def sleep(self, duration: float) -> None:
        """Wait, and watch the temperature.

        Raises:
            BusError: If the servo does not reply, or refuses.
            RecordingError: If it is too hot, or reports a fault.
        """
        end = self._clock() + duration
        while end - self._clock() > TRANSACTION:
            self.read("present_temperature")
            self._wait_until(min(self._clock() + _LOOK, end))
        self._wait_until(end)

    def _wait_until(self, time: float) -> None:
        left = time - self._clock()
        if left > 0.0:
            self._pause(left)


@contextlib.contextmanager
def restored(servo: Registers) -> Iterator[None]:
    """Restore what a test changes, and switch the torque off, when the block ends.

    Raises:
        BusError: If the servo does not reply, or refuses.
        RecordingError: If it reports a fault at the start.
    """
    kept = {name: servo.read(name) for name in _KEPT}
    try:
        yield
    finally:
        # If one write fails, the others are tried nevertheless.
        with contextlib.ExitStack() as stack:
            for name, value in reversed(kept.items()):
                stack.callback(servo.write, name, value)
            stack.callback(servo.write, "torque_control_mode", 0)
            stack.callback(servo.write, "torque_enable", 0)


@dc.dataclass(frozen=True)
class Plan:
    """The set points of a test.

    The test takes three minutes on the vendor's gripper.

    Attributes:
        position: Limits of the PWM [percent].
        torque: Goal torques [percent].
        heating: Goal torques [percent], in rising order.
        calibration: See `PressTest`; a share, not percent.
        patience: Longest time for a heating row [s].
    """

    position: Sequence[float] = (20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0)
    torque: Sequence[float] = (20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 55.0, 60.0)
    heating: Sequence[float] = (45.0, 60.0)
    calibration: float = 0.3
    patience: float = 300.0


def record(servo: Registers, plan: Plan | None = None) -> Generator[LogRow, None, None]:
    """Test a gripper, and yield the rows of its log as they are measured.

    Even after an error, the torque is off at the end, and springs open the fingers.

    Args:
        servo: The gripper's servo, at rest, with nothing between the fingers.
        plan: The set points.

    Raises:
        BusError: If the servo does not reply, or refuses.
        RecordingError: If the servo is too hot, reports a fault, or warms too slowly.
    """
    plan = plan or Plan()
    with restored(servo):
        test = PressTest(servo, plan.calibration)
        for setpoint in plan.position:
            yield test.press("position", setpoint)
        for setpoint in plan.torque:
            yield test.press("torque", setpoint)
        for setpoint in plan.heating:
            yield test.heat(setpoint, plan.patience)
