"""Recordings of a camera apart from its colour images."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.sensors import CameraInfo, ImageDepth32F
from rosbags.typesys import Stores, get_typestore

from drake_srg.recording.camera_topics import calibration_topics, millimetres
from drake_srg.vision.camera import CameraModel

X_BC = RigidTransform(RollPitchYaw(0.1, 0.0, 0.0), [0.02, 0.0, 0.0])
MODEL = CameraModel(CameraInfo(64, 48, 50.0, 51.0, 32.5, 24.5), X_BC=X_BC)


def make(kind, *values, **fields):
    return get_typestore(Stores.ROS2_HUMBLE).types[kind](*values, **fields)


@given(st.floats(0.001, 65.535))
def test_depths_are_whole_millimetres(depth):
    (found,) = millimetres(np.array([depth], dtype=np.float32))
    assert abs(found - 1000.0 * depth) < 0.51  # a float32 may round across a half


@pytest.mark.parametrize("depth", [0.0, np.inf, -np.inf, np.nan, -0.3, 65.6, 1e30])
def test_what_is_no_depth_is_zero(depth):
    assert millimetres(np.array([depth], dtype=np.float32)).tolist() == [0]


def test_a_camera_has_three_topics_with_depth():
    info, pose, depth = calibration_topics("top", MODEL, 0.25, depth=True)
    assert [info.name, pose.name, depth.name] == [
        "/camera_top/color/camera_info",
        "/camera_top/pose",
        "/camera_top/depth/image_rect_raw",
    ]
    assert len(calibration_topics("top", MODEL, 0.25)) == 2

    # ROS counts pixels from the centre of the first one.
    np.testing.assert_allclose(
        info.convert(make, 1.0).k, [50, 0, 32, 0, 51, 24, 0, 0, 1]
    )

    X_WB = RigidTransform(RollPitchYaw(0.0, 0.0, 0.3), [1.0, 2.0, 3.0])
    found = pose.convert(make, 1.0, X_WB)
    p = found.pose.position
    expected = X_WB @ [0.02, 0.0, 0.0]
    np.testing.assert_allclose([p.x, p.y, p.z], expected)
    assert found.header.frame_id == "world"

    image = ImageDepth32F(3, 2)
    image.mutable_data[..., 0] = [[0.0, 1.2344, np.inf], [0.5, 0.25, 4.0]]
    message = depth.convert(make, 1.0, image)
    assert (message.encoding, message.step, message.is_bigendian) == ("16UC1", 6, 0)
    assert message.header.frame_id == "camera_top"
    seen = message.data.view("<u2").reshape(2, 3)
    assert seen.tolist() == [[0, 1234, 0], [500, 250, 4000]]
