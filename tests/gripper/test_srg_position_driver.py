import numpy as np
import pytest

from drake_srg.gripper import SrgPositionDriver
from drake_srg.gripper.underactuation import JOINT_NAMES
from gripper.driven_hand import SrgHand


def test_joints_are_measured_in_the_order_of_their_names():
    hand = SrgHand()
    plant_context = hand.plant.GetMyMutableContextFromRoot(hand.root)
    for i, name in enumerate(JOINT_NAMES):
        joint = hand.plant.GetJointByName(name, hand.model)
        joint.set_angle(plant_context, 0.1 * (i + 1))
        joint.set_angular_rate(plant_context, 1.0 * (i + 1))
    expected = [0.1, 0.2, 0.3, 0.4, 1, 2, 3, 4]
    assert hand.read("state_measured") == pytest.approx(expected)


def test_each_joint_is_driven_by_its_own_pwm():
    hand = SrgHand()
    targets = np.array([0.3, 0.2, 0.1, 0.4])
    hand.command(joint_position_commanded=targets)
    hand.advance(0.5)
    assert hand.q == pytest.approx(targets, abs=0.01)
    pwm = dict(zip(JOINT_NAMES, hand.read("pwm"), strict=True))
    for k in hand.plant.GetJointActuatorIndices():
        actuator = hand.plant.get_joint_actuator(k)
        (torque,) = actuator.get_actuation_vector(hand.read("actuation"))
        expected = pwm[actuator.joint().name()] * actuator.effort_limit()
        assert torque == pytest.approx(expected)


def test_an_empty_hand_closes_and_opens_within_its_speed():
    hand = SrgHand()
    hand.command(closure_commanded=0.25)
    fastest = 0.0
    for _ in range(60):
        hand.advance(0.01)
        fastest = max(fastest, np.max(hand.read("state_measured")[4:6]))
    # 3.67 rad/s, and a tenth more for the servo's overshoot.
    assert 3.3 < fastest < 4.04
    # Only the bases close. The fingers' weight bends the servos by less than 0.01 rad.
    assert hand.q == pytest.approx([0.75, 0.75, 0.0, 0.0], abs=0.01)
    hand.command(closure_commanded=0.0)
    hand.advance(0.6)
    assert hand.q == pytest.approx([0.0] * 4, abs=0.01)
    assert hand.read("grasped") == [0.0]


@pytest.fixture(scope="module")
def wrapped():
    hand = SrgHand(post=True)
    hand.command(closure_commanded=1.0, force_limit=0.3)
    hand.advance(1.5)
    return hand


def test_the_tips_close_after_the_bases_touch(wrapped):
    q, proximity = map(wrapped.array, ("state_measured", "proximity"))
    for base, tip in ((0, 2), (1, 3)):
        touched = np.flatnonzero(proximity[:, base] < 0.003)[0]
        assert touched > 0
        assert np.max(np.abs(q[: touched + 1, tip])) < 0.03
        assert q[-1, tip] > 0.5
        assert proximity[-1, tip] < 0.003
    # Left and right do the same, though the contact mesh of the post is not symmetric.
    assert q[-1, 0] == pytest.approx(q[-1, 1], abs=0.02)
    assert q[-1, 2] == pytest.approx(q[-1, 3], abs=0.02)


def test_the_fingers_press_with_the_force_limit(wrapped):
    pwm = wrapped.array("pwm")
    assert np.max(np.abs(pwm)) == pytest.approx(0.3)
    assert pwm[-1] == pytest.approx([0.3] * 4)


def test_a_wrapped_object_is_a_grasp(wrapped):
    assert wrapped.read("grasped") == [1.0]


def test_touch_can_trigger_algorithm_1():
    hand = SrgHand(post=True, config=SrgPositionDriver(trigger="touch"))
    hand.command(closure_commanded=1.0, force_limit=0.3)
    hand.advance(1.0)
    # Blind to distances, the bases press on the post before the tips close.
    force = hand.read("contact_force")
    assert np.all(force[:2] > 0.5)
    assert np.all(hand.q[2:] > 0.5)
    assert hand.read("grasped") == [1.0]
