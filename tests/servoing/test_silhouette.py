"""Silhouettes in images: their ellipses, and when they do not count."""

import numpy as np
import pytest
from helpers import fix, read
from pydrake.common.value import AbstractValue
from pydrake.systems.sensors import CameraConfig, ImageDepth32F, ImageRgba8U

from drake_srg.servoing.silhouette import ellipse_ends, silhouette
from drake_srg.servoing.silhouette_tracker import SilhouetteTracker
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.color import ColorRange

RED = ColorRange.around([0.8, 0.1, 0.08])
CAMERA = CameraModel.from_config(CameraConfig(width=160, height=120))


def disc(u, v, radius, shape=(120, 160)):
    rows, columns = np.indices(shape)
    return (columns - u) ** 2 + (rows - v) ** 2 <= radius**2


def test_the_ends_of_a_disc_are_on_its_rim():
    ends = ellipse_ends(disc(70.0, 50.0, 20.0))
    expected = [[90, 50], [50, 50], [70, 70], [70, 30]]
    np.testing.assert_allclose(ends, expected, atol=0.2)


def test_the_largest_region_counts_unless_the_image_cuts_it():
    both = disc(40, 60, 10) | disc(110, 60, 20)
    np.testing.assert_array_equal(silhouette(both, min_area=50), disc(110, 60, 20))
    assert silhouette(both, min_area=2000) is None
    for u, v in ((5, 60), (155, 60), (80, 5), (80, 115)):
        assert silhouette(disc(u, v, 20), min_area=50) is None
    assert silhouette(np.zeros((120, 160), bool), min_area=1) is None


def images(mask, depth):
    color = ImageRgba8U(160, 120)
    color.mutable_data[:] = 255
    color.mutable_data[mask] = (200, 25, 20, 255)
    z = ImageDepth32F(160, 120)
    z.mutable_data[:] = np.inf
    z.mutable_data[mask] = depth
    return {
        "color_image": AbstractValue.Make(color),
        "depth_image": AbstractValue.Make(z),
    }


def see(mask, depth=0.2):
    tracker = SilhouetteTracker(RED, CAMERA)
    context = tracker.CreateDefaultContext()
    fix(tracker, context, **images(mask, depth))
    return read(tracker, context, "sighting")


def test_points_are_those_of_a_pinhole_camera():
    seen = see(disc(79, 59, 20))  # the middle of the image; see DRAKE_PIXEL_CENTER
    focal = CAMERA.color.focal_x()
    expected = np.array([[20, 0], [-20, 0], [0, 20], [0, -20]]) / focal
    np.testing.assert_allclose(seen.points, expected, atol=0.2 / focal)
    np.testing.assert_allclose(seen.depths, 0.2, rtol=1e-6)


def test_equal_images_are_one_frame_and_others_are_not():
    assert see(disc(80, 60, 20)).frame == see(disc(80, 60, 20)).frame
    assert see(disc(80, 60, 20)).frame != see(disc(81, 60, 20)).frame


@pytest.mark.parametrize("depth", [0.0, np.inf])
def test_without_depth_there_are_no_points(depth):
    assert len(see(disc(80, 60, 20), depth).points) == 0
