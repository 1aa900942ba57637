"""Whatever messages arrive, the arm is never sent beyond the monitor's limits."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg.robot.drive.arm import Ros2Arm
from drake_srg.robot.drive.gripper import Ros2Gripper
from robot.drive.stand import (
    HOME,
    MOVING,
    FakeNode,
    Stand,
    array,
    joint_state,
    limits,
    motion_to,
)

ARM = [f"iiwa_joint_{i}" for i in range(1, 8)]
FINGERS = ["left_base", "right_base", "left_tip", "right_tip"]
GOAL = HOME + np.array([1.0, 0.2, 0.0, 0.3, 0.0, 0.0, 0.4])

numbers = st.floats(allow_nan=True, allow_infinity=True, width=32)
# What may happen in a control period, besides a message that is as it must be.
events = st.one_of(
    st.just("good"),
    st.just("good"),
    st.just("good"),
    st.just("silence"),
    st.tuples(st.just("numbers"), st.lists(numbers, max_size=9)),
    st.tuples(st.just("jump"), st.floats(-3.0, 3.0)),
    st.tuples(st.just("stamp"), st.floats(0.0, 100.0)),
    st.tuples(st.just("names"), st.lists(st.sampled_from([*ARM, "x"]), max_size=9)),
)


def message(event, stamp, q):
    """Return the joint states of a period."""
    names, position = [*ARM, *FINGERS], np.append(q, np.zeros(4))
    speed = np.zeros(11)
    match event:
        case "numbers", values:
            position = speed = np.array(values)
        case "jump", by:
            position = position + by
        case "stamp", other:
            stamp = other
        case "names", others:
            names = others
    return joint_state(stamp, names, position, speed)


@settings(max_examples=15)  # each builds a station
@given(st.lists(st.tuples(events, st.integers(1, 15)), min_size=1, max_size=8))
def test_no_stream_of_messages_moves_the_arm_beyond_its_limits(stream):
    node = FakeNode()
    gripper = Ros2Gripper().connect(node.robot())
    stand = Stand(Ros2Arm().connect(node.robot()), gripper)
    stand.planner.say(MOVING, motion_to(GOAL, duration=1.5))
    q, stamp, goes_on = HOME, 0.0, True
    for event, periods in [("good", 40), *stream]:
        for _ in range(periods):
            stamp += 0.005
            if event != "silence":
                node.deliver("/joint_states", message(event, stamp, q))
                node.deliver("/gripper/proximity", array([0.02] * 4))
            goes_on = goes_on and stand.loop.advance()
            q = sent(node)[-1]
    path = sent(node)
    step = np.diff(path, axis=0)
    bend = np.diff(step, axis=0)
    tolerance = 1e-9
    assert np.all(np.isfinite(path))
    assert np.all(np.abs(step) <= limits().step + tolerance)
    assert np.all(np.abs(bend) <= limits().brake + tolerance)
    # A stream of only good messages stops nothing.
    if all(event == "good" for event, _ in stream):
        assert goes_on


def sent(node):
    """The newest position of each trajectory that was sent, shape (K, 7)."""
    return np.array(
        [
            message.points[-1].positions
            for topic, message in node.sent
            if topic.name == "/joint_trajectory"
        ]
    )
