import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw

from drake_srg.planning.grasps.known_surface import KnownSurface
from drake_srg.types import Box, Cylinder, Sphere

SHAPES = [Box([0.1, 0.04, 0.06]), Cylinder(0.03, 0.1), Sphere(0.04)]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
@given(seed=st.integers(0, 99))
def test_points_lie_where_their_normals_touch_the_shape(shape, seed):
    surface = KnownSurface.of_shape(shape, 50, np.random.default_rng(seed))
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1.0)
    extents = [shape.half_extent(normal) for normal in surface.normals]
    along = np.sum(surface.points * surface.normals, axis=1)
    np.testing.assert_allclose(along, extents, atol=1e-9)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_points_are_spread_evenly(shape):
    surface = KnownSurface.of_shape(shape, 20_000, np.random.default_rng(0))
    # The mean of n n^T over a closed surface's area, by faces: twice the projections.
    np.testing.assert_allclose(surface.points.mean(axis=0), 0.0, atol=2e-3)
    np.testing.assert_allclose(surface.normals.mean(axis=0), 0.0, atol=2e-2)


def test_points_of_a_mesh():
    vertices = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.2, 0], [0, 0, 0.1]])
    triangles = np.array([[0, 2, 1], [0, 1, 3]])
    surface = KnownSurface.of_mesh(vertices, triangles, 3000, np.random.default_rng(0))
    below = surface.normals[:, 2] < -0.5
    np.testing.assert_allclose(surface.normals[below], [[0, 0, -1]] * below.sum())
    np.testing.assert_allclose(surface.points[below, 2], 0.0, atol=1e-12)
    assert below.mean() == pytest.approx(2 / 3, abs=0.03)
    middle = surface.points[below].mean(axis=0)
    np.testing.assert_allclose(middle, [0.1 / 3, 0.2 / 3, 0], atol=3e-3)
    with pytest.raises(ValueError, match="some area"):
        KnownSurface.of_mesh(vertices, triangles[:0], 10, np.random.default_rng(0))


def test_a_pose_moves_points_and_turns_normals():
    surface = KnownSurface.of_shape(SHAPES[0], 20, np.random.default_rng(1))
    X_WO = RigidTransform(RollPitchYaw(0.3, 0.2, 0.1), [1.0, 2.0, 3.0])
    posed = surface.posed(X_WO)
    for i in range(20):
        np.testing.assert_allclose(posed.points[i], X_WO @ surface.points[i])
        rotated = X_WO.rotation() @ surface.normals[i]
        np.testing.assert_allclose(posed.normals[i], rotated)
