import numpy as np
import pytest

from drake_srg.robot.drive.gripper import obeys, percent
from drake_srg.robot.drive.link import JointStates
from drake_srg.robot.serve.commands import CommandError
from robot.drive.stand import joint_state, make

NAMES = ["a", "b"]


def test_joints_are_found_by_name():
    joints = JointStates(NAMES)
    message = joint_state(1.0, ["b", "x", "a"], [2.0, 9.0, 1.0], [4.0, 9.0, 3.0])
    stamp, state, effort = joints.read(message)
    assert stamp == 1.0
    np.testing.assert_array_equal(state, [1.0, 2.0, 3.0, 4.0])
    assert effort is None


def test_messages_about_other_joints_are_none_of_ours():
    assert JointStates(NAMES).read(joint_state(1.0, ["x"], [0.0], [0.0])) is None


@pytest.mark.parametrize(
    ("arguments", "kind"),
    [
        ((2.0, ["a"], [0.0], [0.0]), "joints"),
        ((2.0, NAMES, [0.0], [0.0, 0.0]), "length"),
        ((2.0, NAMES, [0.0, np.nan], [0.0, 0.0]), "finite"),
        ((1.0, NAMES, [0.0, 0.0], [0.0, 0.0]), "stamp"),
        ((0.5, NAMES, [0.0, 0.0], [0.0, 0.0]), "stamp"),
    ],
)
def test_what_is_refused(arguments, kind):
    joints = JointStates(NAMES)
    joints.read(joint_state(1.0, NAMES, [0.0, 0.0], [0.0, 0.0]))
    with pytest.raises(CommandError) as error:
        joints.read(joint_state(*arguments))
    assert error.value.kind == kind
    assert joints.stamp == 1.0


def test_one_stamp_far_ahead_does_not_make_all_that_follow_old():
    joints = JointStates(NAMES)

    def read(time):
        return joints.read(joint_state(time, NAMES, [0.0, 0.0], [0.0, 0.0]))

    read(1.0)
    with pytest.raises(CommandError, match="jumps ahead") as error:
        read(9e9)
    assert error.value.kind == "stamp"
    assert read(1.01) is not None
    with pytest.raises(CommandError, match="jumps ahead"):
        read(100.0)
    assert read(100.01) is not None  # the robot was silent


def test_closures_become_percent():
    topic = percent("/grasp")
    assert [topic.convert(make, 0.0, c).data for c in (0.0, 0.374, 1.2)] == [0, 37, 100]


def test_a_gripper_that_is_to_hold_obeys_no_more():
    topic = obeys("/startgrasp")
    assert [topic.convert(make, 0.0, hold).data for hold in (0.0, 1.0)] == [True, False]
