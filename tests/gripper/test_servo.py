import dataclasses as dc

import numpy as np
import pytest
from helpers import fix, read, update
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from drake_srg.gripper.servo import (
    GripperServo,
    GripperServoConfig,
    MinimumJerkConfig,
    MinimumJerkReference,
    minimum_jerk_coefficients,
)

GAINS = GripperServoConfig(
    kp=[2.0, 1.0], ki=[0.5, 0.0], kd=[0.1, 0.2], kff1=[0.03, 0.02], kff2=[1e-3, 2e-3]
)
# [q; v; a] and [q; v] of two joints that keep the PWM below 1.
REFERENCE = np.array([0.3, 0.2, 1.0, -0.5, 5.0, 6.0])
MEASURED = np.array([0.2, 0.25, 0.6, 0.1])
TARGET = np.array([0.35, 0.1])
# By hand: kff1 v + kff2 a + kp e + kd (v - v measured)
PID = np.array(
    [
        0.03 * 1.0 + 1e-3 * 5.0 + 2.0 * 0.1 + 0.1 * 0.4,
        0.02 * -0.5 + 2e-3 * 6.0 + 1.0 * -0.05 + 0.2 * -0.6,
    ]
)


def make(reference=REFERENCE, measured=MEASURED, config=GAINS, **changes):
    servo = GripperServo(dc.replace(config, **changes))
    context = servo.CreateDefaultContext()
    fix(servo, context, reference=reference, state_measured=measured)
    return servo, context


def pwm(servo, context):
    update(servo, context)
    return read(servo, context, "pwm")


def test_the_law_agrees_with_a_computation_by_hand():
    assert pwm(*make()) == pytest.approx(PID)


def test_the_integral_accumulates():
    servo, context = make()
    for k in range(4):
        # 0.5 of K_I, an error of 0.1, k periods of 5 ms; the second joint has no K_I.
        expected = [PID[0] + 0.5 * 0.1 * 0.005 * k, PID[1]]
        assert pwm(servo, context) == pytest.approx(expected)


def test_without_feedback_gains_the_feedforward_remains():
    zero = [0.0, 0.0]
    result = pwm(*make(kp=zero, ki=zero, kd=zero))
    assert result == pytest.approx([0.03 + 0.005, -0.01 + 0.012])


def test_the_pwm_is_held_between_updates():
    servo, context = make()
    assert read(servo, context, "pwm").tolist() == [0.0, 0.0]
    before = pwm(servo, context)
    fix(servo, context, reference=np.zeros(6))
    context.SetTime(0.004)
    assert np.array_equal(read(servo, context, "pwm"), before)


@pytest.mark.parametrize(
    ("port", "kappa"), [(None, 0.4), (0.2, 0.2), (0.0, 0.0), (-1.0, 0.0), (3.0, 1.0)]
)
def test_the_pwm_is_clipped_to_kappa(port, kappa):
    far = np.array([9.0, -9.0, 0, 0, 0, 0])
    servo, context = make(reference=far, force_limit=0.4)
    if port is not None:
        fix(servo, context, force_limit=port)
    assert pwm(servo, context).tolist() == [kappa, -kappa]


@given(st.lists(st.floats(-1e3, 1e3), min_size=6, max_size=6), st.floats(-2, 2))
def test_no_reference_exceeds_the_limit(reference, kappa):
    servo, context = make(reference=np.array(reference))
    fix(servo, context, force_limit=kappa)
    for _ in range(3):
        assert np.max(np.abs(pwm(servo, context))) <= np.clip(kappa, 0, 1)


def samples_until_reversal(tracking_time):
    """Saturate the servo for 1 s, reverse the error, and count until it follows."""
    servo, context = make(
        np.array([1.0, 0, 0]),
        np.zeros(2),
        GripperServoConfig(kp=[2.0], ki=[4.0], kd=[0.0], kff1=[0.0], kff2=[0.0]),
        tracking_time=tracking_time,
    )
    for _ in range(200):
        assert pwm(servo, context)[0] == 1.0
    fix(servo, context, reference=np.array([-0.2, 0, 0]))
    for count in range(10_000):
        if pwm(servo, context)[0] < 0.0:
            return count
    raise AssertionError("never reversed")


def test_anti_windup_recovers_faster_than_without():
    # Without it, 4 PWM/s pile up for a second, and 0.8 PWM/s take seconds to undo that.
    # With it, the integral just keeps the output at the limit.
    assert samples_until_reversal(1e9) > 500
    assert samples_until_reversal(0.05) < 100


