import dataclasses as dc

import numpy as np
import pytest
from helpers import fix, read, update
from hypothesis import given
from hypothesis import strategies as st
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, InitializeAutoDiff

from drake_srg.gripper.servo import GripperServo, GripperServo_
from gripper.servo_case import GAINS, MEASURED, REFERENCE, make, pwm

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


def test_steps_have_no_derivatives():
    servo = GripperServo(dc.replace(GAINS, pwm_steps=1023))
    with pytest.raises(ValueError, match="pwm_steps: must be 0 for AutoDiffXd"):
        servo.ToAutoDiffXd()


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
