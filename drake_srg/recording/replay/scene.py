"""The scene of a replay: bodies, soft bodies, cameras and forces in motion."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.geometry import (
    FrameId,
    GeometryId,
    QueryObject,
    Rgba,
    SceneGraph,
    SceneGraphInspector,
    VolumeMesh,
)
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import ContactResults
from pydrake.systems.sensors import RgbdSensor

from drake_srg.common.contacts import each_contact
from drake_srg.objects.soft import nearest_pose
from drake_srg.recording.replay.glb import Json, Node, Part, Track
from drake_srg.recording.replay.triangles import (
    Indices,
    Triangles,
    arrow,
    joined,
    shape_triangles,
    surface_faces,
)
from drake_srg.types import Vector

# Length of an arrow per force [m/N].
METERS_PER_NEWTON = 0.006
_FORCE_COLOR = (0.05, 0.3, 0.95, 1.0)
# Precision of the shapes of soft bodies [m].
_PRECISION = 2e-6
# glTF's cameras look along -z with y up, Drake's along z with y down.
_X_CG = RigidTransform(RollPitchYaw(np.pi, 0, 0), [0, 0, 0])


def pose_row(X: RigidTransform) -> Vector:
    """Return a pose as [x, y, z, qx, qy, qz, qw], shape (7,)."""
    w, *xyz = X.rotation().ToQuaternion().wxyz()
    return np.array([*X.translation(), *xyz, w])


def pose_tracks(time: Vector, rows: Vector) -> dict[str, Track]:
    """Return the tracks of poses from `pose_row`, shape (K, 7)."""
    return {
        "translation": Track(time, rows[:, :3]),
        "rotation": Track(time, rows[:, 3:]),
    }


def camera_node(name: str, sensor: RgbdSensor, time: Vector, rows: Vector) -> Node:
    """Return a camera on a frame whose poses come from `pose_row`, shape (K, 7)."""
    core = sensor.default_color_render_camera().core()
    intrinsics, clipping = core.intrinsics(), core.clipping()
    X_PG = sensor.default_X_PB() @ core.sensor_pose_in_camera_body() @ _X_CG
    moved = np.array([pose_row(_pose(row) @ X_PG) for row in rows])
    camera: Json = {
        "yfov": intrinsics.fov_y(),
        "aspectRatio": intrinsics.width() / intrinsics.height(),
        "znear": clipping.near(),
        "zfar": clipping.far(),
    }
    tracks = pose_tracks(time, moved)
    return Node(name, tracks=tracks, camera=camera, extras={"camera": name})


def _pose(row: Vector) -> RigidTransform:
    x, y, z, w = row[3:] / np.linalg.norm(row[3:])
    return RigidTransform(Quaternion(w, x, y, z), row[:3])


def force_node(
    pair: tuple[str, str], samples: list[tuple[int, Vector]], time: Vector
) -> Node:
    """Return an arrow for the contact force on the second body of a pair.

    Args:
        pair: Names of the bodies.
        samples: For each sample with a contact, its index, and point [m] and force [N]
            in world, shape (6,).
        time: Times of all samples [s], shape (K,).
    """
    index = np.array([i for i, _ in samples])
    rows = np.array([row for _, row in samples])
    force = np.linalg.norm(rows[:, 3:], axis=1)
    scale = np.zeros((len(time), 3))
    scale[index] = np.stack([force > 0, force > 0, METERS_PER_NEWTON * force], axis=1)
    # Between and after contacts, the invisible arrow stays at its last place.
    latest = np.searchsorted(index, np.arange(len(time)), side="right") - 1
    held = rows[np.clip(latest, 0, None)]
    turns = np.array([_turn(direction) for direction in held[:, 3:]])
    tracks = {
        "translation": Track(time, held[:, :3]),
        "rotation": Track(time, turns),
        "scale": Track(time, scale),
    }
    # Without contact, nothing changes: drop those samples.
    rows_all = np.hstack([track.values for track in tracks.values()])
    changed = np.any(np.diff(rows_all, axis=0) != 0, axis=1)
    kept = np.append(True, changed) | np.append(changed, True)
    tracks = {k: Track(time[kept], t.values[kept]) for k, t in tracks.items()}
    extras = {"force": list(pair), "newtons_per_meter": 1.0 / METERS_PER_NEWTON}
    part = Part(arrow(), _FORCE_COLOR)
    return Node(f"force of {pair[0]} on {pair[1]}", [part], tracks, extras=extras)


def _turn(direction: Vector) -> Vector:
    """Return the quaternion x, y, z, w that turns z into a direction, shape (3,)."""
    size = np.linalg.norm(direction)
    x, y, z = direction / size if size > 0 else (0.0, 0.0, 1.0)
    if z < -1 + 1e-9:
        return np.array([1.0, 0.0, 0.0, 0.0])
    turn = np.array([-y, x, 0.0, 1.0 + z])
    return turn / np.linalg.norm(turn)


def soft_node(
    name: str, mesh: VolumeMesh, color: Rgba, time: Vector, p_WV: Vector
) -> Node:
    """Return a soft body's node: its nearest rigid pose, and morph targets.

    Args:
        name: Name of the node.
        mesh: The body's tetrahedra.
        color: Colour of the body.
        time: Sample times [s], shape (K,).
        p_WV: The mesh's vertices in world [m], shape (K, n, 3).
    """
    first = p_WV[0]
    poses = [nearest_pose(first.T, now.T) for now in p_WV]
    moved = np.array(
        [X.inverse() @ now.T for X, now in zip(poses, p_WV, strict=True)]
    ).transpose(0, 2, 1)
    # Approximate the deformations by few morph targets, from a singular value
    # decomposition.
    deformation = (moved - first).reshape(len(time), -1)
    u, s, vt = np.linalg.svd(deformation, full_matrices=False)
    count = 0
    while (
        count < len(s)
        and np.abs(deformation - (u * s)[:, :count] @ vt[:count]).max() > _PRECISION
    ):
        count += 1
    # Only the outer vertices are drawn.
    faces = surface_faces(mesh)
    outer, index = np.unique(faces, return_inverse=True)
    faces = index.reshape(-1, 3)
    targets = [row.reshape(-1, 3)[outer] for row in vt[:count]]
    surface = Triangles(first[outer], _vertex_normals(first[outer], faces), faces)
    rgba = (color.r(), color.g(), color.b(), color.a())
    tracks = pose_tracks(time, np.array([pose_row(X) for X in poses]))
    if count:
        tracks["weights"] = Track(time, (u * s)[:, :count])
    return Node(name, [Part(surface, rgba, targets)], tracks)


def _vertex_normals(points: Vector, faces: Indices) -> Vector:
    """Return the normals of vertices, averaged over their faces, shape (n, 3)."""
    corners = points[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(points)
    for k in range(3):
        np.add.at(normals, faces[:, k], across)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


_GRAY = Rgba(0.7, 0.7, 0.7, 1.0)


class SceneRecorder:
    """Samples poses of visible bodies, vertices of soft bodies, and contact forces.

    Args:
        graph: The scene.
        cameras: Cameras by name.
        objects: Names of model instances; arrows show contact forces on them.
    """

    def __init__(
        self,
        graph: SceneGraph,
        cameras: Mapping[str, RgbdSensor] | None = None,
        objects: Collection[str] = (),
    ) -> None:
        self._graph, self._cameras = graph, dict(cameras or {})
        self._objects = frozenset(objects)
        inspector = self._graph.model_inspector()
        self._parts = {
            frame: parts
            for frame in sorted(inspector.GetAllFrameIds(), key=_number)
            if (parts := frame_parts(inspector, frame))
        }
        # A camera may be on a frame without anything visible.
        frames = {s.default_parent_frame_id() for s in self._cameras.values()}
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

    def sample(
        self, time: float, query: QueryObject, contacts: ContactResults | None = None
    ) -> None:
        """Add a sample; an exception adds nothing.

        Args:
            time: Simulated time [s].
            query: Query object of the scene graph.
            contacts: The plant's contact results; None: no forces.
        """
        poses = [pose_row(query.GetPoseInWorld(frame)) for frame in self._frames]
        vertices = [
            query.GetConfigurationsInWorld(geometry).reshape(-1, 3).copy()
            for geometry in self._soft
        ]
        forces = {} if contacts is None else self._pair_forces(contacts)
        for pair, row in forces.items():
            self._forces.setdefault(pair, []).append((len(self._time), row))
        self._time.append(time)
        self._poses.append(poses)
        self._vertices.append(vertices)

    def nodes(self) -> list[Node]:
        """Return the scene with its motion so far; there must be a sample.

        A body's node has its scoped name, such as `gripper::palm`. A force's node has
        the names of both bodies, and a camera's node the name of the camera.
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
        for name, sensor in self._cameras.items():
            i = self._frames.index(sensor.default_parent_frame_id())
            nodes.append(camera_node(name, sensor, time, poses[:, i]))
        for pair, samples in sorted(self._forces.items()):
            nodes.append(force_node(pair, samples, time))
        return nodes

    def _pair_forces(self, contacts: ContactResults) -> dict[tuple[str, str], Vector]:
        """Return point and force in world, shape (6,), for each pair of bodies.

        The force is the resultant on the pair's second body. It acts at the mean of the
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


def _number(identifier: FrameId | GeometryId) -> int:
    """Return the number of an id; numbers increase in order of registration."""
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
    """Return the visible geometry of a frame, one part per colour."""
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