def test_gains_of_different_lengths_are_refused():
    with pytest.raises(ValueError, match=r"one entry per motor .* \[2, 2, 1, 2, 2\]"):
        make(kd=[0.1])


def test_a_finite_torque_overrides_the_reference():
    servo, context = make(measured=np.zeros(4))
    fix(servo, context, torque_commanded=[0.3, np.nan])
    torque, position = pwm(servo, context)
    assert torque == pytest.approx(0.3)
    assert position == pwm(*make(measured=np.zeros(4)))[1]


@pytest.mark.parametrize(
    ("torque", "expected"), [(0.9, 0.4), (-0.9, -0.4), (0.0, 0.0), (0.2, 0.2)]
)
def test_a_torque_has_the_same_limit_as_position_control(torque, expected):
    servo, context = make(measured=np.zeros(4))
    fix(servo, context, torque_commanded=[torque] * 2, force_limit=0.4)
    assert pwm(servo, context) == pytest.approx([expected] * 2)


def test_under_torque_control_the_pwm_rises_with_the_speed():
    servo, context = make(current_control=0.5)
    fix(servo, context, torque_commanded=[0.1, 0.1], force_limit=0.2)
    # Half of K_FF1 v: 0.03 * 0.6 and 0.02 * 0.1.
    assert pwm(servo, context) == pytest.approx([0.1 + 0.009, 0.1 + 0.001])
    fix(servo, context, state_measured=[0, 0, 1e3, -1e3])
    assert pwm(servo, context).tolist() == [1.0, -1.0]


def test_the_integral_does_not_change_under_torque_control():
    servo, context = make()
    fix(servo, context, torque_commanded=[0.1, np.nan])
    for _ in range(10):
        update(servo, context)
    fix(servo, context, torque_commanded=[np.nan] * 2)
    assert pwm(servo, context) == pytest.approx(PID)


def test_a_limit_of_nan_leaves_the_configured_one():
    far = np.array([9.0, 9.0, 0.0, 0.0, 0.0, 0.0])
    servo, context = make(reference=far, force_limit=0.3)
    fix(servo, context, force_limit=np.nan)
    assert pwm(servo, context) == pytest.approx([0.3, 0.3])


STEPS = st.integers(1, 2000)


@given(
    st.lists(st.floats(-2, 2), min_size=6, max_size=6),
    st.floats(0, 1),
    STEPS,
    st.floats(-2, 2) | st.just(np.nan),
)
def test_steps_are_the_next_lower_ones_within_the_limit(values, kappa, steps, torque):
    servo, context = make(np.array(values))
    stepped, stepped_context = make(np.array(values), pwm_steps=steps)
    for system, its_context in ((servo, context), (stepped, stepped_context)):
        fix(system, its_context, force_limit=kappa, torque_commanded=[torque, np.nan])
    count = steps * pwm(stepped, stepped_context)
    np.testing.assert_allclose(count, np.round(count), atol=1e-9)
    limit = steps * np.array([kappa if np.isnan(torque) else 1.0, kappa])
    assert np.all(np.abs(count) <= limit + 1e-9)
    below = np.maximum(np.floor(steps * pwm(servo, context)), -np.floor(limit))
    np.testing.assert_allclose(count, below, atol=1e-9)


@given(STEPS)
def test_full_scale_is_a_whole_step(steps):
    far = np.array([9.0, -9.0, 0, 0, 0, 0])
    assert pwm(*make(far, pwm_steps=steps)).tolist() == [1.0, -1.0]


def test_without_steps_the_pwm_is_continuous():
    assert np.array_equal(pwm(*make(pwm_steps=0)), pwm(*make()))


def test_steps_do_not_move_the_integral():
    servo, context = make(pwm_steps=10)
    for _ in range(50):
        update(servo, context)
    integral = context.get_discrete_state(0).value()[0]
    assert integral == pytest.approx(0.5 * 0.1 * 0.005 * 50)


@pytest.mark.parametrize(
    ("law", "error"),
    [
        ("printed", REFERENCE[:2] - MEASURED[:2]),
        ("literal", TARGET - REFERENCE[:2]),
    ],
)
def test_both_laws_of_the_thesis_are_its_equation(law, error):
    v = REFERENCE[2:4]
    feedback = GAINS.kp * error + GAINS.ki * error * v + GAINS.kd * error / v
    feedforward = GAINS.kff1 * v + GAINS.kff2 * REFERENCE[4:]
    servo, context = make(law=law, printed_law_min_speed=1e-9)
    fix(servo, context, position_desired=TARGET)
    assert pwm(servo, context) == pytest.approx(feedforward + feedback)


