import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.helpers import CENTER, FOCAL, make_views, pose, truth
from drake_srg.calibration.start import first_estimate

angles = st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3)
places = st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3)


@given(angles, places, angles, places, st.integers(0, 99))
@settings(max_examples=15)
def test_exact_views_give_both_poses(rpy_c, p_c, rpy_b, p_b, seed):
    camera = truth(pose(rpy_c, p_c), pose(rpy_b, p_b))
    start = first_estimate(make_views(camera, count=5, seed=seed), FOCAL, CENTER)
    np.testing.assert_array_equal(start.focal, FOCAL)
    assert start.X_PC.IsNearlyEqualTo(camera.X_PC, 1e-3)
    assert start.X_QB.IsNearlyEqualTo(camera.X_QB, 1e-3)
