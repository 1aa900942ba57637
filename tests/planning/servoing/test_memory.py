"""The filter that follows a moving goal."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.planning.servoing.memory import MovingGoal

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
    # A surprise of at most 2 noise moves the velocity by beta / period of that.
    assert np.max(np.abs(goal.v_W - velocity)) < 4 * noise * BETA / PERIOD + 1e-6


def test_a_goal_goes_on_as_it_moved():
    goal = MovingGoal(np.zeros(3), np.array([0.05, 0.0, 0.0]), 1.0)
    np.testing.assert_allclose(goal.at(3.0), [0.1, 0.0, 0.0])
