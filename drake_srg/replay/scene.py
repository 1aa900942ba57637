"""Records what a diagram's SceneGraph shows during a run."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np
from pydrake.geometry import (
    FrameId,
    GeometryId,
    Rgba,
    SceneGraph,
    SceneGraphInspector,
)
from pydrake.multibody.plant import ContactResults
from pydrake.systems.framework import Context, Diagram, System
from pydrake.systems.sensors import RgbdSensor

from drake_srg.common.contacts import each_contact
from drake_srg.lifetime import my_context
from drake_srg.replay.glb import Node, Part
from drake_srg.replay.nodes import (
    camera_node,
    force_node,
    pose_row,
    pose_tracks,
    soft_node,
)
from drake_srg.replay.triangles import Triangles, joined, shape_triangles
from drake_srg.types import Vector

_GRAY = Rgba(0.7, 0.7, 0.7, 1.0)


class SceneRecorder:
    """Samples the poses of everything visible, soft bodies' vertices, and contacts.

    Args:
        root: The root diagram, with one SceneGraph in it, at any depth.
        objects: Names of the model instances whose contact forces point at them.

    Raises:
        ValueError: If the diagram has no SceneGraph.
    """

    def __init__(self, root: Diagram, objects: Collection[str] = ()) -> None:
        systems = list(_systems(root))
        graphs = [system for system in systems if isinstance(system, SceneGraph)]
        if not graphs:
            raise ValueError("SceneRecorder needs a diagram with a SceneGraph")
        self._graph = graphs[0]
        self._sensors = [s for s in systems if isinstance(s, RgbdSensor)]
        self._objects = frozenset(objects)
        inspector = self._graph.model_inspector()
        self._parts = {
            frame: parts
            for frame in sorted(inspector.GetAllFrameIds(), key=_number)
            if (parts := frame_parts(inspector, frame))
        }
        # A camera may be on a frame without anything visible.
        frames = {sensor.default_parent_frame_id() for sensor in self._sensors}
        self._frames = [*self._parts, *sorted(frames - self._parts.keys(), key=_number)]
        self._soft = [
            geometry
            for geometry in sorted(inspector.GetAllDeformableGeometryIds(), key=_number)
            if inspector.GetReferenceMesh(geometry) is not None
        ]
        self._bodies = {
            geometry.get_value(): _body_name(inspector, geometry)
            for geometry in inspector.GetAllGeometryIds()
        }
        self._time: list[float] = []
        self._poses: list[list[Vector]] = []
        self._vertices: list[list[Vector]] = []
        self._forces: dict[tuple[str, str], list[tuple[int, Vector]]] = {}

    def __len__(self) -> int:
        return len(self._time)

    def sample(self, root: Context, contacts: ContactResults | None = None) -> None:
        """Add a sample. An exception on the way adds nothing.

        Args:
            root: The root diagram's context.
            contacts: The plant's contact results; None: no forces.
        """
        query = self._graph.get_query_output_port().Eval(my_context(self._graph, root))
        poses = [pose_row(query.GetPoseInWorld(frame)) for frame in self._frames]
        vertices = [
            query.GetConfigurationsInWorld(geometry).reshape(-1, 3).copy()
            for geometry in self._soft
        ]
        forces = {} if contacts is None else self._pair_forces(contacts)
        for pair, row in forces.items():
            self._forces.setdefault(pair, []).append((len(self._time), row))
        self._time.append(root.get_time())
        self._poses.append(poses)
        self._vertices.append(vertices)

    def nodes(self) -> list[Node]:
        """Return the scene with its motion so far; needs a sample.

        A body's node has its scoped name, as `gripper::palm`, a force's the names of
        both bodies, and a camera's its own.
        """
        inspector = self._graph.model_inspector()
        time = np.array(self._time)
        poses = np.array(self._poses)
        nodes = []
        for i, frame in enumerate(self._frames):
            if frame in self._parts:
                name = inspector.GetName(frame)
                tracks = pose_tracks(time, poses[:, i])
                nodes.append(Node(name, self._parts[frame], tracks))
        for k, geometry in enumerate(self._soft):
            vertices = np.array([row[k] for row in self._vertices])
            nodes.append(
                soft_node(
                    inspector.GetName(geometry),
                    inspector.GetReferenceMesh(geometry),
                    _color(inspector, geometry) or _GRAY,
                    time,
                    vertices,
                )
            )
        for sensor in self._sensors:
            i = self._frames.index(sensor.default_parent_frame_id())
            nodes.append(camera_node(sensor, time, poses[:, i]))
        for pair, samples in sorted(self._forces.items()):
            nodes.append(force_node(pair, samples, time))
        return nodes

    def _pair_forces(self, contacts: ContactResults) -> dict[tuple[str, str], Vector]:
        """Return point and force in world, shape (6,), for each pair of bodies.

        The force is the resultant on the pair's second body; it acts at the mean of the
        contacts, weighted by their forces.
        """
        found: dict[tuple[str, str], list[tuple[Vector, Vector]]] = {}
        for contact in each_contact(contacts):
            a, b = self._bodies[contact.id_A], self._bodies[contact.id_B]
            force = contact.F_Ac_W().translational()
            ours = [name.split("::")[0] in self._objects for name in (a, b)]
            if ours[0] > ours[1] or (ours[0] == ours[1] and a > b):
                pair = (b, a)
            else:
                pair, force = (a, b), -force
            found.setdefault(pair, []).append((contact.p_WC(), force))
        rows = {}
        for pair, each in found.items():
            points, forces = (np.array(values) for values in zip(*each, strict=True))
            weights = np.linalg.norm(forces, axis=1) + 1e-12
            point = weights @ points / weights.sum()
            rows[pair] = np.concatenate([point, forces.sum(axis=0)])
        return rows


def _systems(diagram: Diagram) -> Iterator[System]:
    """Yield the systems of a diagram at any depth; a sensor's own are not looked at."""
    for system in diagram.GetSystems():
        yield system
        if isinstance(system, Diagram) and not isinstance(system, RgbdSensor):
            yield from _systems(system)


