import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from drake_srg.common.viewing import look_at

POINTS = st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3).map(np.array)


@given(POINTS, POINTS)
def test_the_camera_looks_at_the_point_and_stands_upright(p_WC, p_WL):
    assume(np.linalg.norm((p_WL - p_WC)[:2]) > 0.01)
    X_WC = look_at(p_WC, p_WL)
    p_CL = X_WC.inverse() @ p_WL
    np.testing.assert_allclose(p_CL[:2], 0.0, atol=1e-9)
    assert p_CL[2] > 0.0
    R = X_WC.rotation().matrix()
    assert abs(R[2, 0]) < 1e-12  # its x is level
    assert R[2, 1] <= 0.0  # its y points down
