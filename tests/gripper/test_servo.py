import dataclasses as dc
import gc
import weakref

import numpy as np
import pytest
from helpers import fix, port_table, read, update
from hypothesis import given
from hypothesis import strategies as st
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, InitializeAutoDiff
from pydrake.symbolic import Evaluate, MakeVectorContinuousVariable
from pydrake.systems.framework import DiagramBuilder

from drake_srg.gripper.minimum_jerk import minimum_jerk_coefficients
from drake_srg.gripper.servo import (
    LAWS,
    GripperServo,
    GripperServo_,
    GripperServoConfig,
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


def test_ports():
    assert port_table(GripperServo(GAINS)) == (
        {
            "reference": 6,
            "state_measured": 4,
            "position_desired": 2,
            "force_limit": 1,
            "torque_commanded": 2,
        },
        {"pwm": 2},
    )


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
    assert samples_until_reversal(np.inf) > 500
    assert samples_until_reversal(0.05) < 100


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
    zero, start = np.zeros(1), np.array([0.4])
    target = start + distance
    c = minimum_jerk_coefficients(start, zero, zero, target, np.array([duration]))
    blend = np.polynomial.Polynomial(c[0])
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
    fix(servo, context, position_desired=target)
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


def test_gains_of_different_lengths_are_refused():
    with pytest.raises(ValueError, match=r"one entry per motor .* \[2, 2, 1, 2, 2\]"):
        make(kd=[0.1])


def test_an_unknown_law_is_refused():
    with pytest.raises(ValueError, match=r"one of pid, printed, literal, got 'pdi'"):
        make(law="pdi")


# Steps of the PWM.

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


def test_negative_steps_are_refused():
    with pytest.raises(ValueError, match="pwm_steps: must be at least 0, got -1"):
        make(pwm_steps=-1)


def test_steps_have_no_derivatives():
    servo = GripperServo(dc.replace(GAINS, pwm_steps=1023))
    with pytest.raises(ValueError, match="pwm_steps: must be 0 for AutoDiffXd"):
        servo.ToAutoDiffXd()


# Torque control.


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


# Scalar conversion.


def derivatives(kappa):
    """Return the PWM's derivatives by reference, measurement and kappa."""
    servo = GripperServo(GAINS).ToAutoDiffXd()
    assert isinstance(servo, GripperServo_[AutoDiffXd])
    context = servo.CreateDefaultContext()
    x = InitializeAutoDiff([*REFERENCE, *MEASURED, kappa]).flatten()
    fix(servo, context, reference=x[:6], state_measured=x[6:10], force_limit=x[10:])
    update(servo, context)
    return ExtractGradient(read(servo, context, "pwm")[:, np.newaxis])


def test_derivatives_are_the_gains():
    expected = [
        [2.0, 0, 0.13, 0, 1e-3, 0, -2.0, 0, -0.1, 0, 0],
        [0, 1.0, 0, 0.22, 0, 2e-3, 0, -1.0, 0, -0.2, 0],
    ]
    np.testing.assert_allclose(derivatives(kappa=0.9), expected)


def test_at_saturation_only_the_limit_has_a_derivative():
    # Without the limit, the PWM are 0.275 and -0.168.
    expected = [[0] * 10 + [1], [0] * 10 + [-1]]
    np.testing.assert_allclose(derivatives(kappa=0.1), expected)


def test_a_torque_has_derivatives_too():
    servo = GripperServo(GAINS).ToAutoDiffXd()
    context = servo.CreateDefaultContext()
    x = InitializeAutoDiff([*MEASURED, 0.2, 0.3]).flatten()
    reference = InitializeAutoDiff(REFERENCE, 6, 0).flatten()
    fix(servo, context, reference=reference)
    fix(servo, context, state_measured=x[:4], torque_commanded=x[4:])
    update(servo, context)
    gradient = ExtractGradient(read(servo, context, "pwm")[:, np.newaxis])
    expected = [[0, 0, 0.8 * 0.03, 0, 1, 0], [0, 0, 0, 0.8 * 0.02, 0, 1]]
    np.testing.assert_allclose(gradient, expected)


# NumPy's arithmetic on arrays of Expression warns without a reason.
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("steps", [0, 1023])
@given(st.lists(st.floats(-2, 2), min_size=13, max_size=13))
def test_the_symbolic_law_evaluates_to_the_same_numbers(law, steps, values):
    values = np.array(values)
    x = MakeVectorContinuousVariable(13, "x")
    config = dc.replace(GAINS, law=law, pwm_steps=steps)
    symbolic = GripperServo(config).ToSymbolic()
    context = symbolic.CreateDefaultContext()
    e = x * 1.0
    fix(symbolic, context, reference=e[:6], state_measured=e[6:10])
    fix(symbolic, context, force_limit=e[10:11], position_desired=e[11:])
    update(symbolic, context)
    expressions = read(symbolic, context, "pwm")
    result = Evaluate(expressions, dict(zip(x, values, strict=True))).flatten()

    servo, context = make(values[:6], values[6:10], config)
    fix(servo, context, force_limit=values[10:11], position_desired=values[11:])
    # Round-off may fall on either side of a step.
    allowed = 1.0 / steps if steps else 0.0
    np.testing.assert_allclose(result, pwm(servo, context), atol=1e-12 + allowed)


@pytest.mark.slow
def test_it_is_freed_with_its_diagram():
    def watch_one():
        builder = DiagramBuilder()
        servo = builder.AddSystem(GripperServo(GAINS))
        diagram = builder.Build()
        diagram.CreateDefaultContext()
        return weakref.ref(diagram), weakref.ref(servo)

    watches = watch_one()
    gc.collect()
    assert [watch() for watch in watches] == [None, None]


def test_a_limit_of_nan_leaves_the_configured_one():
    far = np.array([9.0, 9.0, 0.0, 0.0, 0.0, 0.0])
    servo, context = make(reference=far, force_limit=0.3)
    fix(servo, context, force_limit=np.nan)
    assert pwm(servo, context) == pytest.approx([0.3, 0.3])
