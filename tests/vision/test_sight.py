import dataclasses as dc

import numpy as np
import pytest
from pydrake.math import RigidTransform

from drake_srg.types import Cylinder
from drake_srg.vision.sight import INSIDE, OUTSIDE, UNKNOWN, look
from vision.ray_cast import view_of

CYLINDER = Cylinder(0.0125, 0.05)
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
