import numpy as np

from drake_srg.experiments.bridge_delays import Change, find_delays


def test_a_delay_ends_when_the_joint_leaves_its_rest():
    positions = [(0.0, 0.0), (0.0, 0.0), (1e-7, 0.0), (0.01, 0.0), (0.01, 0.5)]
    published = [(10.0 + 0.1 * i, np.array(q)) for i, q in enumerate(positions)]
    changes = [
        Change(time=10.15, joint=0, rest=0.0),
        Change(time=10.25, joint=1, rest=0.0),
        Change(time=10.35, joint=0, rest=0.01),  # never leaves it
    ]
    delays = find_delays(published, changes)
    np.testing.assert_allclose(delays, [0.05, 0.15, np.nan])
