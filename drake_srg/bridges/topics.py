"""What a served station tells: the topics of its cameras."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from pydrake.systems.sensors import CameraInfo

from drake_srg.recording.ros_topics import (
    MakeMessage,
    Topic,
    header,
    image_message,
)
from drake_srg.types import Blob
from drake_srg.vision.camera import DRAKE_PIXEL_CENTER

COLOR, DEPTH = "/camera/color/image_raw", "/camera/depth/image_raw"
CAMERA_INFO, BLOBS = "/camera/color/camera_info", "/blobs"


def camera_topics(camera: str, intrinsics: CameraInfo) -> dict[str, Topic]:
    """The topics of a camera and of the localizer, by name.

    Their `convert` takes, after the time: the colour image's pixels (h, w, 3, uint8),
    the depth image's (h, w, float32, Drake's [m]), nothing, the list of blobs.

    Args:
        camera: Its name in the scenario.
        intrinsics: Of both of its images.
    """
    frame_id = f"camera_{camera}"

    def color(make: MakeMessage, time: float, pixels: Any) -> Any:
        return image_message(make, time, frame_id, "rgb8", pixels)

    def depth(make: MakeMessage, time: float, pixels: Any) -> Any:
        # Drake's 0 is too close; REP 118 writes that as -inf, and too far as Drake.
        pixels = np.where(pixels == 0.0, np.float32(-np.inf), pixels)
        return image_message(make, time, frame_id, "32FC1", pixels)

    def info(make: MakeMessage, time: float) -> Any:
        return _camera_info(make, time, frame_id, intrinsics)

    image = "sensor_msgs/msg/Image"
    return {
        topic.name: topic
        for topic in (
            Topic(COLOR, image, {}, color, sensor=True),
            Topic(DEPTH, image, {}, depth, sensor=True),
            Topic(CAMERA_INFO, "sensor_msgs/msg/CameraInfo", {}, info, sensor=True),
            Topic(BLOBS, "std_msgs/msg/String", {}, _blobs),
        )
    }


def _camera_info(
    make: MakeMessage, time: float, frame_id: str, intrinsics: CameraInfo
) -> Any:
    # ROS counts pixels from the middle of the first one, Drake's renderers from where
    # they sample it.
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


def _blobs(make: MakeMessage, time: float, blobs: Sequence[Blob]) -> Any:
    """Blobs as JSON: no standard message has names, flags and positions of objects."""
    rows = [
        {
            "object_name": blob.object_name,
            "camera": blob.camera,
            "pixel": list(blob.pixel),
            "position": blob.position.tolist(),
            "axis": blob.axis.tolist(),
            "quality": blob.quality,
            "flags": sorted(flag.value for flag in blob.flags),
        }
        for blob in blobs
    ]
    text = json.dumps({"stamp": time, "frame_id": "world", "blobs": rows})
    return make("std_msgs/msg/String", data=text)
