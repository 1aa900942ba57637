"""The vendor's test of its gripper, run on a simulated one by its servo's registers.

As the script behind the vendor's log: calibrate; then, for each set point, approach a
position 50 counts beyond closed at full effort, wait 1 s, press, read the position
every 50 ms until it changes by 5 counts or less, wait 0.5 s, read the current. So its
time "until it stopped" is mostly its own wait of 1 s; it times no closing.
"""

from __future__ import annotations

import math

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from drake_srg.experiments.servo_stand import ServoStand
from drake_srg.gripper.driver import WireMotor
from drake_srg.gripper.tendon import MotorTemperature
from drake_srg.robot.identify.fits import NEVER, RISE, polls
from drake_srg.robot.identify.log import LogRow
from drake_srg.robot.serve.dynamixel.registers import CLOCKWISE, FULL_TORQUE
from drake_srg.scenario import Scenario
from drake_srg.simulation.rig import bench_scenario

_APPROACH, _PRESS = -50, -250  # goals, from closed [counts]
_UNMOVED, _MOST_WAITS = 5, 30  # counts; 2 s
_RELEASE = 0.5  # s; the vendor's 10 s change nothing more
# At this share of the torque, calibration closes as hard as the presses do.
_CALIBRATION = 0.95


def press_bench(scenario: str, most: float, position_gain: float) -> Scenario:
    """Return an empty bench whose servo has the firmware's position control.

    That is proportional, without a smooth reference. The palm points to the front, so
    that the fingers' weight does not act along their motion.

    Args:
        scenario: The bench.
        most: Largest PWM of the servo, 0 .. 1.
        position_gain: Of the position control [PWM of 1023 per count].
    """
    gain = position_gain / FULL_TORQUE * 4096 / (2.0 * np.pi) / most
    return bench_scenario(
        gripper_rpy=[0.0, 0.0, 0.0],
        scenario=scenario,
        overrides=[
            "object.present=false",
            f"gripper.drive.full_scale={most}",
            f"gripper.servo.kp=[{gain}]",
            "gripper.servo.kff1=[0.0]",
            "gripper.servo.kff2=[0.0]",
            "gripper.minimum_jerk={max_velocity: 100.0, min_duration: 0.01}",
        ],
    )


class VendorTest:
    """Presses the tips on each other, as the vendor did.

    Args:
        stand: The gripper, open.
    """

    def __init__(self, stand: ServoStand) -> None:
        self._stand = stand
        for name in ("cw_angle_limit", "ccw_angle_limit"):  # multi-turn
            stand.write(name, 4095)
        stand.write("torque_enable", 0)
        stand.write("torque_control_mode", 1)
        stand.write("goal_torque", CLOCKWISE + int(_CALIBRATION * FULL_TORQUE))
        stand.sleep(2.0)
        self.zero = stand.read("present_position")
        # The vendor's calibration leaves 1 %, which the first press starts from.
        stand.write("goal_torque", CLOCKWISE + FULL_TORQUE // 100)
        stand.write("torque_control_mode", 0)

    def press(self, asked: LogRow) -> LogRow:
        """Return what the registers show at a row's set point."""
        stand, limit = self._stand, int(asked.setpoint_pct / 100 * FULL_TORQUE)
        started = stand.rig.time
        stand.write("torque_control_mode", 0)
        stand.write("torque_limit", FULL_TORQUE)
        stand.write("goal_position", self.zero + _APPROACH)
        stand.sleep(1.0)
        if asked.test == "torque":
            started = stand.rig.time
        stand.write("torque_limit", limit)
        if asked.test == "torque":
            stand.write("torque_control_mode", 1)
            stand.write("goal_torque", CLOCKWISE + limit)
        else:
            stand.write("goal_position", self.zero + _PRESS)
        stop, seconds = self._wait(polls(asked))
        seconds -= started
        stand.sleep(0.5)
        current = np.mean([self._current() for _ in range(5)])
        load = stand.read_load()
        stand.write("torque_control_mode", 0)
        stand.sleep(_RELEASE)
        return LogRow(
            asked.test, asked.setpoint_pct, load, stop, float(current), seconds
        )

    def _current(self) -> float:
        self._stand.sleep(0.05)
        return 1e3 * self._stand.read_current()

    def _wait(self, until: int) -> tuple[int, float]:
        """Return the position after some waits, and when it has stopped changing [s].

        The spool still creeps when the vendor's test takes it for stopped. So positions
        are compared when the vendor read them.
        """
        stand, stopped = self._stand, math.nan
        before = read = stand.read("present_position")
        for wait in range(1, _MOST_WAITS + 1):
            stand.sleep(0.05)
            position = stand.read("present_position")
            if wait == until:
                read = position
            if math.isnan(stopped) and abs(position - before) <= _UNMOVED:
                stopped = stand.rig.time
            if wait >= until and not math.isnan(stopped):
                break
            before = position
        return read, stopped


def warm(motor: WireMotor, row: LogRow) -> float:
    """Return the time for a resting motor to warm by `RISE` at a row's current [s].

    Args:
        motor: The motor.
        row: Of the test `heating`.
    """
    drive, heat = motor.drive, motor.temperature
    load = row.current_ma / 1e3 / heat.stall_current
    pwm = drive.pwm_of(load / drive.full_scale)
    builder = DiagramBuilder()
    system = builder.AddSystem(MotorTemperature(drive, heat))
    for name, value in (("pwm", [pwm]), ("motor_state", [0.0, 0.0])):
        source = builder.AddSystem(ConstantVectorSource(value))
        builder.Connect(source.get_output_port(), system.GetInputPort(name))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = system.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    context.SetDiscreteState([row.temperature_c])
    for time in np.arange(heat.period, NEVER, heat.period):
        simulator.AdvanceTo(time)
        if system.get_output_port().Eval(context)[0] >= row.temperature_c + RISE:
            return float(time)
    return NEVER
