import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from drake_srg.common.geometry import ConvexPieces
from drake_srg.types import Box, Cylinder, Sphere
from drake_srg.vision.solids import (
    least_turned,
    outline_points,
    signed_distance,
    turn_between,
)

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


angles = st.floats(-np.pi, np.pi)
rotations = st.tuples(angles, angles, angles).map(
    lambda rpy: RollPitchYaw(rpy).ToRotationMatrix()
)
PIECES = ConvexPieces((np.concatenate([np.zeros((1, 3)), np.eye(3)]),))
LOOKING_ALIKE = [
    Cylinder(0.02, 0.1),
    Box([0.1, 0.2, 0.3]),
    Box([0.1] * 3),
    Sphere(),
    PIECES,
]
alike = st.sampled_from(LOOKING_ALIKE)


def angle(R):
    return abs(R.ToAngleAxis().angle())


@given(alike, rotations)
def test_the_least_turned_pose_looks_alike_and_is_turned_no_more(solid, R_WO):
    X_WO = RigidTransform(R_WO, [1.0, 2.0, 3.0])
    X_least = least_turned(solid, X_WO)
    assert X_least.translation().tolist() == [1.0, 2.0, 3.0]
    assert turn_between(solid, R_WO, X_least.rotation()) == pytest.approx(0, abs=1e-7)
    assert angle(X_least.rotation()) <= angle(R_WO) + 1e-7


@given(rotations)
def test_a_cylinder_keeps_its_axis_and_points_upwards(R_WO):
    z_W = least_turned(LOOKING_ALIKE[0], RigidTransform(R_WO)).rotation().matrix()[:, 2]
    expected = R_WO.matrix()[:, 2]
    np.testing.assert_array_equal(z_W, expected * np.copysign(1.0, expected[2]))


@given(rotations)
def test_a_ball_is_not_turned(R_WO):
    assert angle(least_turned(Sphere(), RigidTransform(R_WO)).rotation()) == 0.0


@given(rotations)
def test_a_cube_is_turned_by_no_more_than_its_symmetry_leaves(R_WO):
    R = least_turned(LOOKING_ALIKE[2], RigidTransform(R_WO)).rotation()
    # The largest misorientation of cubes (Handscomb, 1958).
    assert angle(R) <= np.deg2rad(62.8)


@given(alike, rotations, angles)
def test_the_turn_between_does_not_exceed_the_angle(solid, R_WO, about_z):
    R_2 = R_WO @ RotationMatrix.MakeZRotation(about_z)
    turn = turn_between(solid, R_WO, R_2)
    assert turn <= abs(about_z) + 1e-7
    if isinstance(solid, Cylinder):
        assert turn == pytest.approx(0, abs=1e-7)
    if solid is PIECES:
        assert turn == pytest.approx(abs(about_z), abs=1e-6)


@pytest.mark.parametrize(("yaw", "turn"), [(180, 0), (90, 90), (100, 80), (-30, 30)])
def test_a_box_looks_alike_after_half_a_turn(yaw, turn):
    R = RotationMatrix.MakeZRotation(np.deg2rad(yaw))
    measured = turn_between(LOOKING_ALIKE[1], RotationMatrix(), R)
    assert measured == pytest.approx(np.deg2rad(turn), abs=1e-9)
