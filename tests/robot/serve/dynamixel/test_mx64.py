import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.robot.serve.dynamixel.protocol import Error1, Instruction
from robot.serve.dynamixel.servo_with_master import ServoWithMaster

COUNT = math.tau / 4096  # rad


@pytest.fixture
def servo():
    return ServoWithMaster()


# Sensing.


def test_closing_lowers_the_position_by_sake_s_counts(servo):
    servo.move(angle=0.0)
    is_open = servo.read("present_position")
    servo.move(angle=2500 * COUNT)  # SAKE's counts from open to closed
    assert servo.read("present_position") == is_open - 2500
    # Both are within one turn, so that joint mode reaches them.
    assert is_open < 4096


def test_a_multi_turn_position_has_a_sign_an_offset_and_a_divider(servo):
    servo.move(angle=2 * math.tau)
    assert servo.read("present_position") == 3298  # joint mode ignores the two turns
    servo.send(Instruction.WRITE, [6, 0xFF, 0x0F, 0xFF, 0x0F])
    servo.move(angle=2 * math.tau)
    assert servo.read("present_position") == 3298 - 8192
    servo.write("resolution_divider", 2)
    servo.write("multi_turn_offset", -100)
    servo.move(angle=2 * math.tau)
    assert servo.read("present_position") == (3298 - 8192) // 2 - 100


def test_closing_has_clockwise_speed_and_load(servo):
    # Units are 0.114 rpm and 1/1023 of the stall torque; full PWM is 800.
    servo.move(speed=10 * 0.114 * math.tau / 60, pwm=0.5)
    assert servo.read("present_speed") == 1024 + 10
    assert servo.read("present_load") == 1024 + 400
    assert servo.read("moving") == 1
    servo.move(speed=-0.5 * math.tau / 60, pwm=-0.5)
    assert servo.read("present_speed") == 4
    assert servo.read("present_load") == 400
    servo.move()
    assert [servo.read(f"present_{x}") for x in ("speed", "load")] == [0, 0]
    assert servo.read("moving") == 0


def test_voltage_temperature_and_current_are_sensed(servo):
    servo.move(pwm=0.5, temperature=31.6)
    assert servo.read("present_voltage") == 120
    assert servo.read("present_temperature") == 32
    # 400/1023 of 4.1 A, in units of 4.5 mA; clockwise current lowers the value.
    assert servo.read("current") == 2048 - round(400 / 1023 * 4.1 / 4.5e-3)


# Commands.


def test_it_commands_nothing_until_a_master_moves_the_motor(servo):
    for name in ("led", "torque_limit", "goal_torque", "moving_speed", "lock"):
        servo.write(name, 1)
        assert servo.command() is None
    servo.write("torque_enable", 0)
    assert servo.command() is not None


def test_a_goal_position_enables_torque(servo):
    servo.move(angle=1.0)
    servo.write("goal_position", 3298 - 1000)
    assert servo.read("torque_enable") == 1
    command = servo.command()
    assert command.position == pytest.approx(1000 * COUNT)
    assert math.isnan(command.torque)
    assert command.limit == 1.0  # 1023 exceeds the drive's 800


@given(
    st.integers(-28672, 28672),
    st.integers(-24576, 24576),
    st.integers(1, 4),
)
def test_at_the_goal_angle_the_position_is_the_goal(goal, offset, divider):
    servo = ServoWithMaster()
    servo.send(Instruction.WRITE, [6, 0xFF, 0x0F, 0xFF, 0x0F])
    servo.write("multi_turn_offset", offset)
    servo.write("resolution_divider", divider)
    servo.write("goal_position", goal)
    servo.move(angle=servo.command().position)
    assert servo.read("present_position") == goal


def test_disabling_torque_frees_the_motor(servo):
    servo.write("goal_position", 2000)
    servo.write("torque_enable", 0)
    assert math.isnan(servo.command().position)
    assert servo.command().torque == 0.0


@pytest.mark.parametrize(("goal", "sign"), [(1024 + 100, 1), (100, -1), (1024, 0)])
def test_torque_control_winds_clockwise(servo, goal, sign):
    servo.write("torque_enable", 0)  # like SAKE's driver
    servo.write("torque_control_mode", 1)
    servo.write("goal_torque", goal)
    # 100 x 4.5 mA of 4.1 A at stall; full PWM gives 800/1023 of the stall torque.
    expected = sign * 0.45 / 4.1 * 1023 / 800
    assert servo.command().torque == pytest.approx(expected)
    assert math.isnan(servo.command().position)


