"""ROS topics that show a run in 3D: where bodies are, and what they look like.

Foxglove and RViz draw them: a transform per moving body, and, once, markers of
triangles in the bodies' frames. These are standard messages, so any ROS 2 reads them.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Iterator
from typing import Any

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, RigidBody
from pydrake.systems.framework import Diagram

from drake_srg.common.ports import output_ports
from drake_srg.recording.ros_topics import MakeMessage, Topic, header
from drake_srg.replay.glb import Part
from drake_srg.replay.nodes import pose_row
from drake_srg.replay.scene import frame_parts
from drake_srg.scenario import Scenario
from drake_srg.station.plant import AddDirectives, AddObjects
from drake_srg.types import Vector

_STATE = "plant_state_cheat"
_WORLD = "world"
_TRANSFORMS, _MARKERS = "tf2_msgs/msg/TFMessage", "visualization_msgs/msg/MarkerArray"
# Points are rounded to a 16,384th of a metre, 0.06 mm, which compresses better.
_GRID = 2.0**14


def scene_topics(cell: Diagram, scenario: Scenario) -> list[Topic]:
    """Return /tf and /scene of a cell or a station; none if it lacks the plant's state.

    They show the rigid bodies of the scenario. Soft objects are left out.

    Args:
        cell: The cell.
        scenario: Its scenario.
    """
    port = output_ports(cell).get(_STATE)
    if port is None:
        return []
    scene = _Scene(scenario)
    if port.size() != scene.plant.num_multibody_states():
        return []  # the cell has a plant of its own
    every = scenario.recording.period
    return [
        Topic("/tf", _TRANSFORMS, {_STATE: port.size()}, scene.transforms),
        Topic(
            "/scene",
            _MARKERS,
            {},
            # Only the first time: nothing of it changes.
            lambda make, t: scene.markers(make, t) if t < 1.5 * every else None,
            period=every,
        ),
    ]


class _Scene:
    """A plant apart from the simulation's, with what its bodies look like."""

    def __init__(self, scenario: Scenario) -> None:
        rigid = {n: config for n, config in scenario.objects.items() if not config.soft}
        scenario = dc.replace(scenario, objects=rigid)
        self._graph = SceneGraph()
        self.plant = MultibodyPlant(time_step=0.0)
        self.plant.RegisterAsSourceForSceneGraph(self._graph)
        AddDirectives(self.plant, scenario)
        AddObjects(self.plant, scenario)
        self.plant.Finalize()
        self._context = self.plant.CreateDefaultContext()
        # A body without geometry has no frame in the scene graph's eyes.
        self._seen = [(body, parts) for body, parts in self._bodies() if parts]
        self._moving = [body for body, _ in self._seen if not self._anchored(body)]

    def _bodies(self) -> Iterator[tuple[RigidBody, list[Part]]]:
        inspector = self._graph.model_inspector()
        for index in map(BodyIndex, range(self.plant.num_bodies())):
            frame = self.plant.GetBodyFrameIdIfExists(index)
            if frame is not None:
                yield self.plant.get_body(index), frame_parts(inspector, frame)

    def _anchored(self, body: RigidBody) -> bool:
        return bool(self.plant.IsAnchored(body))

    def _pose(self, body: RigidBody) -> Vector:
        return pose_row(self.plant.EvalBodyPoseInWorld(self._context, body))

    def transforms(self, make: MakeMessage, time: float, state: Vector) -> Any:
        """Return the poses of all moving bodies in world."""
        self.plant.SetPositionsAndVelocities(self._context, state)
        stamped = []
        for body in self._moving:
            x, y, z, *xyzw = self._pose(body).astype(np.float32).tolist()
            stamped.append(
                make(
                    "geometry_msgs/msg/TransformStamped",
                    header=header(make, time, _WORLD),
                    child_frame_id=_frame(body),
                    transform=make(
                        "geometry_msgs/msg/Transform",
                        translation=make("geometry_msgs/msg/Vector3", x, y, z),
                        rotation=make("geometry_msgs/msg/Quaternion", *xyzw),
                    ),
                )
            )
        return make(_TRANSFORMS, transforms=stamped)

    def markers(self, make: MakeMessage, time: float) -> Any:
        """Return the surfaces of all bodies, a marker per body and colour."""
        found = []
        for body, parts in self._seen:
            still = self._anchored(body)
            frame = _WORLD if still else _frame(body)
            pose = self._pose(body) if still else np.eye(7)[6]
            for number, part in enumerate(parts):
                found.append(_marker(make, time, body, number, frame, pose, part))
        return make(_MARKERS, markers=found)


def _frame(body: RigidBody) -> str:
    """Return the name of a body's frame: ROS has slashes where Drake has colons."""
    return str(body.scoped_name().get_full()).replace("::", "/")


def _marker(
    make: MakeMessage,
    time: float,
    body: RigidBody,
    number: int,
    frame: str,
    pose: Vector,
    part: Part,
) -> Any:
    """Return a visualization_msgs/msg/Marker of triangles.

    Args:
        make: Makes messages.
        time: Simulated time [s].
        body: The body.
        number: Of the marker, among the body's.
        frame: The marker's frame.
        pose: Of the body in that frame, as from `pose_row`.
        part: The triangles, in the body's frame.
    """
    surface = part.surface
    corners = np.round(surface.points[surface.faces.ravel()] * _GRID) / _GRID
    x, y, z, *xyzw = pose.tolist()
    nothing = np.zeros(0, np.uint8)
    return make(
        "visualization_msgs/msg/Marker",
        header=header(make, time, frame),
        ns=_frame(body),
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
        lifetime=make("builtin_interfaces/msg/Duration", 0, 0),  # for good
        frame_locked=True,  # it follows its frame
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
