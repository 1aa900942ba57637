import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.bridges.dynamixel.profile import Profile, Shape

STEP = 0.005
velocities = st.floats(0.1, 10.0)
accelerations = st.floats(0.1, 100.0)


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


@given(st.floats(-20.0, 20.0), velocities, accelerations)
def test_a_trapezoid_arrives_in_its_time(goal, velocity, acceleration):
    taken, _ = duration(
        Profile(max_velocity=velocity, max_acceleration=acceleration), goal
    )
    way = abs(goal)
    if velocity**2 <= acceleration * way:
        expected = way / velocity + velocity / acceleration
    else:
        expected = 2.0 * math.sqrt(way / acceleration)
    assert taken == pytest.approx(expected, abs=4 * STEP, rel=0.01)


@given(st.floats(-20.0, 20.0), velocities)
def test_a_rectangle_arrives_in_its_time(goal, velocity):
    taken, _ = duration(Profile(max_velocity=velocity), goal)
    assert taken == pytest.approx(abs(goal) / velocity, abs=2 * STEP)


@given(st.lists(st.floats(-20.0, 20.0), min_size=2, max_size=4), accelerations)
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
