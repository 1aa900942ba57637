"""Drivers of arms that speak ROS, with no wire between."""

import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.hardware.link import STAMP
from drake_srg.hardware.ros import Ros1Arm, Ros2Arm
from hardware.stand import HOME, FakeNode, array, joint_state

ARM = [f"iiwa_joint_{i}" for i in range(1, 8)]
TORQUE = np.arange(7.0)


def deliver_state(node, stamp):
    message = joint_state(stamp, ARM, HOME, np.zeros(7))
    assert not node.deliver("/joint_states", message)


def commands(q, hold=0.0):
    return {"arm.position_commanded": q, "gripper.hold": np.array([hold])}


@pytest.mark.parametrize("kind", [Ros1Arm, Ros2Arm])
def test_a_stream_of_positions_is_the_commands_as_they_are(kind):
    node = FakeNode()
    link = kind(stream="positions", command="/positions").connect(node.robot())
    assert link.lag == 0.0
    for q in (HOME, HOME + 0.01):
        link.send(commands(q))
        topic, message = node.sent[-1]
        assert (topic.name, topic.type) == (
            "/positions",
            "std_msgs/msg/Float64MultiArray",
        )
        np.testing.assert_array_equal(message.data, q)


def test_a_robot_may_have_names_of_its_own_for_the_joints():
    node, names = FakeNode(), [f"lbr_A{i}" for i in range(1, 8)]
    link = Ros2Arm(joints=names).connect(node.robot())
    node.deliver("/joint_states", joint_state(1.0, names[::-1], HOME[::-1], TORQUE))
    np.testing.assert_array_equal(link.take()["arm.state_measured"][:7], HOME)
    link.send(commands(HOME))
    assert node.sent[-1][1].joint_names == names
    with pytest.raises(ScenarioError, match=r"arm\.joints: needs one name for each"):
        Ros1Arm(joints=names[:6]).connect(node.robot())
    with pytest.raises(ScenarioError, match=r"arm\.joints: names must differ"):
        Ros1Arm(joints=[*names[:6], names[0]]).connect(node.robot())


def test_an_arm_tells_external_torques_if_it_has_a_topic_of_them():
    assert "arm.external_torque" not in Ros2Arm().connect(FakeNode().robot()).outputs
    node = FakeNode()
    link = Ros2Arm(external_torque="/felt").connect(node.robot())
    assert link.outputs["arm.external_torque"] == 7
    deliver_state(node, 1.0)
    assert not node.deliver("/felt", array(TORQUE))
    values = link.take()
    np.testing.assert_array_equal(values["arm.external_torque"], TORQUE)
    np.testing.assert_array_equal(values[STAMP], [1.0])


def test_an_arm_that_stops_telling_external_torques_falls_silent():
    node = FakeNode()
    link = Ros2Arm(external_torque="/felt").connect(node.robot())
    deliver_state(node, 1.0)
    assert link.take() == {}
    (refusal,) = node.deliver("/felt", array(TORQUE[:6]))
    assert "needs 7 numbers, got 6" in refusal
    assert link.take() == {}
    node.deliver("/felt", array(TORQUE))
    assert link.take().keys() >= {"arm.state_measured", "arm.external_torque"}
    assert link.take() == {}
    node.deliver("/felt", array(TORQUE))  # and nothing about the joints
    assert link.take() == {}
