import dataclasses as dc

import numpy as np
import pytest

from drake_srg.experiments.direct_node import DirectNode
from drake_srg.experiments.fuzzed_messages import FAULTS, FuzzedRobot
from drake_srg.experiments.fuzzed_streams import Outcome, judge, stream
from drake_srg.robot.drive.link import JointStates

GOOD = Outcome(("NaN",), "stale", 0.5, 1.0, -0.1)


@pytest.mark.parametrize(
    ("change", "quantity"),
    [
        ({}, None),
        ({"error": "ValueError"}, "exceptions"),
        ({"step": 1.1}, "speed / limit"),
        ({"bend": 1.1}, "deceleration / limit"),
        ({"beyond": 0.01}, "beyond a joint's limits"),
        ({"events": ()}, "stopped without a fault"),
    ],
)
def test_what_fails(change, quantity):
    rows = judge([GOOD, dc.replace(GOOD, **change)])
    assert [row.quantity for row in rows if not row.passed] == [quantity][: len(change)]


@pytest.mark.parametrize("seed", range(3))
def test_a_stream_moves_the_arm_within_its_limits(seed):
    outcome = stream(seed)
    assert outcome.error == ""
    assert all(row.passed for row in judge([outcome, outcome]))
    assert outcome.step > 0.3  # it moved


ARM, FINGERS = [f"arm_{i}" for i in range(7)], [f"finger_{i}" for i in range(4)]


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_spoils_a_message(fault):
    node, random = DirectNode(), np.random.default_rng(0)
    arm, fingers, read = JointStates(ARM), JointStates(FINGERS), []
    for joints in (arm, fingers):
        node.subscribe(
            "/joint_states", "", lambda message, j=joints: read.append(j.read(message))
        )
    robot, q = FuzzedRobot(node, ARM, FINGERS), np.linspace(0.1, 0.7, 7)
    robot.tell("good", q, 0.005, random)
    good = [state.tolist() for _, state, _ in read]
    assert good == [[*q, *np.zeros(7)], [0.0] * 8]
    read.clear()
    robot.tell(fault, q, 0.005, random)
    same = [each is not None and each[1].tolist() for each in read] == good
    # This one tells the joints as they are, but not the finger sensors.
    assert same == (fault == "gripper short")
