import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.bridges.dynamixel.encoder import JOINT, SPOOL

OPEN = 3298  # position of the open gripper


@pytest.mark.parametrize(
    ("turns", "counts"), [(0.0, OPEN), (0.25, OPEN - 1024), (-2.0, OPEN + 8192)]
)
def test_closing_lowers_the_counts(turns, counts):
    assert SPOOL.to_counts(turns * math.tau) == pytest.approx(counts)


@given(st.sampled_from([SPOOL, JOINT]), st.floats(-1e3, 1e3))
def test_angles_and_counts_are_inverse(encoder, angle):
    assert encoder.to_angle(encoder.to_counts(angle)) == pytest.approx(angle, abs=1e-9)
