import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.gripper import SrgTendonDriver
from drake_srg.robot.serve.dynamixel.servo import (
    JOINT,
    SPOOL,
    Profile,
    Shape,
    SpoolMotor,
)

STEP = 0.005
ways = st.floats(-5.0, 5.0)
accelerations = st.floats(0.5, 100.0)


def duration(profile, goal):
    """Return how long a profile takes, and its largest velocity [s, rad/s]."""
    steps, fastest = 0, 0.0
    while profile.position != goal:
        before = profile.position, profile.velocity
        profile.approach(goal, STEP)
        steps += 1
        fastest = max(fastest, abs(profile.velocity))
        assert steps < 100_000
        way = abs(profile.position - before[0])
        assert way <= profile.max_velocity * STEP * (1.0 + 1e-9)
        if profile.position != goal:
            change = abs(profile.velocity - before[1])
            assert change <= profile.max_acceleration * STEP * (1.0 + 1e-9)
    return steps * STEP, fastest


@given(ways, st.floats(0.5, 10.0), accelerations | st.just(math.inf))
def test_a_motion_arrives_in_its_time(goal, velocity, acceleration):
    taken, _ = duration(
        Profile(max_velocity=velocity, max_acceleration=acceleration), goal
    )
    way = abs(goal)
    if velocity**2 <= acceleration * way:
        expected = way / velocity + velocity / acceleration
    else:
        expected = 2.0 * math.sqrt(way / acceleration)
    assert taken == pytest.approx(expected, abs=4 * STEP, rel=0.01)


@given(st.lists(ways, min_size=2, max_size=4), accelerations)
def test_a_new_goal_changes_no_velocity_at_once(goals, acceleration):
    profile = Profile(max_velocity=3.0, max_acceleration=acceleration)
    for goal in goals:
        for _ in range(20):
            before = profile.velocity
            profile.approach(goal, STEP)
            if profile.position != goal:
                change = abs(profile.velocity - before)
                assert change <= acceleration * STEP * (1.0 + 1e-9)
    duration(profile, goals[-1])
    assert profile.velocity == 0.0


def test_without_limits_the_goal_is_reached_at_once():
    profile = Profile()
    profile.approach(2.0, 0.0)
    assert (profile.position, profile.velocity) == (2.0, 0.0)


def test_a_step_of_zero_length_moves_nothing():
    profile = Profile(max_velocity=1.0)
    profile.approach(2.0, 0.0)
    profile.run(1.0, 0.0)
    assert (profile.position, profile.velocity) == (0.0, 0.0)


def test_running_ramps_up_to_a_velocity():
    profile = Profile(max_acceleration=2.0)
    for _ in range(100):
        profile.run(-0.5, STEP)
    assert profile.velocity == -0.5
    assert profile.position == pytest.approx(-0.5 * (0.5 - 0.125), abs=0.5 * STEP)


@pytest.mark.parametrize(
    ("velocity", "acceleration", "shape"),
    [
        (math.inf, 1.0, Shape.STEP),
        (1.0, math.inf, Shape.RECTANGULAR),
        (1.0, 0.4, Shape.TRIANGULAR),
        (1.0, 0.6, Shape.TRAPEZOIDAL),
    ],
)
def test_limits_and_way_decide_the_shape(velocity, acceleration, shape):
    profile = Profile(max_velocity=velocity, max_acceleration=acceleration)
    assert profile.shape(-2.0) is shape


@given(st.sampled_from([SPOOL, JOINT]), st.floats(-1e3, 1e3))
def test_angles_and_counts_are_inverse(encoder, angle):
    assert encoder.to_angle(encoder.to_counts(angle)) == pytest.approx(angle, abs=1e-9)


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
