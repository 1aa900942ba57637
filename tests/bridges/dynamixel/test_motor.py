import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.bridges.dynamixel.motor import SpoolMotor
from drake_srg.gripper.drivers import SrgTendonDriver

MOTOR = SpoolMotor(SrgTendonDriver())  # 4.1 A at stall, full PWM is a duty of 800/1023
FULL = 800 / 1023


def test_the_current_at_rest_is_that_of_the_torque():
    state = MOTOR.sense(angle=1.0, speed=0.0, pwm=0.5, temperature=30.0)
    assert state.current == pytest.approx(0.5 * FULL * 4.1)
    assert MOTOR.torque(state.current) == pytest.approx(0.5)
    assert MOTOR.load(state.current) == pytest.approx(0.5 * FULL)
    assert MOTOR.limit_of_current(state.current, 0.0) == pytest.approx(0.5)


@given(st.floats(-1.0, 1.0), st.floats(-6.0, 6.0))
def test_a_duty_is_kept_at_every_speed(duty, speed):
    servo = SrgTendonDriver().servo
    torque = MOTOR.torque_of_duty(duty, speed)
    # As in `GripperServo`.
    pwm = torque + servo.current_control * servo.kff1[0] * speed
    assert pwm * FULL == pytest.approx(duty, abs=1e-12)


@given(st.floats(0.0, 8.0), st.floats(0.0, 6.0))
def test_a_current_limit_is_kept_on_the_way_to_the_goal(amperes, speed):
    limit = MOTOR.limit_of_current(amperes, speed)
    assert 0.0 <= limit <= 1.0
    assert MOTOR.sense(0.0, speed, limit, 25.0).current <= amperes + 1e-9
    assert limit >= min(MOTOR.torque(amperes), 1.0) - 1e-12


def test_a_limit_of_the_duty_ends_at_full_pwm():
    assert MOTOR.limit(-0.5 * FULL) == pytest.approx(0.5)
    assert MOTOR.limit(1.0) == 1.0
