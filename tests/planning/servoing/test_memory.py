"""The goal's filter, and the return of a servo to planned positions."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.planning.servoing.memory import HandOver, MovingGoal

speeds = st.tuples(*[st.floats(-0.1, 0.1)] * 3)
ALPHA, BETA, PERIOD = 0.6, 0.135, 0.04


@given(speeds, st.integers(0, 2**32 - 1))
def test_position_and_velocity_converge(velocity, seed):
    rng = np.random.default_rng(seed)
    velocity, noise = np.array(velocity), 1e-4
    goal = MovingGoal(np.zeros(3))
    for i in range(1, 60):
        seen = i * PERIOD * velocity + rng.uniform(-noise, noise, 3)
        goal = goal.seen(seen, i * PERIOD, ALPHA, BETA)
    assert np.max(np.abs(goal.at(goal.time) - 59 * PERIOD * velocity)) < 2 * noise
    # An innovation of at most 2 noise changes the velocity by beta / period times it.
    assert np.max(np.abs(goal.v_W - velocity)) < 4 * noise * BETA / PERIOD + 1e-6


def test_a_goal_goes_on_as_it_moved():
    goal = MovingGoal(np.zeros(3), np.array([0.05, 0.0, 0.0]), 1.0)
    np.testing.assert_allclose(goal.at(3.0), [0.1, 0.0, 0.0])


STEP = 0.01  # s
joints = st.lists(st.floats(-0.5, 0.5), min_size=2, max_size=2).map(np.array)


@given(joints, joints)
def test_a_deviation_fades_without_a_jump(offset, rate):
    over, offsets = HandOver(offset, rate), [offset - STEP * rate, offset]
    while over is not None:
        over = over.stepped(STEP)
        offsets.append(np.zeros(2) if over is None else over.offset)
        assert len(offsets) < 500
    velocity = np.diff(offsets, axis=0) / STEP
    acceleration = np.abs(np.diff(velocity, axis=0)) / STEP
    # Of a critically damped spring, and what sampling adds.
    limit = 36.0 * np.abs(offset) + 12.0 * np.abs(rate) + 0.1
    assert np.all(acceleration <= limit)


def test_a_deviation_that_is_gone_is_none():
    assert HandOver(np.zeros(3), np.zeros(3)).stepped(STEP) is None
