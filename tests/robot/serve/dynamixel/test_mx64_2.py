"""The motor of an MX-64 with Protocol 2.0."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.robot.serve.dynamixel.protocol import ALERT, Instruction, Refusal
from drake_srg.robot.serve.dynamixel.registers import Mode
from robot.serve.dynamixel.servo_with_master import ServoWithMaster2

COUNT = math.tau / 4096  # rad
OPEN = 3298  # position of the open gripper
RPM = math.tau / 60  # rad/s
FULL = 800 / 1023  # of the supply voltage at full PWM


@pytest.fixture
def servo():
    servo = ServoWithMaster2()
    servo.move()
    return servo


def switch_on(servo, mode=Mode.POSITION, **registers):
    assert servo.write("operating_mode", mode) == 0
    for name, value in registers.items():
        assert servo.write(name, value) == 0
    assert servo.write("torque_enable", 1) == 0


# Sensing.


def test_closing_lowers_position_velocity_current_and_pwm(servo):
    servo.move(angle=100 * COUNT, speed=22.9 * RPM, pwm=0.5)
    assert servo.read("present_position") == OPEN - 100
    assert servo.read("present_velocity") == -100
    assert servo.read("present_pwm") == -round(0.5 * FULL * 885)
    load = 0.5 * FULL - 22.9 * RPM / 6.6
    assert servo.read("present_current") == -round(load * 4.1 / 3.36e-3)
    assert servo.read("moving") == 1
    servo.move(angle=100 * COUNT, speed=2.2 * RPM)
    assert servo.read("moving") == 0


def test_reverse_mode_changes_all_signs(servo):
    servo.write("drive_mode", 1)
    servo.write("operating_mode", Mode.EXTENDED_POSITION)
    servo.move()
    at_rest = servo.read("present_position")
    servo.move(angle=100 * COUNT, speed=22.9 * RPM, pwm=0.9)
    assert servo.read("present_position") == at_rest + 100
    assert servo.read("present_velocity") == 100
    assert servo.read("present_pwm") > 0
    assert servo.read("present_current") > 0


def test_temperature_voltage_and_time_are_sensed():
    servo = ServoWithMaster2(supply_voltage=14.8)
    servo.now = 40.0 - 0.005
    servo.move(temperature=31.6)
    assert servo.read("present_temperature") == 32
    assert servo.read("present_voltage") == 148
    assert servo.read("realtime_tick") == 40_000 - 32_768


@pytest.mark.parametrize(("mode", "turns"), [(Mode.POSITION, 0), (Mode.CURRENT, -2)])
def test_only_position_mode_ignores_full_turns(servo, mode, turns):
    servo.write("operating_mode", mode)
    servo.move(angle=2 * math.tau)
    assert servo.read("present_position") == OPEN + 4096 * turns


@pytest.mark.parametrize("code", ["reboot", "clear"])
def test_full_turns_are_forgotten(servo, code):
    servo.write("operating_mode", Mode.EXTENDED_POSITION)
    servo.move(angle=2 * math.tau)
    if code == "reboot":
        servo.send(Instruction.REBOOT)
    else:
        servo.send(Instruction.CLEAR, b"\x01\x44\x58\x4c\x22")
    assert servo.read("present_position") == OPEN


def test_turns_cannot_be_cleared_in_motion(servo):
    servo.write("operating_mode", Mode.EXTENDED_POSITION)
    servo.move(angle=2 * math.tau, speed=1.0)
    (status,) = servo.send(Instruction.CLEAR, b"\x01\x44\x58\x4c\x22")
    assert servo.error(status) == Refusal.FAILED
    assert servo.read("present_position") == OPEN - 8192


# Commands.


def test_it_commands_nothing_until_torque_is_switched(servo):
    for name in ("led", "goal_current", "goal_pwm", "goal_position", "operating_mode"):
        servo.write(name, 1)
        assert servo.command() is None
    servo.write("torque_enable", 0)
    assert servo.command().torque == 0.0


def test_switching_on_holds_the_position(servo):
    servo.write("goal_position", 1000)  # not performed
    servo.write("homing_offset", 500)
    servo.move(angle=0.7)
    servo.write("torque_enable", 1)
    assert servo.read("goal_position") == servo.read("present_position")
    assert servo.command().position == pytest.approx(0.7, abs=COUNT)


@given(
    st.sampled_from([Mode.EXTENDED_POSITION, Mode.CURRENT_BASED_POSITION]),
    st.integers(-1048575, 1048575),
    st.integers(-1044479, 1044479),
    st.sampled_from([0, 1, 4, 5]),
    st.floats(-100.0, 100.0),
)
def test_at_the_goal_angle_the_position_is_the_goal(mode, goal, offset, drive, start):
    servo = ServoWithMaster2()
    servo.move(angle=start)
    switch_on(servo, mode, homing_offset=offset, drive_mode=drive)
    servo.write("goal_position", goal)
    servo.move(angle=servo.command().position)
    assert servo.read("present_position") == goal
    assert servo.read("moving_status") & 3 == 1  # in position


def test_goal_current_is_the_torque_in_current_mode(servo):
    switch_on(servo, Mode.CURRENT)
    assert servo.command().torque == 0.0
    servo.write("goal_current", -300)
    command = servo.command()
    assert command.torque == pytest.approx(300 * 3.36e-3 / 4.1 / FULL)
    assert math.isnan(command.position)
    servo.write("goal_current", 300)
    assert servo.command().torque == pytest.approx(-command.torque)


def test_goal_pwm_is_the_duty_in_pwm_mode(servo):
    switch_on(servo, Mode.PWM)
    assert servo.command().torque == 0.0
    servo.write("goal_pwm", -400)
    assert servo.command().torque == pytest.approx(400 / 885 / FULL)


@pytest.mark.parametrize("mode", [Mode.CURRENT, Mode.VELOCITY, Mode.POSITION, 4, 5])
def test_goal_pwm_limits_the_pwm_in_other_modes(servo, mode):
    switch_on(servo, mode)
    assert servo.command().limit == 1.0
    servo.write("goal_pwm", 177)
    assert servo.command().limit == pytest.approx(0.2 / FULL)


def test_goal_current_limits_the_torque_of_current_based_position(servo):
    switch_on(servo, Mode.CURRENT_BASED_POSITION)
    servo.write("goal_current", 200)
    servo.write("goal_position", OPEN - 1000)
    command = servo.command()
    assert command.position == pytest.approx(1000 * COUNT)
    assert command.limit == pytest.approx(200 * 3.36e-3 / 4.1 / FULL)
    # Back-EMF takes nothing of it on the way.
    servo.move(angle=0.5, speed=3.0)
    assert servo.command().limit > command.limit
    servo.move(angle=2.5, speed=3.0)
    assert servo.command().limit < command.limit
    servo.write("goal_pwm", 50)
    servo.move(angle=0.5, speed=3.0)
    assert servo.command().limit == pytest.approx(50 / 885 / FULL)


def test_goal_velocity_moves_the_target_a_little_ahead(servo):
    switch_on(servo, Mode.VELOCITY)
    servo.write("goal_velocity", -100)
    servo.move(lasting=0.1)
    assert servo.command().position == pytest.approx(0.1 * 22.9 * RPM)
    servo.move(lasting=10.0)  # blocked
    assert servo.command().position == pytest.approx(0.5)
    servo.write("goal_velocity", 0)
    servo.move(angle=0.1, lasting=0.01)
    assert servo.read("velocity_trajectory") == 0


def test_the_profile_moves_the_target(servo):
    switch_on(servo, Mode.CURRENT_BASED_POSITION, profile_velocity=100)
    servo.write("goal_position", OPEN - 2048)
    servo.move(lasting=0.5)
    assert servo.command().position == pytest.approx(0.5 * 22.9 * RPM)
    assert servo.read("velocity_trajectory") == -100
    assert servo.read("moving_status") == 0x12  # rectangular, ongoing
    assert servo.read("moving") == 1
    servo.move(lasting=1.0)
    assert servo.command().position == pytest.approx(math.pi)
    assert servo.read("position_trajectory") == OPEN - 2048
    assert servo.read("moving_status") == 0x10  # the motor is not there


@pytest.mark.parametrize("registers", [{"drive_mode": 4}, {"acceleration_limit": 0}])
def test_a_goal_where_the_target_is_ends_the_motion(servo, registers):
    """Ramps may last, or allow no acceleration."""
    ramps = {"profile_velocity": 100, "profile_acceleration": 20}
    switch_on(servo, **registers, **ramps)
    for _ in range(2):
        servo.write("goal_position", OPEN)
        servo.move(lasting=0.5)
        assert servo.read("moving") == 0
        assert servo.command().position == 0.0
    # Switching on moves the goal, and makes no new profile.
    servo.write("torque_enable", 0)
    servo.move(angle=0.7)
    servo.write("torque_enable", 1)
    servo.move(angle=0.7, lasting=0.5)
    assert servo.read("moving") == 0


def test_a_new_operating_mode_resets_goals_and_profile(servo):
    for name in ("profile_velocity", "goal_pwm", "goal_current"):
        servo.write(name, 50)
    servo.write("operating_mode", Mode.CURRENT_BASED_POSITION)
    values = [servo.read(f"goal_{x}") for x in ("pwm", "current", "velocity")]
    assert values == [885, 1941, 0]
    assert servo.read("profile_velocity") == 0
    servo.write("current_limit", 1000)
    assert servo.read("goal_current") == 1000


@pytest.mark.parametrize(
    ("mode", "goal", "value"),
    [(0, "goal_current", -9), (1, "goal_velocity", 9), (4, "goal_position", 5000)],
)
def test_a_released_servo_commands_nothing_until_a_new_goal(servo, mode, goal, value):
    switch_on(servo, mode)
    servo.release()
    assert servo.command() is None
    servo.write("goal_pwm", 100)
    assert servo.command() is None
    servo.write(goal, value)
    assert servo.command() is not None


# Protection.


def overload(servo, lasting):
    switch_on(servo, Mode.CURRENT_BASED_POSITION)
    servo.write("goal_current", 500)
    servo.write("goal_position", 1000)
    servo.move(pwm=servo.command().limit, lasting=lasting)


def test_an_overload_lasts_until_a_reboot(servo):
    overload(servo, lasting=10.1)
    assert servo.read("torque_enable") == 0
    assert servo.read("hardware_error_status") == 32
    assert servo.command().torque == 0.0
    assert servo.write("torque_enable", 1) == ALERT
    assert servo.read("torque_enable") == 0
    assert servo.error(servo.send(Instruction.PING)[0]) == ALERT
    assert servo.warned == ["overload"]
    servo.send(Instruction.REBOOT)
    servo.move()
    assert servo.write("torque_enable", 1) == 0
    assert servo.read("operating_mode") == Mode.CURRENT_BASED_POSITION  # in the EEPROM
    assert servo.read("goal_current") == 1941  # in the RAM


def test_a_short_or_small_load_is_allowed(servo):
    overload(servo, lasting=9.9)
    assert servo.read("hardware_error_status") == 0
    servo.write("goal_current", 200)  # 0.67 A
    servo.move(pwm=servo.command().limit, lasting=12.0)
    assert servo.read("hardware_error_status") == 0


def test_overheating_outside_the_shutdown_mask_is_only_reported(servo):
    switch_on(servo, shutdown=32)
    servo.move(temperature=81.0)
    assert servo.read("hardware_error_status") == 4
    assert servo.write("goal_position", 2000) == ALERT
    assert math.isfinite(servo.command().position)


@pytest.mark.parametrize("mode", Mode)
def test_the_bus_watchdog_stops_the_motor(servo, mode):
    switch_on(servo, mode)
    goal = servo.table.goal
    servo.write("bus_watchdog", 10)  # 0.2 s
    servo.write(goal, 400)
    servo.move(angle=1.0, lasting=0.15)
    servo.read("led")
    servo.move(angle=1.0, lasting=0.15)
    assert servo.read("bus_watchdog") == 10
    servo.move(angle=1.0, lasting=0.205)
    assert servo.read("bus_watchdog") == -1
    command = servo.command()
    held = command.torque if math.isnan(command.position) else command.position - 1.0
    assert held == pytest.approx(0.0, abs=COUNT)
    assert servo.write(goal, 400) == Refusal.RANGE
    assert servo.write("bus_watchdog", 0) == 0
    assert servo.write(goal, 400) == 0
