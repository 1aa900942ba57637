import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw

from drake_srg.types import Cylinder
from drake_srg.vision.guesses import fit_plane, guess_poses
from vision.ray_cast import lying, view_of

degrees = st.floats(-8.0, 8.0)


def can_points(roll=0.0, pitch=0.0, noise=0.0, seed=0):
    """Return points of a can's top and of the side that a camera on its right sees."""
    rng = np.random.default_rng(seed)
    radius = 0.0339 * np.sqrt(rng.random(400))
    angle = rng.uniform(-np.pi, np.pi, 400)
    top = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle], -1)
    angle = rng.uniform(-1.4, 1.4, 500)
    side = 0.0339 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1)
    side[:, 2] = rng.uniform(-0.1, 0.0, 500)
    R = RollPitchYaw(np.deg2rad(roll), np.deg2rad(pitch), 0.0).ToRotationMatrix()
    points = np.concatenate([top, side]) @ R.matrix().T
    points[:, 2] += 0.2 + rng.normal(0.0, noise, len(points))
    return points, R.matrix()[:, 2]


@given(degrees, degrees)
def test_the_plane_is_that_of_the_top_and_not_of_the_side(roll, pitch):
    points, expected = can_points(roll, pitch)
    normal, center, thickness = fit_plane(points, 0.0678)
    assert normal @ expected > np.cos(np.deg2rad(0.2))
    assert abs((center - [0, 0, 0.2]) @ expected) < 1e-4
    assert thickness < 1e-3


def test_noise_widens_the_plane_but_does_not_move_it():
    points, _ = can_points(noise=3e-4)
    normal, center, thickness = fit_plane(points, 0.0678)
    assert normal[2] > np.cos(np.deg2rad(1.0))
    assert center[2] == pytest.approx(0.2, abs=1e-4)
    assert 4e-4 < thickness <= 3e-3


def test_a_sliver_counts_as_level():
    x = np.linspace(-0.03, 0.03, 50)
    sliver = np.stack([x, 1e-4 * np.sin(900 * x), 0.1 + 0.02 * x], axis=-1)
    normal, _, _ = fit_plane(sliver, 0.0678)
    assert normal.tolist() == [0.0, 0.0, 1.0]


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(
    st.floats(0.0, 0.1) | st.floats(1.4, np.pi / 2),
    st.floats(-np.pi, np.pi),
    st.floats(-0.03, 0.03),
)
def test_one_guess_has_the_right_axis_if_half_is_hidden(tilt, yaw, side):
    shape = Cylinder(0.0125, 0.05)
    X_WO, axis = lying(shape, tilt, yaw, 0.01, 0.01)
    hand = X_WO.translation() + np.array([side, 0.0, 0.08])
    view = view_of(shape, X_WO, [(Cylinder(0.015, 0.02), RigidTransform(hand))])
    assume(view is not None and view.blob.sum() > 60)
    guesses = guess_poses(shape, view)
    axes = np.array([guess.rotation().matrix()[:, 2] for guess in guesses])
    turns = np.linalg.norm(np.cross(axes, axis), axis=1)
    # Normals of pixels across an edge lie between those of both surfaces.
    assert turns.min() < np.sin(np.deg2rad(10.0))
