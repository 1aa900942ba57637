import numpy as np
import pytest
from helpers import fix, port_table
from hypothesis import given
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator

from drake_srg.gripper.grasp_detector import GraspDetector, GraspDetectorConfig
from drake_srg.gripper.underactuation import FINGERS

NONE, LEFT, BOTH = [0, 0, 0, 0], [1, 0, 1, 0], [1, 1, 0, 0]


def reports(readings, delay=0.1):
    """Return the reports 1 ms after each reading, one every 10 ms."""
    detector = GraspDetector(FINGERS, GraspDetectorConfig(post_contact_delay=delay))
    simulator = Simulator(detector)
    context = simulator.get_mutable_context()
    result = []
    for k, reading in enumerate(readings):
        fix(detector, context, triggered=np.array(reading, dtype=float))
        simulator.AdvanceTo(0.01 * k + 0.001)
        result.append(detector.get_output_port().Eval(context)[0])
    return result


def test_ports():
    assert port_table(GraspDetector(FINGERS)) == ({"triggered": 4}, {"grasped": 1})


def test_a_grasp_counts_after_the_delay():
    assert reports([BOTH] * 14) == [0] * 10 + [1] * 4


def test_without_a_delay_it_counts_at_once():
    assert reports([NONE, BOTH, NONE, BOTH], delay=0.0) == [0, 1, 0, 1]


@pytest.mark.parametrize("reading", [NONE, LEFT, [0, 1, 0, 1], [0, 0, 1, 0]])
def test_both_fingers_must_sense_something(reading):
    assert reports([reading] * 20) == [0] * 20


@pytest.mark.parametrize("reading", [[1, 1, 0, 0], [0, 0, 1, 1], [1, 0, 0, 1]])
def test_any_sensor_of_a_finger_counts(reading):
    assert reports([reading] * 12)[-1] == 1


def test_the_sensors_of_a_finger_may_take_turns():
    assert reports([BOTH, [0, 0, 1, 1]] * 6)[-1] == 1


def test_a_break_starts_the_delay_anew():
    assert reports([BOTH] * 12 + [LEFT] + [BOTH] * 12) == (
        [0] * 10 + [1] * 2 + [0] * 11 + [1] * 2
    )


@given(st.lists(st.tuples(*[st.integers(0, 1)] * 4), max_size=30))
def test_a_reported_grasp_lasted_for_the_delay(readings):
    both = [all(any(r[i] for i in finger) for finger in FINGERS) for r in readings]
    for k, grasped in enumerate(reports(readings, delay=0.05)):
        assert grasped == (k >= 5 and all(both[k - 5 : k + 1]))
