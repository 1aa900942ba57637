"""SDFormat text with Drake's extensions, and the files that go with it."""

from __future__ import annotations

import dataclasses as dc
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence

import numpy as np

from drake_srg.objects.soft_mesh import box_mesh, vtk_text

from .shapes import MassProperties, Number, Obj, Points, Solid

Color = tuple[float, float, float]
Files = dict[str, str]  # path below models/ -> text


@dc.dataclass(frozen=True)
class Primitive:
    """A box (x, y, z), cylinder (radius, length) or sphere (radius) with its pose."""

    kind: str
    size: tuple[float, ...]
    xyz: tuple[float, float, float] = (0, 0, 0)
    rpy: tuple[float, float, float] = (0, 0, 0)


@dc.dataclass(frozen=True)
class VolumeMesh:
    """A box (x, y, z), centred at xyz, cut into tetrahedra.

    Drake then meshes contact with it more finely than with the box itself.
    """

    size: tuple[float, float, float]
    xyz: tuple[float, float, float]
    resolution: float


@dc.dataclass(frozen=True)
class Proximity:
    """Contact properties; None leaves Drake's default."""

    rigid: bool = True
    friction: float | None = None
    modulus: float | None = None  # Pa
    dissipation: float | None = None  # s/m
    resolution: float | None = None  # m


@dc.dataclass(frozen=True)
class Piece:
    """One convex piece of a link: what is seen, and what is touched.

    `solid` is seen in the colour `look` names (None: not seen); `collision` is touched
    (None: the piece is a cosmetic detail).
    """

    name: str
    look: str | None
    solid: Solid
    collision: Primitive | VolumeMesh | Solid | None = None
    proximity: Proximity = Proximity()


@dc.dataclass(frozen=True)
class Inertial:
    """Mass [kg], centre of mass [m], inertia about it [kg m^2]."""

    mass: float
    com: Sequence[float]
    inertia: Points

    @staticmethod
    def Uniform(mass: float, properties: MassProperties) -> Inertial:
        """Spreads a mass evenly over a volume."""
        scale = mass / properties.volume
        return Inertial(mass, properties.center, properties.inertia * scale)


def Sub(parent: ET.Element, tag: str, text: object = None, **attributes: str):
    """Appends a child element and returns it."""
    child = ET.SubElement(parent, tag, attributes)
    if text is not None:
        child.text = text if isinstance(text, str) else Text(text)
    return child


def Text(value: object) -> str:
    """Returns numbers as SDF text."""
    values = np.atleast_1d(np.asarray(value, float))
    return " ".join(_Significant(x) for x in values)


def _Significant(x: float) -> str:
    text = f"{x:.12g}"
    if "e" in text and abs(x) < 1e-4:
        return "0" if abs(x) < 1e-12 else f"{x:.5g}"
    return "0" if text == "-0" else text


def Pose(parent: ET.Element, xyz: Sequence[float], rpy: Sequence[float] = (0, 0, 0)):
    """Appends a pose unless it is the identity."""
    pose = Sub(parent, "pose", [*xyz, *rpy])
    if not np.any(np.abs([*xyz, *rpy]) > 0):
        parent.remove(pose)
    return pose


