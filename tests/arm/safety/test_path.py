import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arm.safety.stand import LIMITS, curve, distance_to_line
from drake_srg.arm.safety.path import Path

START = np.zeros(2)


def along(commands):
    path = Path.at_rest(START)
    for q in commands:
        path = path.extended(q)
    return path


def test_at_full_speed_it_comes_by_every_command_exactly():
    commands = curve(50)
    path = along(commands)
    for q in commands:
        path = path.advanced(1.0, LIMITS.bend)
        np.testing.assert_array_equal(path.q, q)
    assert not len(path.ahead)


@given(st.lists(st.sampled_from([0.0, 0.2, 0.5, 0.9, 1.0]), max_size=12))
def test_at_any_speed_it_stays_on_the_path_and_changes_its_speed_gently(rates):
    commands = curve(130)
    path, line = along(commands), np.vstack([START, commands])
    for rate in rates:
        for _ in range(10):
            before, path = path, path.advanced(rate, LIMITS.bend)
            assert np.all(np.abs(path.step - before.step) <= LIMITS.bend + 1e-11)
            assert np.max(distance_to_line([path.q], line)) < 1e-9


@pytest.mark.parametrize("rate", [0.25, 0.5, 1.0])
def test_it_goes_at_the_speed_asked_for(rate):
    path = along(curve(200))
    for _ in range(100):
        path = path.advanced(rate, LIMITS.bend)
    # The commands are still getting faster, and a step may lie on two pieces.
    assert path.rate == pytest.approx(rate, abs=0.02)
    assert len(path.ahead) - path.passed == pytest.approx(200 - 100 * rate, abs=1.0)


def test_repeated_commands_are_dropped():
    path = along([START, [0.1, 0.0], [0.1, 0.0]])
    np.testing.assert_array_equal(path.ahead, [[0.1, 0.0]])


def test_where_the_path_ends_it_brakes_straight_on():
    commands = curve(100)
    path = along(commands)
    for _ in commands:
        path = path.advanced(1.0, LIMITS.bend)
    direction, end = path.step, path.q
    steps = 0
    while path.step.any():
        path, steps = path.advanced(0.0, LIMITS.brake), steps + 1
    assert steps == np.ceil(np.max(np.abs(direction) / LIMITS.brake))
    gone = path.q - end
    assert gone[0] * direction[1] == pytest.approx(gone[1] * direction[0], abs=1e-15)


def test_a_path_with_a_sharp_corner_is_left_for_a_stop_within_the_limits():
    path = along([[0.001, 0.0], [0.003, 0.0], [0.003, 0.005], [0.003, 0.012]])
    path = path.advanced(1.0, np.full(2, 1.0)).advanced(1.0, np.full(2, 1.0))
    while path.step.any():
        before, path = path, path.advanced(0.0, LIMITS.brake)
        assert np.all(np.abs(path.step - before.step) <= LIMITS.brake + 1e-11)
    assert not np.array_equal(path.end, [0.003, 0.012])
