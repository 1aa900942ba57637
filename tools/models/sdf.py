"""SDFormat text with Drake's extensions, and the mesh files it refers to."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence

import numpy as np

from drake_srg.common.contacts import relaxation_time
from drake_srg.objects.sdf import AddChild, AddPose
from drake_srg.objects.soft import box_mesh, vtk_text

from .pieces import Inertial, Piece, Primitive, Proximity, Surface, Turned, VolumeMesh
from .shapes import Solid, format_number, obj_text

Color = tuple[float, float, float]
Files = dict[str, str | bytes]  # path below models/ -> contents


class Model:
    """An SDF model under construction."""

    def __init__(
        self,
        name: str,
        looks: Mapping[str, Color],
        comment: str = "",
        meshes: str | None = None,
    ):
        """Start a model; its mesh files are named after `meshes`, or after itself."""
        self._meshes = meshes or name
        self._looks = looks
        self._sdf = ET.Element(
            "sdf", {"version": "1.9", "xmlns:drake": "http://drake.mit.edu"}
        )
        self._comment = comment
        self.root = AddChild(self._sdf, "model", name=name)
        self.files: Files = {}

    def AddLink(
        self,
        name: str,
        pieces: Sequence[Piece],
        inertial: Inertial | None,
        pose: tuple[str, Sequence[float], Sequence[float]] | None = None,
        prefix: str = "",
    ) -> None:
        """Add a link made of pieces; `pose` is (relative_to, xyz, rpy).

        The prefix goes before the names of the link and its geometries, but not before
        those of its meshes, so links that differ only in their prefix share meshes.
        """
        link = AddChild(self.root, "link", name=prefix + name)
        if pose is not None:
            AddChild(link, "pose", [*pose[1], *pose[2]], relative_to=pose[0])
        if inertial is not None:
            node = AddChild(link, "inertial")
            AddPose(node, np.round(inertial.com, 6) + 0.0)
            AddChild(node, "mass", inertial.mass)
            matrix = AddChild(node, "inertia")
            for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
                value = f"{inertial.inertia[i, j]:.{inertial.digits}g}"
                floor = 1e-5 * np.max(inertial.inertia)
                if abs(inertial.inertia[i, j]) < floor:
                    value = "0"
                AddChild(matrix, "i" + "xyz"[i] + "xyz"[j], value)
        for look in dict.fromkeys(p.look for p in pieces if p.look):
            seen = [p.solid for p in pieces if p.look == look]
            self._AddVisual(link, f"{name}_{look}", prefix, look, seen)
        for piece in pieces:
            if piece.collision is not None:
                self._AddCollision(link, piece, prefix)

    def _AddVisual(
        self, link: ET.Element, name: str, prefix: str, look: str, seen: list[Solid]
    ) -> None:
        visual = AddChild(link, "visual", name=prefix + name)
        path = f"meshes/{self._meshes}_{name}.obj"
        if path not in self.files:
            self.files[path] = obj_text(seen)
        mesh = AddChild(AddChild(visual, "geometry"), "mesh")
        AddChild(mesh, "uri", f"package://drake_srg/{path}")
        material = AddChild(visual, "material")
        AddChild(material, "diffuse", [*self._looks[look], 1])

    def _AddCollision(self, link: ET.Element, piece: Piece, prefix: str) -> None:
        collision = AddChild(link, "collision", name=prefix + piece.name)
        shape = piece.collision
        resolution = None
        if isinstance(shape, Primitive):
            AddPose(collision, shape.xyz, shape.rpy)
            AddPrimitive(AddChild(collision, "geometry"), shape)
            if shape.kind != "box":  # Drake cuts only round primitives into facets
                resolution = piece.proximity.resolution
        elif isinstance(shape, VolumeMesh):
            AddPose(collision, shape.xyz)
            vertices, tetrahedra = box_mesh(shape.size, shape.resolution)
            path = f"meshes/{self._meshes}_{piece.name}_{len(tetrahedra)}.vtk"
            self.files[path] = vtk_text(np.round(vertices, 9), tetrahedra)
            mesh = AddChild(AddChild(collision, "geometry"), "mesh")
            AddChild(mesh, "uri", f"package://drake_srg/{path}")
        else:
            name, solid = piece.name, shape
            if isinstance(shape, Turned):
                AddPose(collision, (0, 0, 0), (0, 0, shape.angle))
                name, solid = shape.name, shape.solid
            elif isinstance(shape, Surface):
                solid = shape.solid
            path = f"meshes/{self._meshes}_{name}_collision.obj"
            if path not in self.files:
                self.files[path] = obj_text([solid], crease=0)
            mesh = AddChild(AddChild(collision, "geometry"), "mesh")
            AddChild(mesh, "uri", f"package://drake_srg/{path}")
            if not isinstance(shape, Surface):
                AddChild(mesh, "drake:declare_convex")
        AddProximity(collision, piece.proximity, resolution)

    def AddJoint(
        self,
        name: str,
        parent: str,
        child: str,
        axis: Sequence[float],
        limits: Mapping[str, float],
        damping: float,
        rotor_inertia: float = 0.0,
        gear_ratio: float = 1.0,
        kind: str = "revolute",
    ) -> None:
        """Add a revolute or prismatic joint with an actuator at the child's origin."""
        joint = AddChild(self.root, "joint", name=name, type=kind)
        AddChild(joint, "parent", parent)
        AddChild(joint, "child", child)
        node = AddChild(joint, "axis")
        AddChild(node, "xyz", axis)
        limit = AddChild(node, "limit")
        for key, value in limits.items():
            AddChild(limit, key, value)
        AddChild(AddChild(node, "dynamics"), "damping", damping)
        if rotor_inertia:
            AddChild(joint, "drake:rotor_inertia", f"{rotor_inertia:.6g}")
            AddChild(joint, "drake:gear_ratio", f"{gear_ratio:.6g}")

    def AddFrame(
        self, name: str, attached_to: str, xyz: Sequence[float] = (0, 0, 0)
    ) -> None:
        """Add a frame parallel to the one it is attached to."""
        frame = AddChild(self.root, "frame", name=name, attached_to=attached_to)
        AddPose(frame, xyz)

    def AddFilter(self, name: str, members: Sequence[str]) -> None:
        """Exclude contact among the members of a group."""
        group = AddChild(self.root, "drake:collision_filter_group", name=name)
        for member in members:
            AddChild(group, "drake:member", member)
        AddChild(group, "drake:ignored_collision_filter_group", name)

    def finish(self, path: str) -> Files:
        """Return all files of the model, including the SDF."""
        ET.indent(self._sdf, "  ")
        text = ET.tostring(self._sdf, encoding="unicode")
        lines = ["Generated by tools/build_models.py.", *self._comment.splitlines()]
        comment = "\n     ".join(lines)
        head = f'<?xml version="1.0"?>\n<!-- {comment} -->\n'
        return {path: head + text + "\n", **self.files}


def AddPrimitive(geometry: ET.Element, shape: Primitive) -> None:
    """Append a primitive shape."""
    node = AddChild(geometry, shape.kind)
    if shape.kind == "box":
        AddChild(node, "size", shape.size)
        return
    AddChild(node, "radius", shape.size[0])
    if shape.kind != "sphere":
        AddChild(node, "length", shape.size[1])


def AddProximity(
    collision: ET.Element, proximity: Proximity, resolution: float | None
) -> None:
    """Append Drake's contact properties."""
    node = AddChild(collision, "drake:proximity_properties")
    if proximity.rigid:
        AddChild(node, "drake:rigid_hydroelastic")
    elif proximity.rigid is not None:
        AddChild(node, "drake:compliant_hydroelastic")
    d = proximity.dissipation
    for tag, value in (
        ("mesh_resolution_hint", resolution),
        ("hydroelastic_modulus", proximity.modulus),
        ("point_contact_stiffness", proximity.point_stiffness),
        ("hunt_crossley_dissipation", d),
        ("relaxation_time", relaxation_time(d or 0.0)),
        ("mu_dynamic", proximity.friction),
        ("mu_static", proximity.friction),
    ):
        if value is not None:
            AddChild(node, f"drake:{tag}", format_number(value, 6))
