import numpy as np
import pytest
from helpers import fix, read, update
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.gripper.underactuation import finger_targets
from gripper.underactuation_case import (
    NAN,
    angle,
    closure,
    four_angles,
    given_inputs,
    make,
    targets,
)

OPEN, CLOSE = True, False
LAST = (0.7, 0.1)

four_bools = st.tuples(*[st.booleans()] * 4)


# The function.


@pytest.mark.parametrize(
    ("opening", "angles", "fired", "expected"),
    [
        # Nothing or only the tip touches: the base goes to the target.
        (CLOSE, (0.4, 0.3), (False, False), (1.5, LAST[1])),
        (CLOSE, (0.4, 0.3), (False, True), (1.5, LAST[1])),
        # The base touches: the tip takes the rest.
        (CLOSE, (0.4, 0.3), (True, False), (LAST[0], 1.5 - 0.4)),
        # Both touch: both press on, each with half of the rest, 1.5 - 0.4 - 0.3.
        (CLOSE, (0.4, 0.3), (True, True), (0.4 + 0.4, 0.3 + 0.4)),
        # A bent finger opens its tip first, whatever the sensors say.
        (OPEN, (0.4, 0.3), (False, False), (LAST[0], 1.5 - 0.4)),
        (OPEN, (0.4, 0.3), (True, True), (LAST[0], 1.5 - 0.4)),
        # A straight finger opens its base.
        (OPEN, (0.4, 0.0), (False, False), (1.5, 0.0)),
        (OPEN, (0.4, -0.01), (True, True), (1.5, 0.0)),
    ],
)
def test_algorithm_1_branch_by_branch(opening, angles, fired, expected):
    assert finger_targets(1.5, opening, angles, fired, LAST) == pytest.approx(expected)


def test_a_finger_within_the_tolerance_is_straight():
    args = (1.5, OPEN, (0.4, 0.002), (False, False), LAST)
    assert finger_targets(*args, straight_tolerance=0.002) == (1.5, 0.0)
    assert finger_targets(*args, straight_tolerance=0.001) != (1.5, 0.0)


@given(target=st.floats(0, 3), base=angle, tip=angle)
def test_a_wrapped_finger_is_asked_for_the_whole_command(target, base, tip):
    result = finger_targets(target, CLOSE, (base, tip), (True, True), LAST)
    assert sum(result) == pytest.approx(target)
    # Both joints have the same error, which squeezes.
    assert result[0] - base == pytest.approx(result[1] - tip)


def test_output_changes_only_at_updates():
    system, context = make(closure=0.5)
    assert read(system, context, "position_desired").tolist() == [0.0] * 4
    update(system, context)
    assert read(system, context, "position_desired").tolist() == [1.5, 1.5, 0.0, 0.0]


def test_targets_saturate_at_the_joint_limits():
    system, context = make(closure=1.0)
    assert targets(system, context) == pytest.approx([1.94, 1.94, 0.0, 0.0])
    given_inputs(system, context, 1.0, [0.5, 0.5, 0.0, 0.0], [1, 1, 0, 0])
    assert targets(system, context)[2:] == pytest.approx([1.94, 1.94])


def test_each_finger_has_its_own_sensors():
    # On the left, the base touches; on the right, base and tip do.
    q = [0.5, 0.6, 0.2, 0.3]
    result = targets(*make(closure=0.5, q=q, fired=[1, 1, 0, 1]))
    share = (1.5 - 0.6 - 0.3) / 2
    assert result == pytest.approx([0.0, 0.6 + share, 1.5 - 0.5, 0.3 + share])


@pytest.mark.slow
@given(c=closure, q=four_angles, fired=four_bools, c2=closure)
def test_the_fingers_are_mirror_images(c, q, fired, c2):
    swap = [1, 0, 3, 2]
    system, context = make(c, q, fired)
    mirrored, mirrored_context = make(c, np.array(q)[swap], np.array(fired)[swap])
    for command in (c, c2):
        given_inputs(system, context, command, q, fired)
        given_inputs(
            mirrored,
            mirrored_context,
            command,
            np.array(q)[swap],
            np.array(fired)[swap],
        )
        result = targets(system, context)
        np.testing.assert_array_equal(result, targets(mirrored, mirrored_context)[swap])


@pytest.mark.slow
@given(commands=st.lists(closure, min_size=1, max_size=6), q=four_angles)
def test_targets_stay_within_the_joint_limits(commands, q):
    system, context = make(q=q)
    for command in commands:
        given_inputs(system, context, command, q, [1, 0, 1, 0])
        assert np.max(targets(system, context)) <= 1.94


@pytest.mark.parametrize("closure", [0.3, NAN])
def test_opening_is_remembered_while_the_command_stays(closure):
    bent = [0.5, 0.5, 0.4, 0.4]
    system, context = make(0.6, bent)
    update(system, context)
    given_inputs(system, context, 0.3, bent, [0] * 4)
    update(system, context)  # lower: opening
    given_inputs(system, context, closure, bent, [0] * 4)
    expected = [1.8, 1.8, 0.9 - 0.5, 0.9 - 0.5]  # the tips open, the bases wait
    assert targets(system, context) == pytest.approx(expected)
    given_inputs(system, context, 0.31, bent, [0] * 4)  # higher: closing again
    assert targets(system, context)[:2] == pytest.approx([0.93, 0.93])


def test_a_command_that_is_not_a_number_keeps_the_last_one():
    system, context = make(0.5)
    update(system, context)
    for command in (NAN, np.inf):
        given_inputs(system, context, command, [0.0] * 4, [0] * 4)
        assert targets(system, context) == pytest.approx([1.5, 1.5, 0, 0])


def test_finite_overrides_win_and_the_others_follow_the_algorithm():
    system, context = make(0.5)
    fix(system, context, joint_position_commanded=[NAN, 0.2, 0.3, NAN])
    assert targets(system, context) == pytest.approx([1.5, 0.2, 0.3, 0.0])
    fix(system, context, joint_position_commanded=[NAN] * 4)
    # An override leaves no trace in the state of the algorithm.
    assert targets(system, context) == pytest.approx([1.5, 1.5, 0.0, 0.0])


def test_hold_keeps_the_grip_where_it_touches_and_the_angles_elsewhere():
    q = [0.5, 0.6, 0.2, 0.3]
    system, context = make(0.5, q, [1, 0, 1, 0])
    gripping = targets(system, context)
    fix(system, context, hold=1.0)
    held = targets(system, context)
    assert held[[0, 2]] == pytest.approx(gripping[[0, 2]])
    assert held[[1, 3]] == pytest.approx([0.6, 0.3])
    # Neither motion, contact nor command changes that ...
    given_inputs(system, context, 0.1, [0.9] * 4, [0, 1, 0, 1])
    np.testing.assert_array_equal(targets(system, context), held)
    # ... until hold ends: 0.1 is less than 0.5, so the fingers open, tips first.
    fix(system, context, hold=0.0)
    assert targets(system, context)[2:] == pytest.approx([0.3 - 0.9] * 2)
