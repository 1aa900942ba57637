import numpy as np
import pytest
from helpers import fix, read, update
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.gripper.servo import GripperServoConfig
from gripper.servo_case import PID, make, pwm


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
