"""The pose of a solid from the points on its visible surface."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from drake_srg.servoing.surface_tracker import fit_translation
from drake_srg.types import Box, Cylinder, Sphere
from drake_srg.vision.solids import signed_distance

SHAPES = [Cylinder(0.034, 0.1), Box([0.06, 0.05, 0.09]), Sphere(0.035)]


def visible_points(solid, X_CO, rng, count=1500):
    """Points on the surface that faces the camera."""
    size = solid.bounding_size
    p_O = rng.uniform(-0.7, 0.7, (40 * count, 3)) * size
    for _ in range(8):  # onto the surface
        distance, normal = signed_distance(solid, p_O)
        p_O = p_O - distance[:, None] * normal
    _, normal = signed_distance(solid, p_O)
    p_C = p_O @ X_CO.rotation().matrix().T + X_CO.translation()
    facing = np.sum(p_C * (normal @ X_CO.rotation().matrix().T), axis=1) < -1e-3
    return p_C[facing][:count]


@pytest.mark.parametrize("solid", SHAPES, ids=lambda s: type(s).__name__)
@settings(max_examples=5, deadline=None)
@given(st.floats(-0.4, 0.4), st.floats(0.9, 1.4), st.integers(0, 1000))
def test_the_position_is_found_from_above_and_aslant(solid, roll, pitch, seed):
    rng = np.random.default_rng(seed)
    R = RotationMatrix(RollPitchYaw(roll, pitch + np.pi / 2, 0.3))
    X_CO = RigidTransform(R, [*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.15, 0.3)])
    points = visible_points(solid, X_CO, rng)
    noisy = points + 2e-4 * rng.normal(size=points.shape)
    found = fit_translation(noisy, solid, R)
    assert np.linalg.norm(found - X_CO.translation()) < 5e-4


def test_some_points_of_something_behind_do_not_matter():
    rng = np.random.default_rng(1)
    solid = SHAPES[0]
    R = RotationMatrix(RollPitchYaw(0.2, 2.6, 0.0))
    X_CO = RigidTransform(R, [0.01, 0.0, 0.2])
    points = visible_points(solid, X_CO, rng)
    points[::12] *= rng.uniform(1.0, 1.4, (len(points[::12]), 1))
    found = fit_translation(points, solid, R)
    assert np.linalg.norm(found - X_CO.translation()) < 1e-3


def test_a_single_face_does_not_determine_the_position():
    rng = np.random.default_rng(2)
    face = np.column_stack([rng.uniform(-0.02, 0.02, (500, 2)), np.full(500, 0.2)])
    assert fit_translation(face, Box([0.06, 0.06, 0.06]), RotationMatrix()) is None
    assert fit_translation(face[:2], SHAPES[0], RotationMatrix()) is None
