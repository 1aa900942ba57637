"""Drivers of arms that speak ROS, with no wire between."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator

from drake_srg.arm.reference import TrajectoryFollower, trajectory_piece
from drake_srg.common.exceptions import ScenarioError
from drake_srg.robot.drive.arm import Ros1Arm, Ros2Arm, Window
from drake_srg.robot.drive.link import STAMP
from robot.drive.stand import HOME, FakeNode, array, joint_state

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


PERIOD, LEAD = 1.0 / 256.0, 12.0 / 256.0


def path(time):
    return np.array([np.sin(3.0 * time) * min(time, 1.0)])


@settings(max_examples=10)  # each simulates 150 periods
@given(
    st.lists(st.integers(0, 3), min_size=150, max_size=150),  # periods of delay
    st.lists(st.booleans(), min_size=150, max_size=150).map(
        lambda lost: [a and b for a, b in itertools.pairwise(lost)]
    ),
)
def test_late_and_lost_messages_do_not_shake_the_arm(delays, lost):
    window, follower = Window(LEAD, PERIOD), TrajectoryFollower(path(0.0), PERIOD)
    simulator = Simulator(follower)
    context = simulator.get_mutable_context()
    on_the_way, moved = [], []
    for k in range(len(lost)):
        # The stamp is known late, but at times at once: then the times settle.
        stamp = (k - (delays[k] if k % 8 else 0)) * PERIOD
        times, q = window.after(path(k * PERIOD), stamp)
        if not lost[k] or k % 8 == 0:
            on_the_way.append((k + delays[k], times, q))
        for piece in [piece for piece in on_the_way if piece[0] <= k]:
            on_the_way.remove(piece)
            _, times, q = piece
            port = follower.GetInputPort("trajectory_desired")
            value = trajectory_piece(times - times[0], q, max(times[0], 1e-9))
            port.FixValue(context, value)
        simulator.AdvanceTo((k + 1) * PERIOD)
        moved.append(follower.get_output_port().Eval(context))
    due = [path(max(0.0, (k + 1) * PERIOD - LEAD)) for k in range(len(lost))]
    # Late by the lead, and otherwise the same.
    np.testing.assert_allclose(moved, due, atol=1e-6)


def test_a_robot_whose_clock_stood_still_is_not_late_forever():
    window = Window(0.05, 0.005)
    for k in range(40):  # it moves on, while the robot's clock stands still
        times, _ = window.after(np.array([0.01 * k]), 1.0)
    assert times[-1] > 1.2
    for k in range(60):  # it rests, and both clocks go on
        times, _ = window.after(np.array([0.4]), 1.0 + 0.005 * k)
    assert times[-1] == pytest.approx(1.0 + 0.005 * 59 + 0.05)
    times, _ = window.after(np.array([0.41]), 1.3)
    assert times[-1] == pytest.approx(1.35)
