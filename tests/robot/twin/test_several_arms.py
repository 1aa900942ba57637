"""A twin of two arms: whose messages are whose, and whose joint differs."""

import functools

import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.recording.rosbag import header
from drake_srg.robot.drive.config import parse_hardware
from drake_srg.robot.drive.opening import MakeRobots
from drake_srg.robot.serve.commands import Warnings
from drake_srg.robot.twin.loop import Listener, Told, TwinLoop
from drake_srg.robot.twin.run import run_twin, status_text, twin_topics
from drake_srg.robot.twin.station import AddTwin, MakeTwin
from drake_srg.scenario import load_scenario, robot_arms
from drake_srg.simulation.flat import MakeRoot
from experiments.stands.direct_node import DirectNode, make_message

HOME = np.array([0.0, -0.3, 0.0, -1.9, 0.0, 1.5, 0.0])
Q = np.append(HOME, HOME)
STILL = np.zeros(14)
UNTOLD = np.full(14, np.nan)
FINGERS = np.full(16, np.nan)
FILE = """
arms:
  left: {arm: !Ros2Arm {}, gripper: !Ros2Gripper {}}
  right: {arm: !Ros2Arm {state: joint_states}, gripper: !Ros2Gripper {}}
"""


@functools.cache
def scenario():
    return load_scenario("handover", overrides=["twin.settle=0.3"])


def told(stamp, q=Q, torque=UNTOLD, fingers=FINGERS, closures=(0.0, 0.0)):
    return Told(stamp, np.append(q, STILL), torque, fingers, closures)


@pytest.fixture
def loop():
    builder, twin = MakeRoot("twin", MakeTwin, AddTwin, scenario(), "test")
    return TwinLoop("test", scenario(), builder.Build(), twin, told(100.0))


def follow(loop, end, **changes):
    """Tell the same until a time; return the reports."""
    reports = []
    for stamp in np.arange(100.05, end + 1e-9, 0.05):
        reports += loop.follow(told(stamp, **changes))
    return reports


def test_both_arms_follow_their_own_joints(loop):
    q = Q.copy()
    q[7] += 0.05  # of the right arm
    assert follow(loop, 101.5, q=q) == []
    for arm, own in (("left", q[:7]), ("right", q[7:])):
        reached = loop.value(f"{arm}.state_measured")[:7]
        np.testing.assert_allclose(reached, own, atol=3e-3)
    assert loop.value("twin.joint_error").shape == (14,)
    assert status_text(loop).startswith("twin: 1.5 s, joints 0.00")


def test_a_report_names_the_arm(loop):
    fingers = np.zeros(16)  # those of the right hand stay open
    reports = follow(loop, 102.0, fingers=fingers, closures=(0.0, 1.0))
    (report,) = reports
    assert report.kind == "finger"
    assert "finger joint" in report.text and " of right is " in report.text


def test_only_the_arm_that_tells_its_torques_is_compared(loop):
    torque = np.append(np.full(7, np.nan), np.zeros(7))
    reports = follow(loop, 103.0, torque=torque)
    assert {report.kind for report in reports} == {"torque"}
    assert all(" of right has " in report.text for report in reports)


def test_topics_have_the_joints_of_all_arms():
    (error,) = [t for t in twin_topics(scenario()) if t.name == "/twin/joint_error"]
    assert [*error.ports.values()] == [14]


class Talk:
    """A listener and the messages that it gets."""

    def __init__(self):
        self.node = DirectNode()
        config = parse_hardware(FILE, "f")
        robots = MakeRobots(scenario(), config, Warnings(print))
        object.__setattr__(robots[0].nodes, "_nodes", {1: self.node, 2: self.node})
        self.listener = Listener(config, scenario().twin, *robots)
        self.names = {robot.own.name: robot.arm_joints for robot in robots}
        for own in robot_arms(scenario()):
            joints = [own.system(name) for name in own.gripper.joint_names]
            self.names[own.gripper_model] = joints

    def joints(self, topic, stamp, **positions):
        names = [n for part in positions for n in self.names[part.replace("_", ".")]]
        message = make_message(
            "sensor_msgs/msg/JointState",
            header=header(make_message, stamp),
            name=names,
            position=np.concatenate([*positions.values()]),
            velocity=np.full(len(names), 0.5),
            effort=np.zeros(0),
        )
        assert self.node.deliver(topic, message) == []

    def say(self, topic, percent):
        message = make_message("std_msgs/msg/Int32", data=percent)
        assert self.node.deliver(topic, message) == []


def test_a_listener_tells_once_it_has_heard_all_arms():
    talk = Talk()
    talk.say("/right/grasp", 40)
    talk.joints("/joint_states", 1.0, left=HOME, right_gripper=np.full(4, 0.2))
    assert talk.listener.take() is None
    talk.joints("/right/joint_states", 1.1, right=HOME + 1.0)
    heard = talk.listener.take()
    assert (heard.stamp, heard.closures) == (1.1, (None, 0.4))
    np.testing.assert_array_equal(heard.arm_state[:14], np.append(HOME, HOME + 1.0))
    np.testing.assert_array_equal(heard.arm_state[14:], np.full(14, 0.5))
    assert np.all(np.isnan(heard.gripper_state[[0, 1, 2, 3, 8, 9, 10, 11]]))
    np.testing.assert_array_equal(heard.gripper_state[4:8], np.full(4, 0.2))
    assert talk.listener.take() is None


def test_arms_that_do_not_fit_are_told():
    config = parse_hardware("arm: !Ros2Arm {}\ngripper: !Ros2Gripper {}\n", "f")
    with pytest.raises(ScenarioError, match=r"two: hardware: arms\.left\.arm: missing"):
        run_twin(scenario(), config, name="two")
    bus = FILE.replace("!Ros2Gripper", "!DynamixelGripper", 1)
    config = parse_hardware(bus.replace("Gripper {}", "Gripper {open: 9}", 1), "f")
    robots = MakeRobots(scenario(), config, Warnings(print))
    with pytest.raises(ScenarioError, match=r"^arms\.left\.gripper: a twin cannot"):
        Listener(config, scenario().twin, *robots)
