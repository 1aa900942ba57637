"""Regions of an image that may show a target."""

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.systems.sensors import CameraInfo

from drake_srg.common.geometry import ConvexPieces
from drake_srg.types import Box
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.candidates import Picture, by_color, by_steps
from drake_srg.vision.color import ColorRange

FAR, NEAR = 1.0, 0.9  # table and top of the thing [m]
IMAGER = CameraModel(CameraInfo(80, 60, 100.0, 100.0, 40.0, 30.0)).imager("color")
# At 0.9 m, 100 mm are 11 pixels.
CUBE = Box([0.1, 0.1, 0.1])
RED = ColorRange.around([0.9, 0.1, 0.1])


def picture(rows, columns, hidden=None, level=None, below=None, noise=0.0):
    """Return a picture of a red rectangle above a grey table.

    Other pixels may be nearer than the rectangle, level with it, or lower.
    """
    color = np.full((60, 80, 3), 128, np.uint8)
    depth = np.full((60, 80), FAR, np.float32)
    for pixels, distance in ((hidden, 0.5), (level, NEAR), (below, 0.95)):
        if pixels is not None:
            color[pixels] = 10
            depth[pixels] = distance
    color[rows, columns] = [230, 25, 25]
    depth[rows, columns] = NEAR
    return Picture(color, depth, noise, IMAGER, IMAGER, RigidTransform())


def found(seen, search=by_color, shape=CUBE):
    """Return the pixels of each candidate for the cube, or another shape."""
    candidates = search(seen, shape, RED, 12)
    return [int(candidate.blob.sum()) for candidate in candidates]


@pytest.mark.parametrize("search", [by_color, by_steps])
@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_a_whole_region_must_be_large_enough(search, noise):
    def square(size):
        side = slice(20, 20 + size)
        return found(picture(side, side, noise=noise), search)

    assert square(6) == []
    assert len(square(11)) == 1


def test_a_region_that_may_continue_unseen_can_be_small():
    side = slice(20, 26)
    hidden = picture(side, side, hidden=np.s_[20:26, 26:32])
    level = picture(side, side, level=np.s_[20:26, 26:32])
    border = picture(side, slice(0, 6))
    assert found(hidden) == found(level) == found(border) == [36]


def test_a_small_region_may_be_the_cap_of_a_larger_thing():
    side = slice(20, 26)
    assert found(picture(side, side, below=np.s_[17:29, 17:29])) == [36]
    assert found(picture(side, side, below=np.s_[40:52, 17:29])) == []


def test_a_small_region_far_before_all_else_is_left_out():
    seen = picture(slice(20, 26), slice(20, 26), below=np.s_[:, 40:])
    seen.depth[20:26, 20:26] = 0.6
    assert found(seen) == []


def test_convex_pieces_may_look_small_in_the_box_around_them():
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) - 0.5
    seen = picture(slice(20, 26), slice(20, 26))
    assert found(seen, shape=ConvexPieces([0.1 * corners])) == [36]


def test_a_region_has_at_least_some_pixels():
    assert found(picture(slice(20, 23), slice(0, 3))) == []


def test_without_depth_a_region_is_not_judged():
    seen = picture(slice(20, 26), slice(20, 26))
    seen.depth[:] = np.inf
    assert found(seen) == [36]
