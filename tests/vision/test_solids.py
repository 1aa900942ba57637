import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.types import Box, Cylinder, Sphere
from drake_srg.vision.solids import outline_points, signed_distance

SOLIDS = [Cylinder(0.02, 0.05), Box([0.03, 0.05, 0.08]), Sphere(0.03)]
solids = st.sampled_from(SOLIDS)
points = st.tuples(*[st.floats(-0.1, 0.1)] * 3).map(lambda p: np.array([p]))


def distance(shape, p):
    return float(signed_distance(shape, p)[0][0])


@pytest.mark.parametrize(
    ("shape", "point", "expected"),
    [
        (SOLIDS[0], [0.0, 0.03, 0.0], 0.01),
        (SOLIDS[0], [0.0, 0.0, -0.028], 0.003),
        (SOLIDS[0], [0.023, 0.0, 0.029], 0.005),
        (SOLIDS[0], [0.0, 0.015, 0.001], -0.005),
        (SOLIDS[1], [0.018, 0.0, 0.044], 0.005),
        (SOLIDS[1], [0.0, -0.022, 0.0], -0.003),
        (SOLIDS[2], [0.0, 0.03, 0.04], 0.02),
    ],
)
def test_distances_are_exact(shape, point, expected):
    assert distance(shape, np.array([point])) == pytest.approx(expected)


@given(solids, points)
def test_a_step_against_the_gradient_leads_to_the_surface(shape, p):
    (d,), (gradient,) = signed_distance(shape, p)
    if d > 0:  # inside, a step may cross the other side of an edge
        assert np.linalg.norm(gradient) == pytest.approx(1.0)
        assert distance(shape, p - d * gradient) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.slow
@given(solids, points, points)
def test_distances_change_no_faster_than_the_point_moves(shape, p, q):
    change = abs(distance(shape, p) - distance(shape, q))
    assert change <= np.linalg.norm(p - q) + 1e-12


@given(solids, points)
def test_the_bounding_size_holds_all_points_inside(shape, p):
    if distance(shape, p) < 0:
        assert np.all(np.abs(p) <= 0.5 * shape.bounding_size)


@pytest.mark.parametrize("shape", SOLIDS, ids=lambda s: type(s).__name__)
def test_outline_points_lie_on_the_surface(shape):
    (p,) = outline_points(shape, np.array([0.3, -0.4, 0.9]))
    np.testing.assert_allclose(signed_distance(shape, p)[0], 0.0, atol=1e-12)


def test_a_balls_outline_is_where_rays_are_tangent():
    eye = np.array([0.03, 0.05, -0.06])
    (p,) = outline_points(Sphere(0.03), eye)
    np.testing.assert_allclose(((p - eye) * p).sum(axis=1), 0.0, atol=1e-12)
