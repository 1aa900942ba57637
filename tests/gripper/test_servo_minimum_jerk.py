import numpy as np
import pytest
from helpers import fix, read, update
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from drake_srg.gripper.servo import (
    MinimumJerkConfig,
    MinimumJerkReference,
    minimum_jerk_coefficients,
)

position = st.floats(-2.0, 2.0)
speed = st.floats(-4.0, 4.0)
acceleration = st.floats(-50.0, 50.0)
duration = st.floats(0.08, 2.0)


def quintic(q, v, a, target, duration):
    """The motion as a polynomial in time."""
    c = minimum_jerk_coefficients(q, v, a, target, duration)
    return Polynomial(np.array(c) / duration ** np.arange(6))


@given(position, speed, acceleration, position, duration)
def test_a_quintic_joins_its_ends(q, v, a, target, duration):
    p = quintic(q, v, a, target, duration)
    ends = [p.deriv(k)(0.0) if k else p(0.0) for k in range(3)]
    assert ends == pytest.approx([q, v, a], abs=1e-9)
    # Rounding grows with 1/duration², at most 156, times the size of the coefficients.
    ends = [p.deriv(k)(duration) if k else p(duration) for k in range(3)]
    assert ends == pytest.approx([target, 0.0, 0.0], abs=1e-9)


@given(
    start=st.tuples(position, speed, acceleration),
    target=position,
    duration=duration,
    bend=st.lists(st.floats(-1, 1), min_size=1, max_size=3),
)
def test_no_other_polynomial_between_the_same_ends_has_less_jerk(
    start, target, duration, bend
):
    assume(max(map(abs, bend)) > 1e-3)
    p = quintic(*start, target, duration)
    # It and its first two derivatives are zero at both ends, so it changes neither.
    bump = Polynomial([0, 1 / duration]) ** 3 * Polynomial([1, -1 / duration]) ** 3
    other = p + bump * Polynomial(bend)

    def cost(motion):
        integral = (motion.deriv(3) ** 2).integ()
        return integral(duration) - integral(0.0)

    # The bump adds its own jerk, which is orthogonal to the quintic's.
    assert cost(other) > cost(p) * (1 - 1e-12)
    assert cost(other) - cost(p) == pytest.approx(cost(other - p), rel=1e-3)


# The system.


def make(initial, **config):
    system = MinimumJerkReference(np.array(initial), MinimumJerkConfig(**config))
    context = system.CreateDefaultContext()
    fix(system, context, position_desired=np.array(initial))
    return system, context


def retarget(system, context, target, time):
    fix(system, context, position_desired=np.array(target))
    update(system, context, time)


def at(system, context, time):
    """Return the rows q, v, a at a time."""
    context.SetTime(time)
    return read(system, context, "reference").reshape(3, -1)


def test_it_rests_where_it_starts():
    system, context = make([0.3, -0.1])
    update(system, context)
    expected = [[0.3, -0.1], [0, 0], [0, 0]]
    np.testing.assert_array_equal(at(system, context, 0.0), expected)
    np.testing.assert_array_equal(at(system, context, 5.0), expected)


def test_the_reference_can_be_put_at_rest_elsewhere():
    system, context = make([0.0, 0.0])
    retarget(system, context, [1.0, 1.0], 0.0)
    system.SetPosition(context, np.array([0.5, 0.6]))
    np.testing.assert_array_equal(
        at(system, context, 0.1), [[0.5, 0.6], [0, 0], [0, 0]]
    )


@given(
    changes=st.lists(
        st.tuples(st.floats(0.0, 1.0), position, position), min_size=1, max_size=5
    )
)
def test_position_velocity_and_acceleration_are_continuous(changes):
    system, context = make([0.0, 0.0])
    time = 0.0
    for wait, *target in changes:
        time += wait
        before = at(system, context, time)
        retarget(system, context, target, time)
        # Only rounding differs: accelerations reach some 1e3 rad/s².
        np.testing.assert_allclose(at(system, context, time), before, atol=1e-9)
    end = at(system, context, time + 10.0)
    np.testing.assert_allclose(end[0], changes[-1][1:], atol=1e-12)
    np.testing.assert_allclose(end[1:], 0.0, atol=1e-9)


def test_the_output_is_the_derivative_of_itself():
    system, context = make([0.0])
    retarget(system, context, [1.0], 0.0)
    retarget(system, context, [-0.5], 0.2)
    h = 1e-5
    for time in np.arange(0.21, 1.2, 0.07):
        low, mid, high = (at(system, context, time + dt) for dt in (-h, 0, h))
        # The error of central differences is h² times the jerk's rate, below 1e-5.
        np.testing.assert_allclose((high - low)[:2] / (2 * h), mid[1:], atol=1e-5)


@given(position, position, st.floats(0.1, 10.0))
def test_from_rest_to_rest_the_peak_speed_is_the_limit(start, target, limit):
    assume(abs(target - start) > 1e-6)
    system, context = make([start], max_velocity=limit, min_duration=0.08)
    retarget(system, context, [target], 0.0)
    duration = max(0.08, 15 / 8 * abs(target - start) / limit)
    speeds = [
        abs(at(system, context, t)[1, 0]) for t in duration * np.arange(0, 1, 0.05)
    ]
    assert max(speeds) <= limit * (1 + 1e-9)
    if duration > 0.08:
        assert max(speeds) == pytest.approx(limit)  # half way
    end = at(system, context, duration)[0]
    np.testing.assert_allclose(end, [target], atol=1e-12)


def test_small_corrections_take_the_shortest_duration():
    system, context = make([0.0], min_duration=0.08)
    retarget(system, context, [0.01], 0.0)
    assert at(system, context, 0.079)[0, 0] < 0.01
    assert at(system, context, 0.08)[0, 0] == pytest.approx(0.01)


def test_joints_move_independently():
    system, context = make([0.0, 0.0])
    retarget(system, context, [1.0, 0.0], 0.0)
    alone, alone_context = make([0.0, 0.0])
    retarget(alone, alone_context, [1.0, 0.0], 0.0)
    retarget(system, context, [1.0, -0.4], 0.2)
    for time in (0.25, 0.4, 0.6):
        expected = at(alone, alone_context, time)[:, 0]
        np.testing.assert_array_equal(at(system, context, time)[:, 0], expected)


def test_a_target_that_stays_restarts_nothing():
    system, context = make([0.0])
    retarget(system, context, [1.0], 0.0)
    expected = at(system, context, 0.3)
    retarget(system, context, [1.0], 0.25)
    np.testing.assert_array_equal(at(system, context, 0.3), expected)
