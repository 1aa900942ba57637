"""The driver of a hand, with a motor without inertia."""

import pytest

from drake_srg.robot.serve.dex1.grasping import GraspState
from drake_srg.robot.serve.dex1.hand import Hand, Phase
from robot.serve.dex1.fake_motor import STEP, FakeMotor


class Stand:
    def __init__(self, inbox, gripper):
        self.hand = Hand(inbox, gripper)
        self.motor = FakeMotor(inbox, self.hand.ports)

    def run(self, duration):
        return sum(
            self.hand.advance(*self.motor.step()) for _ in range(round(duration / STEP))
        )


@pytest.fixture
def stand(inbox, gripper):
    stand = Stand(inbox, gripper)
    stand.run(8.0)
    return stand


def test_it_starts_by_calibrating(stand, told):
    hand = stand.hand
    assert (hand.phase, hand.calibrated) == (Phase.READY, True)
    assert hand.zero == 1473  # 2.8 rad from 3298
    assert told == []


def test_it_runs_at_30_hz(stand):
    assert stand.run(10.0) == 300


def test_an_object_is_grasped_with_less_force_and_released(stand):
    stand.hand.command(0.0)
    stand.motor.meets = 1.5
    stand.run(2.0)
    assert (stand.hand.grasp.state, stand.hand.force) == (GraspState.GRASPING, 15.0)
    # 15 % of 1600 units of 3.36 mA.
    assert stand.hand.reading.current == pytest.approx(0.806, abs=0.01)
    assert stand.hand.reading.position == pytest.approx(33.9, abs=0.1)
    stand.hand.command(60.0)
    stand.run(3.0)
    assert stand.hand.reading.position == pytest.approx(60.0, abs=1.0)


def test_a_direct_command_limits_the_force(stand):
    stand.hand.command(0.0, 5.0)
    stand.motor.meets = 1.5
    stand.run(2.0)
    assert stand.hand.force == 5.0
    assert stand.hand.reading.current == pytest.approx(0.269, abs=0.01)


def test_an_overheated_hand_obeys_nothing_until_its_errors_are_cleared(stand, told):
    stand.motor.temperature = 90.0
    stand.run(0.1)
    assert stand.hand.phase is Phase.FAULTY
    stand.motor.temperature = 30.0
    stand.hand.command(0.0)
    stand.run(1.0)
    assert stand.hand.phase is Phase.FAULTY and stand.motor.pwm == 0.0
    assert any("hand: overheating; it waits for action 3" in text for text in told)
    zero = stand.hand.zero
    stand.hand.clear_errors()
    stand.run(5.0)
    assert stand.hand.phase is Phase.READY and stand.hand.zero == zero
    assert abs(stand.hand.reading.position) < 1.0


def test_a_calibration_that_does_not_open_half_is_told(inbox, gripper, told):
    stand = Stand(inbox, gripper)
    while stand.hand.phase is Phase.CLOSING:
        stand.run(0.1)
    stand.motor.step = lambda: (stand.motor.time, {})
    stand.hand.advance = lambda *_: False
    hand = stand.hand
    for _ in range(200):
        hand._settle()  # the motor is stuck where the fingers meet
    assert (hand.phase, hand.calibrated) == (Phase.READY, False)
    assert told == ["hand: has not opened half; calibrate again"]
