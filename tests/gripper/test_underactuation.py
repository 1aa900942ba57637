import numpy as np
import pytest
from helpers import fix, port_table, read, update
from hypothesis import assume, given
from hypothesis import strategies as st

from drake_srg.gripper.underactuation import (
    UnderactuationConfig,
    UnderactuationLogic,
    finger_targets,
)

NAN = np.nan

angle = st.floats(-0.1, 1.94)
closure = st.floats(0.0, 1.0)
four_angles = st.tuples(*[angle] * 4)


def make(closure=0.0, q=(0.0,) * 4, fired=(0.0,) * 4, **config):
    system = UnderactuationLogic(UnderactuationConfig(**config))
    context = system.CreateDefaultContext()
    given_inputs(system, context, closure, q, fired)
    return system, context


def given_inputs(system, context, closure, q, fired):
    fix(
        system,
        context,
        closure_commanded=closure,
        state_measured=np.concatenate([q, np.zeros(4)]),
        triggered=np.array(fired, dtype=float),
    )


def targets(system, context):
    update(system, context)
    return read(system, context, "position_desired")


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


two_bools = st.tuples(st.booleans(), st.booleans())


def curled(target, opening, angles, fired):
    return finger_targets(target, opening, angles, fired, LAST, curl=True)


@given(target=st.floats(0.0, 3.0), base=angle, tip=angle)
def test_a_tip_that_touches_takes_the_rest(target, base, tip):
    result = curled(target, False, (base, tip), (False, True))
    assert result == pytest.approx((LAST[0], target - base))


@given(
    target=st.floats(0.0, 3.0),
    opening=st.booleans(),
    angles=st.tuples(angle, angle),
    fired=two_bools,
)
def test_all_else_is_algorithm_1(target, opening, angles, fired):
    assume(opening or fired != (False, True))
    plain = finger_targets(target, opening, angles, fired, LAST)
    assert curled(target, opening, angles, fired) == plain


@pytest.mark.parametrize("tip", ["algorithm_1", "curl"])
@pytest.mark.parametrize("fired", [[0, 0, 0, 1], [0, 0, 1, 0]])
def test_one_tip_alone_stays_straight(tip, fired):
    """A tip that had touched something in passing stayed bent for the next grasp."""
    # Full scale 3: a closure of 0.5 asks for 1.5 rad.
    system, context = make(0.5, [0.7] * 2 + [0.0] * 2, fired, tip=tip)
    assert targets(system, context) == pytest.approx([1.5, 1.5, 0.0, 0.0])


def test_a_finger_whose_base_senses_too_does_not_curl():
    system, context = make(0.5, [0.7] * 2 + [0.0] * 2, [1, 0, 1, 1], tip="curl")
    both_links = 0.7 + 0.5 * (1.5 - 0.7)  # Algorithm 1 shares what is left
    assert targets(system, context) == pytest.approx([both_links, 0.0, 0.4, 0.8])


@given(lean=st.floats(-0.3, 1.5), apart=st.floats(0.0, 0.6), least=st.floats(0.0, 0.3))
def test_both_tips_curl_or_none_by_how_far_the_bases_lean_on_average(
    lean, apart, least
):
    assume(abs(lean - least) > 1e-6)
    middle = 0.5 * np.pi - lean
    bases = np.clip([middle - apart, middle + apart], -0.1, 1.94)
    assume(np.mean(bases) == pytest.approx(middle))
    system, context = make(
        1.0, [*bases, 0.0, 0.0], [0, 0, 1, 1], tip="curl", curl_lean=least
    )
    curls = targets(system, context)[2:] > 0.0
    assert curls.tolist() == [lean > least] * 2


def closing(q, fired, closure=0.5, **config):
    return make(closure, q, fired, base="freeze", **config)


def test_a_base_freezes_where_its_sensor_fires_and_the_tip_takes_the_rest():
    system, context = closing([0.5, 0.6, 0.0, 0.0], [1, 0, 0, 0])
    expected = [0.5, 1.5, 1.5 - 0.5, 0.0]
    assert targets(system, context) == pytest.approx(expected)
    # It comes to rest further on and stays there, whatever pushes it back.
    for angle in (0.55, 0.52, 0.4):
        given_inputs(system, context, 0.5, [angle, 0.6, 0.0, 0.0], [1, 0, 0, 0])
        assert targets(system, context)[0] == pytest.approx(0.55)


