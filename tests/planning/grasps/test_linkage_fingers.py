import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.planning.grasps.linkage_fingers import LinkageFingers

FINGERS = LinkageFingers()
OFFSETS = 0.001 * np.arange(-70, 71.0)


@given(half_gap=st.floats(0.005, 0.03))
def test_the_silhouette_of_the_open_hand(half_gap):
    reach = FINGERS.silhouette(half_gap, OFFSETS)
    assert reach.max() <= FINGERS.deepest + 1e-9
    between = np.abs(OFFSETS) < half_gap - 0.002
    np.testing.assert_allclose(reach[between], FINGERS.palm_x)
    assert reach[np.abs(OFFSETS) > half_gap + 0.022].max() <= FINGERS.palm_x


@given(width=st.floats(0.01, 0.05))
def test_wider_things_need_more_open_fingers(width):
    assert FINGERS.tellable(width)
    opened, closed = FINGERS.opened(0.5 * width + 0.003), FINGERS.closed(width)
    assert 0.0 <= opened.closure < closed.closure <= 1.0
    assert all(opened.joints[name] < closed.joints[name] for name in closed.joints)
    held = np.array(list(closed.joints.values()))[:2]
    assert FINGERS.holds(width, held, np.zeros(2))
    empty = FINGERS.closed(0.0).joints.values()
    assert not FINGERS.holds(width, np.array(list(empty))[:2], np.zeros(2))


def test_it_opens_to_its_stop_at_most():
    assert FINGERS.opened(0.1).closure == pytest.approx(0.0)
