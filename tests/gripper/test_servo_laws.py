import dataclasses as dc

import numpy as np
import pytest
from helpers import fix, read, update
from hypothesis import given
from hypothesis import strategies as st
from pydrake.symbolic import Evaluate, MakeVectorContinuousVariable

from drake_srg.gripper.servo import (
    LAWS,
    GripperServo,
    GripperServoConfig,
    minimum_jerk_coefficients,
)
from gripper.servo_case import GAINS, MEASURED, REFERENCE, TARGET, make, pwm


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
