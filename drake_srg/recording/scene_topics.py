"""ROS topics that show a plant's bodies: transforms, and markers of their surfaces.

Foxglove and RViz draw them. Each moving body has a transform. The markers, triangles in
the bodies' frames, are sent once. All messages are standard ROS 2 messages.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import SceneGraphInspector
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, RigidBody

from drake_srg.recording.replay.glb import Part
from drake_srg.recording.replay.scene import frame_parts, pose_row
from drake_srg.recording.rosbag import MakeMessage, Topic, header
from drake_srg.types import Vector

_WORLD = "world"
_TRANSFORMS, _MARKERS = "tf2_msgs/msg/TFMessage", "visualization_msgs/msg/MarkerArray"
# Points are rounded to a 16,384th of a metre, 0.06 mm, which compresses better.
_GRID = 2.0**14

Poses = Sequence[RigidTransform]


def scene_topics(
    plant: MultibodyPlant,
    inspector: SceneGraphInspector,
    port: str,
    model: int | AbstractValue,
    period: float,
    to_poses: Callable[[Any], Poses] = list,
) -> list[Topic]:
    """Return /tf and /scene of the rigid bodies of a plant.

    Args:
        plant: The plant, finalized. It need not outlive the call.
        inspector: Inspector of its scene graph.
        port: Name of the input port with the bodies' poses.
        model: The port's size or model value.
        period: Time between messages [s].
        to_poses: Returns the poses X_WB [m] of all bodies, in the plant's order, from
            the port's value.
    """
    context = plant.CreateDefaultContext()
    moving: list[tuple[int, str]] = []
    fixed: list[tuple[str, str, Vector, list[Part]]] = []
    for index in map(BodyIndex, range(plant.num_bodies())):
        frame_id, body = plant.GetBodyFrameIdIfExists(index), plant.get_body(index)
        # A body without geometry has no frame in the scene graph.
        parts = frame_parts(inspector, frame_id) if frame_id is not None else []
        if not parts:
            continue
        name = _frame(body)
        if plant.IsAnchored(body):
            pose = pose_row(plant.EvalBodyPoseInWorld(context, body))
            fixed.append((name, _WORLD, pose, parts))
        else:
            fixed.append((name, name, np.eye(7)[6], parts))
            moving.append((int(index), name))

    def transforms(make: MakeMessage, time: float, value: Any) -> Any:
        poses = to_poses(value)
        stamped = [_transform(make, time, name, poses[i]) for i, name in moving]
        return make(_TRANSFORMS, transforms=stamped)

    def markers(make: MakeMessage, time: float) -> Any:
        if time >= 1.5 * period:  # one message is enough, because nothing changes
            return None
        found = [
            _marker(make, time, name, number, frame, pose, part)
            for name, frame, pose, parts in fixed
            for number, part in enumerate(parts)
        ]
        return make(_MARKERS, markers=found)

    return [
        Topic("/tf", _TRANSFORMS, {port: model}, transforms),
        Topic("/scene", _MARKERS, {}, markers, period=period),
    ]


def _frame(body: RigidBody) -> str:
    """Return the name of a body's frame, with slashes in place of Drake's colons."""
    return str(body.scoped_name().get_full()).replace("::", "/")


def _transform(make: MakeMessage, time: float, name: str, X_WB: RigidTransform) -> Any:
    """Return the pose of a moving body as a geometry_msgs/msg/TransformStamped."""
    x, y, z, *xyzw = pose_row(X_WB).astype(np.float32).tolist()
    return make(
        "geometry_msgs/msg/TransformStamped",
        header=header(make, time, _WORLD),
        child_frame_id=name,
        transform=make(
            "geometry_msgs/msg/Transform",
            translation=make("geometry_msgs/msg/Vector3", x, y, z),
            rotation=make("geometry_msgs/msg/Quaternion", *xyzw),
        ),
    )


def _marker(
    make: MakeMessage,
    time: float,
    name: str,
    number: int,
    frame: str,
    pose: Vector,
    part: Part,
) -> Any:
    """Return a visualization_msgs/msg/Marker of triangles.

    `pose` is the body's pose in `frame`, from `pose_row`. The triangles of `part` are
    in the body's frame.
    """
    surface = part.surface
    corners = np.round(surface.points[surface.faces.ravel()] * _GRID) / _GRID
    x, y, z, *xyzw = pose.tolist()
    nothing = np.zeros(0, np.uint8)
    return make(
        "visualization_msgs/msg/Marker",
        header=header(make, time, frame),
        ns=name,
        id=number,
        type=11,  # TRIANGLE_LIST
        action=0,  # ADD
        pose=make(
            "geometry_msgs/msg/Pose",
            position=make("geometry_msgs/msg/Point", x, y, z),
            orientation=make("geometry_msgs/msg/Quaternion", *xyzw),
        ),
        scale=make("geometry_msgs/msg/Vector3", 1.0, 1.0, 1.0),
        color=make("std_msgs/msg/ColorRGBA", *part.color),
        lifetime=make("builtin_interfaces/msg/Duration", 0, 0),  # forever
        frame_locked=True,  # the marker follows its frame
        points=[make("geometry_msgs/msg/Point", *row) for row in corners.tolist()],
        colors=[],
        texture_resource="",
        texture=make(
            "sensor_msgs/msg/CompressedImage", header(make, time), "", nothing
        ),
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=make("visualization_msgs/msg/MeshFile", "", nothing),
        mesh_use_embedded_materials=False,
    )
