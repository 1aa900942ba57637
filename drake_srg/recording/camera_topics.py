"""Topics of a camera besides its colour images: depth, intrinsics and pose."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.sensors import CameraInfo, ImageDepth32F

from drake_srg.recording.rosbag import (
    MakeMessage,
    Topic,
    header,
    image_message,
    pose_message,
)
from drake_srg.types import Vector
from drake_srg.vision.camera import DRAKE_PIXEL_CENTER, CameraModel

_FARTHEST = 65535  # largest depth in 16 bits [mm]


def millimetres(depth: Vector) -> Any:
    """Return depths as ROS's 16UC1: whole millimetres, 0 where there is no depth.

    Drake's 0 ("too close") and infinity ("too far") both become 0.

    Args:
        depth: Depths [m], any shape.
    """
    scaled = np.rint(np.nan_to_num(depth, posinf=0.0, neginf=0.0) * 1000.0)
    return np.where((scaled > 0.0) & (scaled <= _FARTHEST), scaled, 0).astype(np.uint16)


def depth_image(name: str, port: str, frame_id: str, period: float) -> Topic:
    """Return a topic of an ImageDepth32F port, as sensor_msgs/msg/Image in 16UC1 [mm].

    `period` is the time between messages [s].
    """

    def convert(make: MakeMessage, time: float, value: ImageDepth32F) -> Any:
        pixels = millimetres(value.data)
        return image_message(make, time, frame_id, "16UC1", pixels)

    model = AbstractValue.Make(ImageDepth32F())
    return Topic(name, "sensor_msgs/msg/Image", {port: model}, convert, period)


def camera_info_message(
    make: MakeMessage, time: float, frame_id: str, intrinsics: CameraInfo
) -> Any:
    """Return intrinsics as a sensor_msgs/msg/CameraInfo."""
    # ROS's origin is the centre of the first pixel; Drake's is where its renderers
    # sample this pixel.
    cx = intrinsics.center_x() - DRAKE_PIXEL_CENTER
    cy = intrinsics.center_y() - DRAKE_PIXEL_CENTER
    fx, fy = intrinsics.focal_x(), intrinsics.focal_y()
    region = make(
        "sensor_msgs/msg/RegionOfInterest",
        x_offset=0,
        y_offset=0,
        height=0,
        width=0,
        do_rectify=False,
    )
    return make(
        "sensor_msgs/msg/CameraInfo",
        header(make, time, frame_id),
        intrinsics.height(),
        intrinsics.width(),
        "plumb_bob",
        np.zeros(5),
        np.array([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]),
        np.eye(3).reshape(-1),
        np.array([fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]),
        0,
        0,
        region,
    )


def calibration_topics(
    camera: str, model: CameraModel, period: float, *, depth: bool = False
) -> list[Topic]:
    """Return the topics with a camera's pose and intrinsics.

    They are those of `model`, so they include errors of its calibration.

    Args:
        camera: The camera's name.
        model: Its model.
        period: Time between messages [s].
        depth: Whether to record depth images, too.
    """
    root = f"/camera_{camera}"

    def info(make: MakeMessage, time: float) -> Any:
        return camera_info_message(make, time, root[1:], model.color)

    def pose(make: MakeMessage, time: float, X_WB: RigidTransform) -> Any:
        return pose_message(make, time, X_WB @ model.X_BC)

    body = {f"camera_{camera}.body_pose_in_world": AbstractValue.Make(RigidTransform())}
    kinds = "sensor_msgs/msg/CameraInfo", "geometry_msgs/msg/PoseStamped"
    topics = [
        Topic(f"{root}/color/camera_info", kinds[0], {}, info, period),
        Topic(f"{root}/pose", kinds[1], body, pose, period),
    ]
    if depth:
        port = f"camera_{camera}.depth_image"
        name = f"{root}/depth/image_rect_raw"
        topics.append(depth_image(name, port, root[1:], period))
    return topics