def _number(identifier: FrameId | GeometryId) -> int:
    """Return an id's number, which grows in the order of registration."""
    return int(identifier.get_value())


def _body_name(inspector: SceneGraphInspector, geometry: GeometryId) -> str:
    if inspector.IsDeformableGeometry(geometry):
        return str(inspector.GetName(geometry))
    return str(inspector.GetName(inspector.GetFrameId(geometry)))


def _color(inspector: SceneGraphInspector, geometry: GeometryId) -> Rgba | None:
    """Return the diffuse colour of a geometry, or None if it is invisible."""
    for properties in (
        inspector.GetIllustrationProperties(geometry),
        inspector.GetPerceptionProperties(geometry),
    ):
        if properties is not None:
            color = properties.GetPropertyOrDefault("phong", "diffuse", _GRAY)
            return color if color.a() > 0.0 else None
    return None


def frame_parts(inspector: SceneGraphInspector, frame: FrameId) -> list[Part]:
    """Return what a frame carries, one part per colour."""
    surfaces: dict[tuple[float, float, float, float], list[Triangles]] = {}
    for geometry in sorted(inspector.GetGeometries(frame), key=_number):
        if inspector.IsDeformableGeometry(geometry):
            continue
        color = _color(inspector, geometry)
        if color is None:
            continue
        surface = shape_triangles(inspector.GetShape(geometry))
        if surface is not None:
            key = (color.r(), color.g(), color.b(), color.a())
            moved = surface.transformed(inspector.GetPoseInFrame(geometry))
            surfaces.setdefault(key, []).append(moved)
    return [Part(joined(group), color) for color, group in surfaces.items()]
