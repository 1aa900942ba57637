import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.helpers import make_views, pose, truth
from drake_srg.calibration.projection import NUM_PARAMETERS, jacobian, project

angles = st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3)
places = st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3)


@given(angles, places, angles, places)
@settings(max_examples=20)
def test_the_derivatives_are_those_of_the_projection(rpy_c, p_c, rpy_b, p_b):
    camera = truth(pose(rpy_c, p_c), pose(rpy_b, p_b))
    (view,) = make_views(camera, count=1)
    expected = np.zeros((len(view.p_B), 2, NUM_PARAMETERS))
    for i in range(NUM_PARAMETERS):
        step = np.zeros(NUM_PARAMETERS)
        step[i] = 1e-5
        ahead, behind = camera.moved(step), camera.moved(-step)
        expected[:, :, i] = (project(ahead, view) - project(behind, view)) / 2e-5
    np.testing.assert_allclose(jacobian(camera, view), expected, rtol=1e-4, atol=1e-3)


def test_a_point_on_the_axis_is_at_the_principal_point():
    camera = truth(pose([0, 0, 0], [0, 0, 0]), pose([0, 0, 0], [0, 0, 0]))
    (view,) = make_views(camera, count=1)
    lone = type(view)("", pose([0, 0, 0], [0, 0, 1.0]), np.zeros((1, 3)), view.pixels)
    np.testing.assert_allclose(project(camera, lone)[0], camera.center)