class Model:
    """An SDF model under construction."""

    def __init__(self, name: str, looks: Mapping[str, Color], comment: str = ""):
        self._name = name
        self._looks = looks
        self._sdf = ET.Element(
            "sdf", {"version": "1.9", "xmlns:drake": "http://drake.mit.edu"}
        )
        self._comment = comment
        self.root = Sub(self._sdf, "model", name=name)
        self.files: Files = {}

    def AddLink(
        self,
        name: str,
        pieces: Sequence[Piece],
        inertial: Inertial | None,
        pose: tuple[str, Sequence[float], Sequence[float]] | None = None,
        prefix: str = "",
    ) -> None:
        """Adds a link from its pieces; `pose` is (relative_to, xyz, rpy).

        The prefix is put before the link's and its geometries' names, not before the
        names of the meshes: links alike but for the prefix share their meshes.
        """
        link = Sub(self.root, "link", name=prefix + name)
        if pose is not None:
            Sub(link, "pose", [*pose[1], *pose[2]], relative_to=pose[0])
        if inertial is not None:
            node = Sub(link, "inertial")
            Pose(node, np.round(inertial.com, 6) + 0.0)
            Sub(node, "mass", inertial.mass)
            matrix = Sub(node, "inertia")
            for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
                value = f"{inertial.inertia[i, j]:.4g}"
                floor = 1e-5 * np.max(inertial.inertia)
                if abs(inertial.inertia[i, j]) < floor:
                    value = "0"
                Sub(matrix, "i" + "xyz"[i] + "xyz"[j], value)
        for look in dict.fromkeys(p.look for p in pieces if p.look):
            seen = [p.solid for p in pieces if p.look == look]
            self._AddVisual(link, f"{name}_{look}", prefix, look, seen)
        for piece in pieces:
            if piece.collision is not None:
                self._AddCollision(link, piece, prefix)

    def _AddVisual(
        self, link: ET.Element, name: str, prefix: str, look: str, seen: list[Solid]
    ) -> None:
        visual = Sub(link, "visual", name=prefix + name)
        path = f"meshes/{self._name}_{name}.obj"
        self.files[path] = Obj(seen)
        mesh = Sub(Sub(visual, "geometry"), "mesh")
        Sub(mesh, "uri", f"package://drake_srg/{path}")
        material = Sub(visual, "material")
        Sub(material, "diffuse", [*self._looks[look], 1])

    def _AddCollision(self, link: ET.Element, piece: Piece, prefix: str) -> None:
        collision = Sub(link, "collision", name=prefix + piece.name)
        shape = piece.collision
        resolution = None
        if isinstance(shape, Primitive):
            Pose(collision, shape.xyz, shape.rpy)
            AddPrimitive(Sub(collision, "geometry"), shape)
            if shape.kind != "box":  # only round primitives are cut into facets
                resolution = piece.proximity.resolution
        elif isinstance(shape, VolumeMesh):
            Pose(collision, shape.xyz)
            vertices, tetrahedra = box_mesh(shape.size, shape.resolution)
            path = f"meshes/{self._name}_{piece.name}_{len(tetrahedra)}.vtk"
            self.files[path] = vtk_text(np.round(vertices, 9), tetrahedra)
            mesh = Sub(Sub(collision, "geometry"), "mesh")
            Sub(mesh, "uri", f"package://drake_srg/{path}")
        else:
            path = f"meshes/{self._name}_{piece.name}_collision.obj"
            self.files[path] = Obj([shape], crease=0)
            mesh = Sub(Sub(collision, "geometry"), "mesh")
            Sub(mesh, "uri", f"package://drake_srg/{path}")
            Sub(mesh, "drake:declare_convex")
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
        """Adds an actuated joint, revolute or prismatic, at the child's origin."""
        joint = Sub(self.root, "joint", name=name, type=kind)
        Sub(joint, "parent", parent)
        Sub(joint, "child", child)
        node = Sub(joint, "axis")
        Sub(node, "xyz", axis)
        limit = Sub(node, "limit")
        for key, value in limits.items():
            Sub(limit, key, value)
        Sub(Sub(node, "dynamics"), "damping", damping)
        if rotor_inertia:
            Sub(joint, "drake:rotor_inertia", f"{rotor_inertia:.6g}")
            Sub(joint, "drake:gear_ratio", f"{gear_ratio:.6g}")

    def AddFrame(
        self, name: str, attached_to: str, xyz: Sequence[float] = (0, 0, 0)
    ) -> None:
        """Adds a frame, parallel to the one it is attached to."""
        frame = Sub(self.root, "frame", name=name, attached_to=attached_to)
        Pose(frame, xyz)

    def AddFilter(self, name: str, members: Sequence[str]) -> None:
        """Lets the members of a group pass through each other."""
        group = Sub(self.root, "drake:collision_filter_group", name=name)
        for member in members:
            Sub(group, "drake:member", member)
        Sub(group, "drake:ignored_collision_filter_group", name)

    def Finish(self, path: str) -> Files:
        """Returns all files of the model, the SDF among them."""
        ET.indent(self._sdf, "  ")
        text = ET.tostring(self._sdf, encoding="unicode")
        lines = ["Generated by tools/build_models.py.", *self._comment.splitlines()]
        comment = "\n     ".join(lines)
        head = f'<?xml version="1.0"?>\n<!-- {comment} -->\n'
        return {path: head + text + "\n", **self.files}


def AddPrimitive(geometry: ET.Element, shape: Primitive) -> None:
    """Appends a primitive shape."""
    node = Sub(geometry, shape.kind)
    if shape.kind == "box":
        Sub(node, "size", shape.size)
        return
    Sub(node, "radius", shape.size[0])
    if shape.kind != "sphere":
        Sub(node, "length", shape.size[1])


def AddProximity(
    collision: ET.Element, proximity: Proximity, resolution: float | None
) -> None:
    """Appends Drake's contact properties."""
    node = Sub(collision, "drake:proximity_properties")
    if proximity.rigid:
        Sub(node, "drake:rigid_hydroelastic")
    else:
        Sub(node, "drake:compliant_hydroelastic")
    for tag, value in (
        ("mesh_resolution_hint", resolution),
        ("hydroelastic_modulus", proximity.modulus),
        ("hunt_crossley_dissipation", proximity.dissipation),
        ("mu_dynamic", proximity.friction),
        ("mu_static", proximity.friction),
    ):
        if value is not None:
            Sub(node, f"drake:{tag}", Number(value, 6))
