from drake_srg.robot.drive.gripper import obeys, percent
from robot.drive.stand import make


def test_closures_become_percent():
    topic = percent("/grasp")
    assert [topic.convert(make, 0.0, c).data for c in (0.0, 0.374, 1.2)] == [0, 37, 100]


def test_a_gripper_that_is_to_hold_obeys_no_more():
    topic = obeys("/startgrasp")
    assert [topic.convert(make, 0.0, hold).data for hold in (0.0, 1.0)] == [True, False]
