import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.types import Box, Cylinder, Sphere
from drake_srg.vision.outline import Outline
from vision.ray_cast import X_WC, cast, lying, view_of

CYLINDER = Cylinder(0.0125, 0.05)
SOLIDS = [CYLINDER, Box([0.02, 0.03, 0.05]), Sphere(0.02)]
lengths = st.floats(-0.03, 0.03)
vectors = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)


def pose(x, y, axis, angle=0.0):
    assume(np.linalg.norm(axis) > 0.1)
    spin = RotationMatrix(AngleAxis(angle, axis / np.linalg.norm(axis)))
    return RigidTransform(
        spin @ RotationMatrix.MakeFromOneVector(axis, 2), [x, y, 0.04]
    )


def a_view():
    return view_of(CYLINDER, RigidTransform([0.0, 0.0, 0.025]))


@pytest.mark.slow
@given(lengths, lengths, vectors)
def test_pixels_inside_the_outline_see_the_solid_and_others_do_not(x, y, axis):
    X_WO = pose(x, y, axis)
    view = view_of(CYLINDER, X_WO)
    rows, columns = np.indices(view.depth.shape).reshape(2, -1)
    pixels = np.stack([columns, rows], axis=1).astype(float)
    distance, _ = Outline.of(CYLINDER, X_WO, view).distance(pixels)
    sees = np.isfinite(cast(CYLINDER, X_WO, view.rays, view.origin))[rows, columns]
    # The outline's circles have 72 sides, 0.1 % inside their radius of ten pixels.
    assert np.all(distance[sees] <= 0.02)
    assert np.all(distance[~sees] >= -1e-6)


def turned(X_WO, turn):
    """Return a pose after a turn by a rotation vector in W [rad]."""
    angle = np.linalg.norm(turn)
    R = RotationMatrix(AngleAxis(angle, turn / angle))
    return RigidTransform(R @ X_WO.rotation(), X_WO.translation())


@settings(max_examples=40)
@given(st.sampled_from(SOLIDS), lengths, lengths, vectors)
def test_the_jacobian_is_the_derivative_of_the_distance(shape, x, y, axis):
    X_WO, view, h, off = pose(x, y, axis), a_view(), 1e-6, 1e-3
    if isinstance(shape, Sphere):
        # Its polygon turns with the viewpoint. A side leans against the circle by up to
        # half of a corner's angle.
        off += 2 * (np.pi / 72) * shape.radius / (X_WC.translation()[2] - 0.04)
        # The polygon jumps where these two are the same.
        toward = X_WO.inverse() @ view.origin
        least, other, _ = np.sort(np.abs(toward))
        assume(other - least > 10 * h)
    pixels = np.random.default_rng(1).uniform(0.0, 80.0, (60, 2))
    _, J = Outline.of(shape, X_WO, view).gradient(pixels)
    moves = [lambda s, i=i: RigidTransform(s * np.eye(3)[i]) @ X_WO for i in range(3)]
    if not isinstance(shape, Sphere):  # its outline turns with the viewpoint
        moves += [lambda s, i=i: turned(X_WO, s * np.eye(3)[i]) for i in range(3)]
    for column, move in zip(J.T, moves, strict=False):
        before, after = (
            Outline.of(shape, move(s), view).distance(pixels)[0] for s in (-h, h)
        )
        wrong = np.abs((after - before) / (2 * h) - column) > off * np.abs(J).max()
        # There is no derivative where two sides are equally far.
        assert wrong.mean() < 0.1


@pytest.mark.slow
@given(st.sampled_from(SOLIDS), vectors, st.floats(-2.0, 2.0))
def test_a_ring_is_as_far_outside_as_requested(shape, axis, grow):
    outline = Outline.of(shape, pose(0.01, -0.01, axis, 0.4), a_view())
    ring = outline.ring(grow, 50)
    assert ring.shape == (50, 2)
    distance, _ = outline.distance(ring)
    # Which of two sides is nearer is rounded to single precision of some 100 pixels.
    assert np.all(distance >= grow - 2e-5)
    assert np.median(distance) == pytest.approx(grow, abs=1e-6)


def test_its_depth_is_that_of_the_solid():
    X_WO = RigidTransform([0.0, 0.0, 0.025])
    outline = Outline.of(CYLINDER, X_WO, a_view())
    middle = np.mean(outline.pieces[0].corners, axis=0)
    _, depth = outline.distance(middle + np.array([[9.0, 0.0], [0.0, -12.0]]))
    assert depth == pytest.approx(X_WC.translation()[2] - CYLINDER.length)


def test_its_mask_covers_the_pixels_inside():
    X_WO, _ = lying(CYLINDER, 1.2, 0.5)
    view = view_of(CYLINDER, X_WO)
    mask = Outline.of(CYLINDER, X_WO, view).mask(view.depth.shape)
    assert np.all(mask[view.blob])
    assert mask.sum() < 1.25 * view.blob.sum()
