import numpy as np
import pytest
from pydrake.math import RigidTransform

from drake_srg.hardware.camera_feed import CameraFeed
from drake_srg.hardware.cameras import Camera
from drake_srg.hardware.pictures import Picture


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
