import dataclasses as dc

import numpy as np
import pytest
from helpers import fix, port_table, read, update

from drake_srg.gripper import LinkageDriver, SrgPositionDriver
from drake_srg.gripper.joint_servos import PlantJointServos
from gripper.driven_hand import LinkageHand, SrgHand

SERVO = SrgPositionDriver().servo
FAST = SrgPositionDriver(servo=dc.replace(SERVO, law="plant", period=0.02))


def test_ports():
    inputs, outputs = port_table(SrgHand(config=FAST).driver)
    usual_inputs, usual_outputs = port_table(SrgHand().driver)
    assert inputs == usual_inputs
    assert outputs == {**usual_outputs, "desired_state": 8}


def test_an_empty_hand_closes_as_with_sampled_servos():
    hands = [SrgHand(), SrgHand(config=FAST)]
    for hand in hands:
        hand.command(closure_commanded=0.5)
        hand.advance(0.8)
    sampled, solved = (hand.array("state_measured")[:, :4] for hand in hands)
    # The reference is sampled 15 ms later, at up to 3.67 rad/s.
    np.testing.assert_allclose(solved, sampled, atol=0.06)
    np.testing.assert_allclose(solved[-1], sampled[-1], atol=0.002)


def test_a_linkage_closes_on_its_object():
    servo = dc.replace(LinkageDriver().servo, law="plant", period=0.02)
    hand = LinkageHand(radius=0.0125, config=LinkageDriver(servo=servo))
    hand.command(closure_commanded=1.0)
    hand.advance(1.0)
    assert hand.read("grasped") == [1.0]
    assert np.min(hand.read("contact_force")) > 1.0


def test_the_force_limit_limits_the_grip():
    kappa = 0.6
    hand = SrgHand(post=True, config=FAST)
    hand.command(closure_commanded=1.0, force_limit=kappa)
    hand.advance(2.0)
    assert np.max(np.abs(hand.read("pwm"))) == pytest.approx(kappa, abs=0.02)


@pytest.mark.parametrize("change", [{"ki": [1.0] * 4}, {"pwm_steps": 1023}])
def test_what_the_plant_does_not_know_is_refused(change):
    servo = dc.replace(FAST.servo, **change)
    with pytest.raises(ValueError, match=r"gripper\.servo: .* ki and pwm_steps 0"):
        SrgHand(config=SrgPositionDriver(servo=servo))


def test_pwm_is_that_of_the_servo():
    servo = PlantJointServos(dc.replace(SERVO, law="plant"))
    reference = np.concatenate([np.full(4, x) for x in (0.1, 0.2, 0.3)])
    measured = np.array([0.05] * 4 + [0.1] * 4)
    context = servo.CreateDefaultContext()
    fix(servo, context, reference=reference, state_measured=measured)
    update(servo, context)
    gains = (np.array(getattr(SERVO, k)) for k in ("kp", "kd", "kff1", "kff2"))
    kp, kd, kff1, kff2 = gains
    pwm = kff1 * 0.2 + kff2 * 0.3 + kp * 0.05 + kd * 0.1
    np.testing.assert_allclose(read(servo, context, "pwm"), np.minimum(pwm, 1.0))
