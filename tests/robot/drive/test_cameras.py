from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.math import RigidTransform

from drake_srg.robot.drive.cameras import (
    Album,
    Camera,
    CameraFeed,
    Picture,
    color_pixels,
    depth_pixels,
)
from drake_srg.robot.serve.commands import CommandError

SHAPE = (2, 3)


def image(encoding, pixels, stamp=0, padding=0):
    """Return a sensor_msgs/Image."""
    pixels = np.ascontiguousarray(pixels)
    rows = pixels.reshape(len(pixels), -1).view(np.uint8)
    rows = np.pad(rows, ((0, 0), (0, padding)))
    time = SimpleNamespace(sec=stamp, nanosec=0)
    return SimpleNamespace(
        header=SimpleNamespace(stamp=time),
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=encoding,
        is_bigendian=0,
        step=rows.shape[1],
        data=rows.reshape(-1),
    )


COLOR = np.arange(18, dtype=np.uint8).reshape(2, 3, 3)
DEPTH = np.ones(SHAPE, dtype=np.float32)


@pytest.mark.parametrize("padding", [0, 2])
@pytest.mark.parametrize(
    ("encoding", "pixels"),
    [
        ("rgb8", COLOR),
        ("bgr8", COLOR[..., ::-1]),
        ("rgba8", np.dstack([COLOR, np.full(SHAPE, 255, np.uint8)])),
        ("bgra8", np.dstack([COLOR[..., ::-1], np.full(SHAPE, 255, np.uint8)])),
    ],
)
def test_colours_of_all_encodings_are_the_same(encoding, pixels, padding):
    found = color_pixels(image(encoding, pixels, padding=padding), SHAPE)
    np.testing.assert_array_equal(found[..., :3], COLOR)
    assert np.all(found[..., 3] == 255)


def test_depths_are_as_drake_has_them():
    metres = np.array([[1.0, -np.inf, np.inf], [np.nan, 0.5, 2.0]], dtype=np.float32)
    expected = [[1.0, 0.0, np.inf], [np.inf, 0.5, 2.0]]
    found = depth_pixels(image("32FC1", metres[..., np.newaxis]), SHAPE)
    np.testing.assert_array_equal(found, expected)
    millimetres = np.array([[1000, 0, 0], [0, 500, 2000]], dtype="<u2")
    found = depth_pixels(image("16UC1", millimetres[..., np.newaxis]), SHAPE)
    np.testing.assert_allclose(
        found, [[1.0, np.inf, np.inf], [np.inf, 0.5, 2.0]], rtol=1e-6
    )


@pytest.mark.parametrize(
    ("change", "kind"),
    [
        ({"encoding": "mono8"}, "encoding"),
        ({"width": 4}, "size"),
        ({"data": np.zeros(3, np.uint8)}, "length"),
        ({"step": 1}, "length"),
    ],
)
def test_other_images_are_refused(change, kind):
    message = image("rgb8", COLOR)
    vars(message).update(change)
    with pytest.raises(CommandError) as error:
        color_pixels(message, SHAPE)
    assert error.value.kind == kind


def test_only_pairs_count_and_only_newer_ones():
    album = Album(SHAPE)
    album.add_color(image("rgb8", COLOR, stamp=1))
    assert album.wait(-np.inf, 0.0) is None
    album.add_depth(image("32FC1", DEPTH[..., np.newaxis], stamp=1))
    assert album.wait(0.0, 0.0).stamp == 1.0
    assert album.wait(1.0, 0.0) is None
    # An older pair that arrives late does not replace it.
    album.add_color(image("rgb8", COLOR, stamp=0))
    album.add_depth(image("32FC1", DEPTH[..., np.newaxis], stamp=0))
    assert album.wait(-np.inf, 0.0).stamp == 1.0


class Counter(Camera):
    """A camera whose pictures show how many were taken, and when."""

    def __init__(self):
        self.asked = []

    def picture(self, after, patience=None):
        self.asked.append(after)
        color = np.full((2, 3, 4), len(self.asked), np.uint8)
        return Picture(after, color, np.full((2, 3), after, np.float32))

    def newest(self):
        return None


@pytest.fixture
def camera():
    return Counter()


@pytest.fixture
def feed(camera):
    return CameraFeed(camera, RigidTransform([1.0, 2.0, 3.0]))


def pictures(feed, context):
    """Return the number of the colour image, and the depth of the depth image."""
    color = feed.GetOutputPort("color_image").Eval(context).data
    depth = feed.GetOutputPort("depth_image").Eval(context).data
    return int(color[0, 0, 0]), float(depth[0, 0, 0])


def test_both_images_are_of_one_picture_newer_than_the_stamp(feed, camera):
    context = feed.CreateDefaultContext()
    feed.GetInputPort("stamp").FixValue(context, [7.0])
    assert pictures(feed, context) == pictures(feed, context) == (1, 7.0)
    assert camera.asked == [7.0]
    pose = feed.GetOutputPort("body_pose_in_world").Eval(context)
    assert pose.translation().tolist() == [1.0, 2.0, 3.0]
    assert camera.asked == [7.0]


def test_a_newer_stamp_asks_for_a_newer_picture(feed, camera):
    context = feed.CreateDefaultContext()
    feed.GetInputPort("stamp").FixValue(context, [7.0])
    pictures(feed, context)
    feed.GetInputPort("stamp").FixValue(context, [8.0])  # at the same time
    assert pictures(feed, context) == (2, 8.0)
    context.SetTime(1.0)
    assert pictures(feed, context) == (3, 8.0)
