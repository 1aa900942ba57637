import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator

from drake_srg.arm.trajectory_follower import TrajectoryFollower, trajectory_piece
from drake_srg.hardware.window import Window

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


def test_a_clock_that_stands_still_is_not_overtaken_by_faster_motion():
    window = Window(LEAD, PERIOD)
    times, _ = zip(*(window.after(path(0.01 * k), 0.0) for k in range(30)), strict=True)
    newest = np.array([t[-1] for t in times])
    np.testing.assert_allclose(np.diff(newest), PERIOD)
    assert times[-1][0] >= 0.0


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