def test_a_frozen_base_goes_on_when_its_sensor_ceases_to_fire():
    system, context = closing([0.5, 0.5, 0.0, 0.0], [1, 1, 0, 0])
    update(system, context)
    given_inputs(system, context, 0.5, [0.5, 0.5, 0.2, 0.2], [0, 1, 0, 0])
    assert targets(system, context)[:2] == pytest.approx([1.5, 0.5])
    # The next thing that it meets stops it anew.
    given_inputs(system, context, 0.5, [0.8, 0.5, 0.2, 0.2], [1, 1, 0, 0])
    assert targets(system, context)[:2] == pytest.approx([0.8, 0.5])


@given(q=four_angles)
def test_fingers_press_as_with_algorithm_1_when_base_and_tip_fire(q):
    fired = [1] * 4
    frozen = targets(*closing(q, fired))
    np.testing.assert_array_equal(frozen, targets(*make(0.5, q, fired)))


def test_opening_frees_a_frozen_base():
    system, context = closing([0.5, 0.5, 0.0, 0.0], [1, 1, 0, 0])
    update(system, context)
    given_inputs(system, context, 0.1, [0.5, 0.5, 0.0, 0.0], [1, 1, 0, 0])
    assert targets(system, context) == pytest.approx([0.3, 0.3, 0.0, 0.0])
    given_inputs(system, context, 0.6, [0.3, 0.3, 0.0, 0.0], [0, 0, 0, 0])
    assert targets(system, context)[:2] == pytest.approx([1.8, 1.8])


def test_a_frozen_base_approaches_slowly_and_presses_no_more_than_allowed():
    system, context = closing(
        [0.5] * 4, [1, 1, 0, 0], approach_speed=1.0, approach_error=0.025
    )
    reached = [targets(system, context)[0] for _ in range(5)]
    assert reached == pytest.approx([0.5, 0.51, 0.52, 0.525, 0.525])
    # What pushes the base back does not make it give way.
    given_inputs(system, context, 0.5, [0.4] * 4, [1, 1, 0, 0])
    assert targets(system, context)[0] == pytest.approx(0.525)


@pytest.mark.slow
@given(
    commands=st.lists(closure, min_size=1, max_size=6),
    q=st.lists(four_angles, min_size=6, max_size=6),
    tips=st.tuples(st.booleans(), st.booleans()),
)
def test_without_a_base_that_senses_anything_nothing_freezes(commands, q, tips):
    fired = [0, 0, *tips]
    plain, frozen = make(fired=fired), closing([0.0] * 4, fired, closure=0.0)
    for command, angles in zip(commands, q, strict=False):
        for system, context in (plain, frozen):
            given_inputs(system, context, command, angles, fired)
        np.testing.assert_array_equal(targets(*plain), targets(*frozen))


def per_message(closure=0.5, q=(0.0,) * 4, messages=0, **config):
    system, context = make(closure, q, evaluate="per_message", **config)
    fix(system, context, closure_messages=float(messages))
    return system, context


def test_per_message_has_a_port_that_counts_messages():
    inputs, _ = port_table(
        UnderactuationLogic(UnderactuationConfig(evaluate="per_message"))
    )
    assert inputs["closure_messages"] == 1


def test_the_algorithm_runs_only_when_a_message_has_arrived():
    system, context = per_message()
    assert targets(system, context).tolist() == [0.0] * 4
    fix(system, context, closure_messages=1.0)
    assert targets(system, context).tolist() == [1.5, 1.5, 0.0, 0.0]
    # A sensor that fires changes nothing by itself ...
    given_inputs(system, context, 0.5, [0.5] * 4, [1, 1, 0, 0])
    assert targets(system, context).tolist() == [1.5, 1.5, 0.0, 0.0]
    # ... until the next message arrives, with the same number.
    fix(system, context, closure_messages=2.0)
    assert targets(system, context).tolist() == [1.5, 1.5, 1.0, 1.0]


def test_overrides_and_hold_need_no_message():
    system, context = per_message(messages=1)
    update(system, context)
    fix(system, context, joint_position_commanded=[0.2, NAN, NAN, NAN])
    assert targets(system, context) == pytest.approx([0.2, 1.5, 0.0, 0.0])
    given_inputs(system, context, 0.5, [0.3] * 4, [0] * 4)
    fix(system, context, hold=1.0)
    assert targets(system, context) == pytest.approx([0.3] * 4)


def test_a_message_that_arrives_during_a_hold_counts_after_it():
    system, context = per_message()
    fix(system, context, hold=1.0, closure_messages=1.0)
    assert targets(system, context).tolist() == [0.0] * 4
    fix(system, context, hold=0.0)
    assert targets(system, context).tolist() == [1.5, 1.5, 0.0, 0.0]


def test_messages_that_nobody_counts_are_an_error():
    system, context = make(evaluate="per_message")
    with pytest.raises(RuntimeError, match=r"per_message needs .* closure_messages"):
        update(system, context)
