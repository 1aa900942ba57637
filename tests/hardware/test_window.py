import itertools

import numpy as np
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
    times, _ = zip(*(window.after(np.zeros(1), 0.0) for _ in range(30)), strict=True)
    newest = np.array([t[-1] for t in times])
    np.testing.assert_allclose(np.diff(newest), PERIOD)
    assert times[-1][0] >= 0.0
