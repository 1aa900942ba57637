"""The camera and localizer topics that a served station publishes."""

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
    pose_message,
)
from drake_srg.types import Blob
from drake_srg.vision.camera import DRAKE_PIXEL_CENTER

COLOR, DEPTH = "/camera/color/image_raw", "/camera/depth/image_raw"
CAMERA_INFO, BLOBS = "/camera/color/camera_info", "/blobs"
OBJECT_POSE = "/object_pose"
_ROOT = "/camera"


def image_topics(
    camera: str, intrinsics: CameraInfo, root: str = _ROOT
) -> dict[str, Topic]:
    """Return the topics of a camera by COLOR, DEPTH and CAMERA_INFO.

    After the time, their `convert` takes:

    - COLOR: pixels, shape (h, w, 3), uint8
    - DEPTH: Drake's depths [m], shape (h, w), float32
    - CAMERA_INFO: nothing

    Args:
        camera: The camera's name in the scenario.
        intrinsics: Intrinsics of both images.
        root: What their names begin with in place of "/camera".
    """
    frame_id = f"camera_{camera}"

    def color(make: MakeMessage, time: float, pixels: Any) -> Any:
        return image_message(make, time, frame_id, "rgb8", pixels)

    def depth(make: MakeMessage, time: float, pixels: Any) -> Any:
        # Drake writes 0 for "too close", REP 118 -inf; both write inf for "too far".
        pixels = np.where(pixels == 0.0, np.float32(-np.inf), pixels)
        return image_message(make, time, frame_id, "32FC1", pixels)

    def info(make: MakeMessage, time: float) -> Any:
        return _camera_info(make, time, frame_id, intrinsics)

    image = "sensor_msgs/msg/Image"
    return {
        name: Topic(root + name.removeprefix(_ROOT), kind, {}, convert, sensor=True)
        for name, kind, convert in (
            (COLOR, image, color),
            (DEPTH, image, depth),
            (CAMERA_INFO, "sensor_msgs/msg/CameraInfo", info),
        )
    }


def camera_topics(
    camera: str, intrinsics: CameraInfo, pick: str = ""
) -> dict[str, Topic]:
    """Return the topics of a camera and of the localizer, by name.

    Those of the camera are `image_topics`. After the time, `convert` of BLOBS and
    OBJECT_POSE takes a list of `Blob`.

    Args:
        camera: The camera's name in the scenario.
        intrinsics: Intrinsics of both images.
        pick: Name of the object that OBJECT_POSE tells of.
    """

    def pose(make: MakeMessage, time: float, blobs: Sequence[Blob]) -> Any:
        certain = [b for b in blobs if b.object_name == pick and b.certain]
        best = max(certain, key=lambda blob: blob.trust, default=None)
        return best and pose_message(make, time, best.X_WO)

    return {
        **image_topics(camera, intrinsics),
        BLOBS: Topic(BLOBS, "std_msgs/msg/String", {}, _blobs),
        OBJECT_POSE: Topic(OBJECT_POSE, "geometry_msgs/msg/PoseStamped", {}, pose),
    }


def _camera_info(
    make: MakeMessage, time: float, frame_id: str, intrinsics: CameraInfo
) -> Any:
    # ROS counts pixels from the centre of the first one, Drake's renderers from the
    # point where they sample it.
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


def _orientation(blob: Blob) -> dict[str, float]:
    quaternion = blob.X_WO.rotation().ToQuaternion()
    return {name: float(getattr(quaternion, name)()) for name in "xyzw"}


def _blobs(make: MakeMessage, time: float, blobs: Sequence[Blob]) -> Any:
    """Return blobs as JSON: no standard message has an object's name and flags."""
    rows = [
        {
            "object_name": blob.object_name,
            "camera": blob.camera,
            "pixel": list(blob.pixel),
            "position": blob.position.tolist(),
            "axis": blob.axis.tolist(),
            "orientation": _orientation(blob),
            "quality": blob.quality,
            "flags": sorted(flag.value for flag in blob.flags),
        }
        for blob in blobs
    ]
    text = json.dumps({"stamp": time, "frame_id": "world", "blobs": rows})
    return make("std_msgs/msg/String", data=text)