def test_the_torque_limit_bounds_the_goal_torque_in_its_units(servo):
    servo.write("torque_control_mode", 1)
    servo.write("goal_torque", 1024 + 300)
    servo.write("torque_limit", 100)
    command = servo.command()
    assert command.torque == pytest.approx(0.45 / 4.1 * 1023 / 800)
    assert command.limit == 1.0


@pytest.mark.parametrize(("register", "kappa"), [(0, 0.0), (104, 0.13), (800, 1.0)])
def test_the_torque_limit_is_a_fraction_of_the_stall_torque(servo, register, kappa):
    servo.write("goal_position", 2000)
    servo.write("torque_limit", register)
    assert servo.command().limit == pytest.approx(kappa)


def test_a_moving_speed_limits_the_approach_to_the_goal(servo):
    servo.move(angle=0.0)
    servo.write("moving_speed", 100)
    servo.write("goal_position", 3298 - 2048)
    speed = 100 * 0.114 * math.tau / 60
    assert servo.command().position == pytest.approx(0.0)
    servo.move(lasting=1.0)
    assert servo.command().position == pytest.approx(speed)
    servo.move(lasting=3.0)
    assert servo.command().position == pytest.approx(math.pi)


@pytest.mark.parametrize(
    ("name", "value"),
    [("goal_position", 2000), ("torque_enable", 0), ("goal_torque", 1024 + 100)],
)
def test_a_released_servo_commands_nothing_until_a_new_motion(servo, name, value):
    servo.write("torque_control_mode", 1)
    servo.release()
    assert servo.command() is None
    servo.write("torque_limit", 104)
    assert servo.command() is None
    servo.write(name, value)
    assert servo.command() is not None


def test_a_profile_starts_where_another_source_has_left_the_motor(servo):
    servo.write("moving_speed", 100)
    servo.write("goal_position", 1000)
    servo.move(lasting=1.0)
    servo.release()
    servo.move(angle=2.0, lasting=1.0)
    servo.write("goal_position", 1000)
    assert servo.command().position == pytest.approx(2.0)


# Protection.


def overload(servo, lasting=10.1):
    servo.write("torque_limit", 500)
    servo.write("goal_position", 1000)
    servo.move(pwm=500 / 800, lasting=lasting)
    return servo.read("torque_limit"), Error1(servo.send(Instruction.PING)[0].code)


def test_an_overload_shuts_down_until_a_torque_limit_is_written(servo):
    assert overload(servo) == (0, Error1.OVERLOAD)
    assert servo.read("torque_enable") == 0
    assert servo.command().torque == servo.command().limit == 0.0
    assert servo.warned == ["overload"]
    # The sequence of check_overload_and_recover() in SAKE's driver.
    servo.write("goal_torque", 0)
    servo.write("torque_control_mode", 0)
    assert servo.write("torque_limit", 500) == Error1(0)
    servo.move()
    assert servo.write("led", 0) == Error1(0)
    # It stays off until a master enables torque.
    assert servo.command().torque == 0.0
    servo.write("goal_position", 3000)
    assert math.isfinite(servo.command().position)


def test_a_load_shorter_than_the_overload_time_is_allowed(servo):
    assert overload(servo, lasting=9.9) == (500, Error1(0))
    servo.move(pwm=0.0)
    servo.move(pwm=500 / 800, lasting=9.9)
    assert servo.read("torque_limit") == 500


def test_the_holding_torque_of_sake_s_driver_may_last(servo):
    servo.write("torque_control_mode", 1)
    servo.write("torque_limit", 104)
    servo.write("goal_torque", 1024 + 104)
    servo.move(pwm=104 / 800, lasting=60.0)
    assert servo.read("torque_limit") == 104


def test_a_load_caused_by_another_source_is_no_overload(servo):
    servo.write("goal_position", 1000)
    servo.write("torque_limit", 104)
    servo.release()
    servo.move(pwm=1.0 / 3.0, lasting=30.0)
    assert servo.read("torque_limit") == 104


def test_an_error_outside_the_shutdown_mask_is_only_reported(servo):
    servo.write("shutdown", 0)
    assert overload(servo) == (500, Error1.OVERLOAD)


def test_overheating_shuts_down_until_the_motor_has_cooled(servo):
    servo.write("goal_position", 1000)
    servo.move(temperature=80.0)
    assert servo.write("led", 1) == Error1(0)
    servo.move(temperature=81.0)
    assert servo.write("torque_limit", 500) == Error1.OVERHEATING
    servo.move(temperature=81.0)
    assert servo.command().limit == 0.0
    servo.move(temperature=79.0)
    assert servo.write("torque_limit", 500) == Error1(0)
    assert servo.warned == ["overheating"] * 2
