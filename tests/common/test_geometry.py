import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from pydrake import geometry

from drake_srg.common.geometry import (
    ConvexPieces,
    cross,
    drake_shape,
    look_at,
    minimum_jerk_blend,
)
from drake_srg.types import Box, Cylinder, Sphere


def test_cross_agrees_with_numpy():
    a, b = np.random.default_rng(0).normal(size=(2, 5, 4, 3))
    np.testing.assert_allclose(cross(a[:, :1], b), np.cross(a[:, :1], b))


@pytest.mark.parametrize(
    ("s", "blend"),
    [(-np.inf, 0.0), (-1.0, 0.0), (0.0, 0.0), (1.0, 1.0), (2.0, 1.0), (np.inf, 1.0)],
)
def test_the_motion_rests_before_its_start_and_after_its_end(s, blend):
    assert minimum_jerk_blend(s) == blend


@given(st.floats(-5.0, 5.0).filter(lambda c: abs(c) > 1e-3), st.floats(-1.0, 2.0))
def test_every_other_motion_from_rest_to_rest_has_more_jerk(size, root):
    s = np.linspace(0.0, 1.0, 6)
    blend = Polynomial.fit(s, [minimum_jerk_blend(x) for x in s], 5).convert()
    # Zero at both ends, like its first two derivatives.
    change = size * Polynomial([0, 1]) ** 3 * Polynomial([1, -1]) ** 3
    change *= Polynomial([-root, 1])

    def cost(motion):
        integral = (motion.deriv(3) ** 2).integ()
        return integral(1.0) - integral(0.0)

    assert cost(blend) == pytest.approx(720.0)
    assert cost(blend + change) > cost(blend)


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        (Cylinder(0.1, 0.3), geometry.Cylinder(0.1, 0.3)),
        (Box([0.1, 0.2, 0.3]), geometry.Box(0.1, 0.2, 0.3)),
        (Sphere(0.1), geometry.Sphere(0.1)),
    ],
)
def test_a_shape_keeps_its_size(shape, expected):
    assert repr(drake_shape(shape)) == repr(expected)


def test_several_pieces_become_their_hull():
    corners = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    inside = 0.1 * corners + [0.1, 0.1, 0.1]
    hull = drake_shape(ConvexPieces((inside, corners))).GetConvexHull()
    found = [hull.vertex(i) for i in range(hull.num_vertices())]
    assert sorted(map(tuple, found)) == sorted(map(tuple, corners))


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
