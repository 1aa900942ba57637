import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.vision.rectangle import narrowest_rectangle

lengths = st.floats(0.01, 0.2)
places = st.floats(-0.5, 0.5)


@given(lengths, lengths, places, places, st.floats(-3.0, 3.0))
def test_it_holds_a_rectangles_corners_and_is_no_wider(length, width, x, y, yaw):
    c, s = np.cos(yaw), np.sin(yaw)
    corners = 0.5 * np.array([[length, width], [-length, width], [-length, -width]])
    corners = np.concatenate([corners, -corners[1:2]])
    points = corners @ [[c, s], [-s, c]] + [x, y]
    center, sides, found_yaw = narrowest_rectangle(points)
    # Single precision in units of 0.1 mm: 5000 of them have a resolution of 0.0005.
    assert center == pytest.approx([x, y], abs=1e-6)
    assert sorted(sides) == pytest.approx(sorted([length, width]), abs=1e-6)
    c, s = np.cos(found_yaw), np.sin(found_yaw)
    beyond = np.abs((points - center) @ [[c, -s], [s, c]]) - 0.5 * sides
    assert beyond.max() < 1e-6
