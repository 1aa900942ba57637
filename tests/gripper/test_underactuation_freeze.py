import numpy as np
import pytest
from helpers import update
from hypothesis import given
from hypothesis import strategies as st

from gripper.underactuation_case import (
    closure,
    four_angles,
    given_inputs,
    make,
    targets,
)


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
