import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.types import Cylinder
from drake_srg.vision.shape_fit import fit_shape
from vision.ray_cast import X_WC, lying, view_of

CYLINDER = Cylinder(0.0125, 0.05)
PIXEL = 1.3e-3  # m, on the table
yaws = st.floats(-np.pi, np.pi)
places = st.floats(-0.04, 0.04)


def fit_to(view):
    """Return the fit of the cylinder to a view."""
    return fit_shape(CYLINDER, view)


def z_axis(fit):
    return fit.X_WO.rotation().matrix()[:, 2]


def turned(fit, axis):
    """Return the angle between a fit's axis and a cylinder's [rad]."""
    return float(np.arcsin(min(1.0, np.linalg.norm(np.cross(z_axis(fit), axis)))))


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(st.floats(0.0, np.pi / 2), yaws, places, places)
def test_a_cylinder_is_located_whether_it_stands_leans_or_lies(tilt, yaw, x, y):
    X_WO, axis = lying(CYLINDER, tilt, yaw, x, y)
    fit = fit_to(view_of(CYLINDER, X_WO))
    # An end parallel to a row of pixels may be anywhere between two rows.
    assert fit.X_WO.translation() == pytest.approx(X_WO.translation(), abs=0.5 * PIXEL)
    assert turned(fit, axis) < np.deg2rad(0.1)
    assert z_axis(fit)[2] >= 0.0
    assert fit.quality > 0.8
    assert not (fit.cut or fit.uncertain)


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(st.floats(0.0, np.pi / 2), yaws, st.integers(0, 1000))
def test_noise_is_averaged_out(tilt, yaw, seed):
    X_WO, axis = lying(CYLINDER, tilt, yaw, 0.01, -0.02)
    fit = fit_to(view_of(CYLINDER, X_WO, noise=3e-4, seed=seed))
    assert fit.X_WO.translation() == pytest.approx(X_WO.translation(), abs=PIXEL)
    assert turned(fit, axis) < np.deg2rad(1.0)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(st.floats(0.0, 10.0), yaws, st.integers(0, 1000))
def test_a_hanging_cylinder_may_lean(tilt, yaw, seed):
    X_WO, axis = lying(CYLINDER, np.deg2rad(tilt), yaw, 0.01, -0.02)
    X_WO = RigidTransform([0.0, 0.0, 0.03]) @ X_WO
    view = view_of(CYLINDER, X_WO, noise=3e-4, seed=seed)
    fit = fit_to(dc.replace(view, noise=3e-4))
    assert turned(fit, axis) < np.deg2rad(1.5)


@settings(max_examples=20, deadline=None)
@given(yaws, places, places, st.integers(0, 1000))
def test_noise_does_not_make_a_standing_cylinder_lean(yaw, x, y, seed):
    X_WO, axis = lying(CYLINDER, 0.0, yaw, x, y)
    view = view_of(CYLINDER, X_WO, noise=3e-4, seed=seed)
    fit = fit_to(dc.replace(view, noise=3e-4))
    assert turned(fit, axis) < 1e-6


@pytest.mark.parametrize("noise", [0.0, 3e-4])
@pytest.mark.parametrize("tilt", [0.0, 5.0])
def test_it_needs_no_background(noise, tilt):
    """There may be no floor, or none within the camera's range."""
    X_WO, axis = lying(CYLINDER, np.deg2rad(tilt), 0.5, 0.01, -0.02)
    view = view_of(CYLINDER, X_WO, noise=noise)
    depth = np.where(view.blob, view.depth, np.inf).astype(np.float32)
    fit = fit_to(dc.replace(view, depth=depth, noise=noise))
    assert fit.X_WO.translation() == pytest.approx(X_WO.translation(), abs=PIXEL)
    assert turned(fit, axis) < np.deg2rad(1.5)


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(st.floats(0.0, 1.5), yaws, yaws)
def test_turning_world_and_camera_turns_the_fit(tilt, yaw, turn):
    X_WO, _ = lying(CYLINDER, tilt, yaw, 0.02, -0.01)
    before = fit_to(view_of(CYLINDER, X_WO))
    T = RigidTransform(RotationMatrix.MakeZRotation(turn), [0.0, 0.0, 0.0])
    after = fit_to(view_of(CYLINDER, T @ X_WO, X_WC=T @ X_WC))
    moved = T @ before.X_WO
    assert after.X_WO.translation() == pytest.approx(moved.translation(), abs=1e-5)
    assert z_axis(after) == pytest.approx(moved.rotation().matrix()[:, 2], abs=1e-3)
    assert after.quality == pytest.approx(before.quality, abs=0.05)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(
    st.floats(0.0, np.pi / 2),
    yaws,
    st.floats(0.01, 0.02),
    st.floats(0.0, 0.9),
    yaws,
)
def test_half_a_cylinder_in_view_is_enough(tilt, yaw, radius, share, around):
    """Hiding less than half of it does not mislead the fit, or it is uncertain."""
    X_WO, axis = lying(CYLINDER, tilt, yaw, 0.01, 0.01)
    p = X_WO.translation()
    away = (0.012 + radius) * (1 - 0.5 * share)
    hand = [p[0] + away * np.cos(around), p[1] + away * np.sin(around), 0.12]
    view = view_of(CYLINDER, X_WO, [(Cylinder(radius, 0.02), RigidTransform(hand))])
    whole = view_of(CYLINDER, X_WO)
    fit = fit_to(view)
    if view.blob.sum() > 0.5 * whole.blob.sum() and not fit.uncertain:
        assert fit.X_WO.translation() == pytest.approx(p, abs=PIXEL)
        assert turned(fit, axis) < np.deg2rad(1.0)


def test_a_cylinder_with_both_ends_hidden_is_uncertain():
    X_WO, axis = lying(CYLINDER, np.pi / 2, 0.3)
    ends = []
    for offset in (-0.03, 0.03):
        p = X_WO.translation() + offset * axis
        ends.append((Cylinder(0.018, 0.02), RigidTransform([p[0], p[1], 0.06])))
    fit = fit_to(view_of(CYLINDER, X_WO, ends))
    assert fit.uncertain
    assert turned(fit, axis) < np.deg2rad(1.0)


def test_a_fit_to_a_few_pixels_is_uncertain():
    X_WO, _ = lying(CYLINDER, 0.2, 0.3)
    view = view_of(CYLINDER, X_WO)
    rows, columns = np.nonzero(view.blob)
    few = np.zeros_like(view.blob)
    few[rows[:4], columns[:4]] = True
    fit = fit_to(dc.replace(view, blob=few))
    assert fit is None or fit.uncertain


def test_an_empty_blob_gives_no_fit():
    view = view_of(CYLINDER, lying(CYLINDER, 0.0, 0.0)[0])
    assert fit_to(dc.replace(view, blob=np.zeros_like(view.blob))) is None
