import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.types import Cylinder
from drake_srg.vision import pose_fit
from drake_srg.vision.pose_fit import align
from vision.ray_cast import lying, view_of

CYLINDER = Cylinder(0.0125, 0.05)
PIXEL = 1.3e-3  # m, on the table
tilts = st.floats(0.0, np.pi / 2)
yaws = st.floats(-np.pi, np.pi)
offsets = st.floats(-2e-3, 2e-3)
turns = st.floats(-0.1, 0.1)
ALL = (3.0, 1.0, 0.3, 0.1, 0.03)


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(tilts, yaws, offsets, offsets, offsets, turns, turns)
def test_a_near_guess_leads_to_the_true_pose(tilt, yaw, dx, dy, dz, about_x, about_y):
    X_WO, axis = lying(CYLINDER, tilt, yaw, 0.02, 0.01)
    R = X_WO.rotation() @ RotationMatrix(AngleAxis(about_x, np.array([1.0, 0.0, 0.0])))
    R = R @ RotationMatrix(AngleAxis(about_y, np.array([0.0, 1.0, 0.0])))
    guess = RigidTransform(R, X_WO.translation() + np.array([dx, dy, dz]))
    found = align(CYLINDER, guess, view_of(CYLINDER, X_WO), ALL).X_WO
    # An end parallel to a row of pixels may be anywhere between two rows.
    assert found.translation() == pytest.approx(X_WO.translation(), abs=0.5 * PIXEL)
    turn = np.linalg.norm(np.cross(found.rotation().matrix()[:, 2], axis))
    assert turn < np.sin(np.deg2rad(0.1))


def test_the_deviation_shows_how_well_a_pose_is_known():
    upright, _ = lying(CYLINDER, 0.0, 0.0, 0.02, 0.01)
    whole = align(CYLINDER, upright, view_of(CYLINDER, upright), (0.3,))
    assert whole.position_deviation < 0.1 * PIXEL
    assert whole.axis_deviation < np.deg2rad(0.5)
    # A lid leaves only a sliver of the top.
    lid = (Cylinder(0.0125, 0.01), RigidTransform([0.016, 0.009, 0.06]))
    view = view_of(CYLINDER, upright, [lid])
    sliver = align(CYLINDER, upright, view, (0.3,))
    assert sliver.position_deviation > 2 * whole.position_deviation
    assert sliver.axis_deviation > 2 * whole.axis_deviation


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(st.floats(0.0, 1.2), yaws, st.floats(-np.pi, np.pi))  # an end is in view
def test_a_guess_turned_about_the_cylinders_axis_changes_nothing(tilt, yaw, spin):
    X_WO, _ = lying(CYLINDER, tilt, yaw, 0.02, 0.01)
    view = view_of(CYLINDER, X_WO)
    turned = RigidTransform(RotationMatrix.MakeZRotation(spin), [0.0, 0.0, 0.0])
    a, b = (
        align(CYLINDER, X, view, (0.3, 0.1)).X_WO.translation()
        for X in (X_WO, X_WO @ turned)
    )
    # The 72 sides of the ends' circles are turned.
    assert a == pytest.approx(b, abs=0.05 * PIXEL)


def test_a_guess_that_nothing_moves_stays(monkeypatch):
    still = (np.zeros(5), np.eye(5))
    monkeypatch.setattr(pose_fit, "_depth_cost", lambda *_: still)
    monkeypatch.setattr(pose_fit, "_outline_cost", lambda *_: still)
    X_WO, _ = lying(CYLINDER, 0.0, 0.0, 0.02, 0.01)
    found = align(CYLINDER, X_WO, view_of(CYLINDER, X_WO), (0.3,))
    assert found.X_WO.IsNearlyEqualTo(X_WO, 1e-12)
