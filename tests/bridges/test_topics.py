import json

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.sensors import CameraInfo
from rosbags.typesys import Stores, get_typestore

from drake_srg.bridges.topics import (
    BLOBS,
    CAMERA_INFO,
    COLOR,
    DEPTH,
    OBJECT_POSE,
    camera_topics,
)
from drake_srg.types import Blob, BlobFlag

INFO = CameraInfo(640, 480, 579.4, 580.6, 319.5, 239.5)
TOPICS = camera_topics("ceiling", INFO, "can")


@pytest.fixture(params=[Stores.ROS1_NOETIC, Stores.ROS2_HUMBLE])
def send(request):
    """Convert values to a message, through the wire format of ROS 1 or ROS 2."""
    store = get_typestore(request.param)
    ros1 = request.param == Stores.ROS1_NOETIC

    def make(kind, *values, **fields):
        if ros1 and kind == "std_msgs/msg/Header":
            fields["seq"] = 0
        return store.types[kind](*values, **fields)

    def send(name, *values):
        topic = TOPICS[name]
        message = topic.convert(make, 1.25, *values)
        if ros1:
            content = store.serialize_ros1(message, topic.type)
            return store.deserialize_ros1(content, topic.type)
        content = store.serialize_cdr(message, topic.type)
        return store.deserialize_cdr(content, topic.type)

    return send


def test_a_colour_image_arrives_unchanged(send):
    pixels = np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    message = send(COLOR, pixels)
    assert (message.height, message.width, message.step) == (48, 64, 192)
    assert message.encoding == "rgb8"
    assert message.header.frame_id == "camera_ceiling"
    stamp = message.header.stamp
    assert (stamp.sec, stamp.nanosec) == (1, 250_000_000)
    np.testing.assert_array_equal(message.data.reshape(48, 64, 3), pixels)


def test_a_depth_image_is_in_metres_with_the_infinities_of_rep_118(send):
    pixels = np.array([[0.0, 1.5], [np.inf, 2.25]], dtype=np.float32)
    message = send(DEPTH, pixels)
    assert (message.encoding, message.step) == ("32FC1", 8)
    seen = message.data.view(np.float32).reshape(2, 2)
    np.testing.assert_array_equal(seen, [[-np.inf, 1.5], [np.inf, 2.25]])


def test_camera_info_counts_pixels_from_the_centre_of_the_first(send):
    message = send(CAMERA_INFO)
    K = message.K if hasattr(message, "K") else message.k  # ROS 1, ROS 2
    np.testing.assert_allclose(
        K.reshape(3, 3), [[579.4, 0, 319.0], [0, 580.6, 239.0], [0, 0, 1]]
    )
    assert (message.width, message.height) == (640, 480)


def test_blobs_are_json_with_every_field(send):
    blob = Blob(
        "can",
        "ceiling",
        (320.5, 240.25),
        RigidTransform(RotationMatrix.MakeZRotation(np.pi / 2), [0.5, 0.1, 0.05]),
        0.9,
        frozenset({BlobFlag.OCCLUDED}),
    )
    half = np.sqrt(0.5)
    text = json.loads(send(BLOBS, [blob]).data)
    assert text == {
        "stamp": 1.25,
        "frame_id": "world",
        "blobs": [
            {
                "object_name": "can",
                "camera": "ceiling",
                "pixel": [320.5, 240.25],
                "position": [0.5, 0.1, 0.05],
                "axis": [0.0, 0.0, 1.0],
                "orientation": pytest.approx({"x": 0, "y": 0, "z": half, "w": half}),
                "quality": 0.9,
                "flags": ["occluded"],
            }
        ],
    }


def seen(name, x, *flags, misfit=0.0):
    X_WO = RigidTransform(RotationMatrix.MakeZRotation(np.pi / 2), [x, 0.1, 0.05])
    return Blob(name, "ceiling", (0.0, 0.0), X_WO, 0.9, frozenset(flags), misfit)


def test_the_object_pose_is_that_of_the_most_trustworthy_certain_blob(send):
    uncertain = seen("can", 0.1, BlobFlag.UNCERTAIN)
    blobs = [
        uncertain,
        seen("box", 0.2),
        seen("can", 0.3, misfit=0.2),
        seen("can", 0.4),
    ]
    message = send(OBJECT_POSE, blobs)
    assert message.header.frame_id == "world"
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 250_000_000)
    p, q = message.pose.position, message.pose.orientation
    assert (p.x, p.y, p.z) == (0.4, 0.1, 0.05)
    assert (q.x, q.y, q.z, q.w) == pytest.approx((0, 0, np.sqrt(0.5), np.sqrt(0.5)))


def test_there_is_no_message_of_an_object_that_is_not_certain_to_be_seen():
    uncertain = seen("can", 0.1, BlobFlag.UNCERTAIN)
    for blobs in ([], [seen("box", 0.2)], [uncertain]):
        assert TOPICS[OBJECT_POSE].convert(None, 1.25, blobs) is None
