import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ray_cast import lying, view_of

from drake_srg.types import Cylinder
from drake_srg.vision.shape_fit import fit_shape

CYLINDER = Cylinder(0.0125, 0.05)
PIXEL = 1.3e-3  # m, on the table
yaws = st.floats(-np.pi, np.pi)
places = st.floats(-0.04, 0.04)


def turned(fit, axis):
    """Angle between a fit's axis and a cylinder's [rad]."""
    return float(np.arcsin(min(1.0, np.linalg.norm(np.cross(fit.axis, axis)))))


@settings(max_examples=60, deadline=None)
@given(st.floats(0.0, np.pi / 2), yaws, places, places)
def test_a_cylinder_is_found_however_it_stands_leans_or_lies(tilt, yaw, x, y):
    X_WO, axis = lying(CYLINDER, tilt, yaw, x, y)
    fit = fit_shape(CYLINDER, view_of(CYLINDER, X_WO))
    # Ends along a row of pixels may be anywhere between two rows.
    assert fit.position == pytest.approx(X_WO.translation(), abs=0.5 * PIXEL)
    assert turned(fit, axis) < np.deg2rad(0.1)
    assert fit.axis[2] >= 0.0
    assert fit.quality > 0.8
    assert not (fit.cut or fit.uncertain)


@settings(max_examples=20, deadline=None)
@given(st.floats(0.0, np.pi / 2), yaws, st.integers(0, 1000))
def test_noise_is_averaged(tilt, yaw, seed):
    X_WO, axis = lying(CYLINDER, tilt, yaw, 0.01, -0.02)
    fit = fit_shape(CYLINDER, view_of(CYLINDER, X_WO, noise=3e-4, seed=seed))
    assert fit.position == pytest.approx(X_WO.translation(), abs=PIXEL)
    assert turned(fit, axis) < np.deg2rad(1.0)
