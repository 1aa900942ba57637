import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.planning.servoing.memory import HandOver

PERIOD = 0.01
joints = st.lists(st.floats(-0.5, 0.5), min_size=2, max_size=2).map(np.array)


@given(joints, joints)
def test_a_deviation_fades_without_a_jump(offset, rate):
    over, offsets = HandOver(offset, rate), [offset - PERIOD * rate, offset]
    while over is not None:
        over = over.stepped(PERIOD)
        offsets.append(np.zeros(2) if over is None else over.offset)
        assert len(offsets) < 500
    velocity = np.diff(offsets, axis=0) / PERIOD
    acceleration = np.abs(np.diff(velocity, axis=0)) / PERIOD
    # Of a critically damped spring, and what sampling adds.
    limit = 36.0 * np.abs(offset) + 12.0 * np.abs(rate) + 0.1
    assert np.all(acceleration <= limit)


def test_a_deviation_that_is_gone_is_none():
    assert HandOver(np.zeros(3), np.zeros(3)).stepped(PERIOD) is None
