import dataclasses as dc

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.types import Box, Cylinder, Sphere
from drake_srg.vision.sight import INSIDE, OUTSIDE, UNKNOWN, Outline, look
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


# Off the camera's axis, so that its side and its foot are in view.
UPRIGHT = RigidTransform([0.03, 0.02, 0.025])
LID = (Cylinder(0.008, 0.01), RigidTransform([0.03, 0.02, 0.06]))


def labels_of(view, X_WO=UPRIGHT, **options):
    """Return the labels as an image, and the sight."""
    sight = look(CYLINDER, X_WO, view, margin=3, **options)
    image = np.full(view.depth.shape, 2)
    image[sight.pixels[:, 1], sight.pixels[:, 0]] = sight.labels
    return image, sight


def test_at_the_true_pose_labels_and_outline_agree():
    view = view_of(CYLINDER, UPRIGHT)
    labels, sight = labels_of(view)
    assert np.all(labels[view.blob] == INSIDE)
    assert np.all(sight.distance[sight.labels == INSIDE] < 0.1)
    assert np.all(sight.distance[sight.labels == OUTSIDE] > -0.1)
    assert np.abs(sight.error[sight.blob]).max() < 1e-6
    # Nothing else is INSIDE except for table pixels that nearly touch the foot.
    assert np.all(np.abs(sight.error[(sight.labels == INSIDE) & ~sight.blob]) < 1e-4)


def test_pixels_are_labelled_as_far_as_the_margin():
    view = view_of(CYLINDER, UPRIGHT)
    _, sight = labels_of(view)
    assert 2.5 < sight.distance.max() < 3 * np.sqrt(2) + 1


def test_pixels_in_front_of_the_solid_are_unknown():
    view = view_of(CYLINDER, UPRIGHT, [LID])
    labels, sight = labels_of(view)
    above = sight.points[:, 2] > 0.051
    assert above.any()
    assert np.all(sight.labels[above] == UNKNOWN)
    assert np.all(labels[view.blob] == INSIDE)


def test_pixels_without_depth_are_unknown_and_too_far_ones_are_outside():
    view = view_of(CYLINDER, UPRIGHT)
    for missing, expected in ((0.0, UNKNOWN), (np.nan, UNKNOWN), (np.inf, OUTSIDE)):
        depth = np.where(view.blob, view.depth, missing)
        _, sight = labels_of(dc.replace(view, depth=depth))
        assert np.all(sight.labels[~sight.blob] == expected)


def test_the_surface_in_another_colour_is_still_the_surface():
    view = view_of(CYLINDER, UPRIGHT)
    left = view.blob & (np.arange(view.blob.shape[1]) < view.blob.shape[1] // 2)
    labels, sight = labels_of(dc.replace(view, blob=left))
    shaded = view.blob & ~left
    shaded[:, 1:] &= ~left[:, :-1]  # beside the blob, a rim pixel may mix colours
    assert np.all(labels[shaded] != OUTSIDE)
    assert sight.surface.sum() >= view.blob.sum()


def test_pixels_of_the_same_colour_elsewhere_are_unknown():
    view = view_of(CYLINDER, UPRIGHT)
    others = ~view.blob
    _, sight = labels_of(dc.replace(view, others=others))
    assert np.all(sight.labels[~sight.blob & ~sight.surface] == UNKNOWN)


def test_the_far_side_of_a_solid_is_not_visible():
    view = view_of(CYLINDER, UPRIGHT)
    # Its lower end is where the upper one is seen.
    _, sight = labels_of(view, UPRIGHT @ RigidTransform([0.0, 0.0, 0.05]))
    assert not np.any(sight.surface & sight.blob)


@pytest.mark.parametrize(("off", "doubt"), [(5e-4, 0.0), (5e-4, 1e-3), (2e-2, 1e-3)])
def test_doubt_and_spread_widen_the_surface(off, doubt):
    view = view_of(CYLINDER, UPRIGHT)
    _, exact = labels_of(view)
    _, sight = labels_of(view, RigidTransform([0.0, 0.0, -off]) @ UPRIGHT, doubt=doubt)
    assert exact.thickness == pytest.approx(1e-4)
    assert max(1e-4, doubt) <= sight.thickness <= 3e-3
    assert sight.thickness >= min(3e-3, off)