@given(st.lists(st.floats(-10, 10), min_size=4, max_size=4))
def test_the_literal_law_measures_nothing(measured):
    servo, context = make(measured=np.array(measured), law="literal")
    fix(servo, context, position_desired=TARGET)
    expected = pwm(servo, context)
    fix(servo, context, state_measured=MEASURED)
    assert np.array_equal(pwm(servo, context), expected)


@given(
    st.floats(-2, 2),
    st.floats(0, 1),
    st.floats(0.01, 1),
    st.floats(0, 1),
    st.booleans(),
)
def test_along_minimum_jerk_the_literal_terms_always_push_to_close(
    distance, share, duration, gain, integral
):
    target = 0.4 + distance
    c = minimum_jerk_coefficients(0.4, 0.0, 0.0, target, duration)
    blend = np.polynomial.Polynomial(c)
    q, v = blend(share), blend.deriv()(share) / duration
    config = GripperServoConfig(
        kp=[0.0],
        ki=[gain if integral else 0.0],
        kd=[0.0 if integral else gain],
        kff1=[0.0],
        kff2=[0.0],
        law="literal",
    )
    servo, context = make(np.array([q, v, 0.0]), np.zeros(2), config)
    fix(servo, context, position_desired=np.array([target]))
    assert pwm(servo, context)[0] >= -1e-12


def test_the_literal_law_needs_a_target():
    with pytest.raises(RuntimeError, match=r"position_desired.* not connected"):
        pwm(*make(law="literal"))


@given(speed=st.floats(-1.0, 1.0), min_speed=st.floats(1e-3, 1.0))
def test_the_division_of_the_printed_law_is_guarded(speed, min_speed):
    reference = np.array([0.1, 0.1, speed, 0.0, 0, 0])
    zero = [0.0, 0.0]
    servo, context = make(
        reference,
        np.zeros(4),
        law="printed",
        printed_law_min_speed=min_speed,
        kp=zero,
        kff1=zero,
        ki=zero,
        kd=[1e-3, 1e-3],
    )
    moving, resting = pwm(servo, context)
    # v / (v² + s²) has its peak, 1 / (2 s), at v = s.
    assert abs(moving) <= 1e-3 * 0.1 / (2 * min_speed) * (1 + 1e-9)
    assert resting == 0.0


def test_the_law_that_the_plant_solves_is_refused():
    refusal = r"^gripper\.servo\.law: must be one of pid, .* got 'plant'$"
    with pytest.raises(ValueError, match=refusal):
        make(law="plant")


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


def make_reference(initial, **config):
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
    system, context = make_reference([0.3, -0.1])
    update(system, context)
    expected = [[0.3, -0.1], [0, 0], [0, 0]]
    np.testing.assert_array_equal(at(system, context, 0.0), expected)
    np.testing.assert_array_equal(at(system, context, 5.0), expected)


def test_the_reference_can_be_put_at_rest_elsewhere():
    system, context = make_reference([0.0, 0.0])
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
    system, context = make_reference([0.0, 0.0])
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
    system, context = make_reference([0.0])
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
    system, context = make_reference([start], max_velocity=limit, min_duration=0.08)
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
    system, context = make_reference([0.0], min_duration=0.08)
    retarget(system, context, [0.01], 0.0)
    assert at(system, context, 0.079)[0, 0] < 0.01
    assert at(system, context, 0.08)[0, 0] == pytest.approx(0.01)


def test_joints_move_independently():
    system, context = make_reference([0.0, 0.0])
    retarget(system, context, [1.0, 0.0], 0.0)
    alone, alone_context = make_reference([0.0, 0.0])
    retarget(alone, alone_context, [1.0, 0.0], 0.0)
    retarget(system, context, [1.0, -0.4], 0.2)
    for time in (0.25, 0.4, 0.6):
        expected = at(alone, alone_context, time)[:, 0]
        np.testing.assert_array_equal(at(system, context, time)[:, 0], expected)


def test_a_target_that_stays_restarts_nothing():
    system, context = make_reference([0.0])
    retarget(system, context, [1.0], 0.0)
    expected = at(system, context, 0.3)
    retarget(system, context, [1.0], 0.25)
    np.testing.assert_array_equal(at(system, context, 0.3), expected)
