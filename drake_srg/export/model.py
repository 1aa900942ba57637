"""A model in no particular format: links, joints, geometries, constraints, meshes."""

from __future__ import annotations

import dataclasses as dc
import math
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from pydrake.geometry import Box, Convex, Cylinder, Mesh, Shape, Sphere
from pydrake.math import RigidTransform

from drake_srg.common.exceptions import ScenarioError
from drake_srg.recording.replay.triangles import Triangles, shape_triangles
from drake_srg.types import Vector

WORLD = "world"


@dc.dataclass(frozen=True)
class Geometry:
    """A shape on a link.

    Attributes:
        name: Unique among the link's visuals, or among its collisions.
        shape: Drake's shape.
        X_LG: Its pose on the link.
        color: Red, green, blue, opacity, 0 .. 1; None for a collision geometry.
        friction: Coefficient of friction; None for a visual geometry.
        modulus: Hydroelastic modulus [Pa]; infinite: it is rigid.
    """

    name: str
    shape: Shape
    X_LG: RigidTransform
    color: tuple[float, ...] | None = None
    friction: float | None = None
    modulus: float = math.inf


@dc.dataclass(frozen=True)
class Link:
    """A rigid body.

    Attributes:
        name: Its name.
        mass: Mass [kg].
        p_LC: Centre of mass in the link's frame [m], shape (3,).
        I_C: Inertia about the centre of mass, in the link's axes [kg m²], (3, 3).
        X_WL: Its pose in world at the start.
        geometries: Visual and collision geometries.
        free: Whether the link moves freely.
    """

    name: str
    mass: float
    p_LC: Vector
    I_C: Vector
    X_WL: RigidTransform
    geometries: tuple[Geometry, ...] = ()
    free: bool = False


@dc.dataclass(frozen=True)
class Mimic:
    """A joint that follows another: q = multiplier q_other + offset."""

    joint: str
    multiplier: float
    offset: float


@dc.dataclass(frozen=True)
class Joint:
    """A joint; the frames of parent and child meet at its zero position.

    Limits are infinite where there are none. Units are m or rad, N or N m.

    Attributes:
        name: Its name.
        kind: "revolute", "prismatic" or "fixed".
        parent: A link, or WORLD.
        child: A link.
        X_PJ: Pose of the joint's frame on the parent.
        X_CJ: Pose of the joint's frame on the child.
        axis: Unit vector in the joint's frame, shape (3,).
        lower: Least position.
        upper: Greatest position.
        velocity: Greatest speed.
        acceleration: Greatest acceleration.
        effort: Greatest force or torque of its actuator; 0: it has no actuator.
        damping: Viscous damping.
        rotor_inertia: Inertia of its motor's rotor [kg m²].
        gear_ratio: Gear ratio of its motor.
        gains: Stiffness and damping of its position controller, if it has one.
        start: Position at the start.
        mimic: The joint that it follows.
    """

    name: str
    kind: str
    parent: str
    child: str
    X_PJ: RigidTransform
    X_CJ: RigidTransform
    axis: Vector = dc.field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    acceleration: float = math.inf
    effort: float = 0.0
    damping: float = 0.0
    rotor_inertia: float = 0.0
    gear_ratio: float = 1.0
    gains: tuple[float, float] | None = None
    start: float = 0.0
    mimic: Mimic | None = None

    @property
    def X_PC(self) -> RigidTransform:
        """Pose of the child on the parent at the zero position."""
        return self.X_PJ @ self.X_CJ.inverse()

    @property
    def armature(self) -> float:
        """Inertia of the rotor as the joint feels it [kg m² or kg]."""
        return self.rotor_inertia * self.gear_ratio**2


@dc.dataclass(frozen=True)
class Loop:
    """A pin that holds a point of a link to a point of another one.

    Attributes:
        name: Its name.
        links: Names of the links.
        points: The points, each in its link's frame [m].
    """

    name: str
    links: tuple[str, str]
    points: tuple[Vector, Vector]


@dc.dataclass(frozen=True)
class Model:
    """Links and joints that one file holds.

    Attributes:
        name: Its name.
        links: Its links.
        joints: Their joints; parents come before their children.
        loops: Constraints that close kinematic loops.
        apart: Pairs of links whose collisions are filtered, besides links that share a
            joint.
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    loops: tuple[Loop, ...] = ()
    apart: tuple[tuple[str, str], ...] = ()

    @property
    def roots(self) -> tuple[Link, ...]:
        """The links that are no joint's child."""
        held = {joint.child for joint in self.joints}
        return tuple(link for link in self.links if link.name not in held)

    def joint(self, name: str) -> Joint:
        """Return a joint by its name."""
        return next(joint for joint in self.joints if joint.name == name)


def add(parent: ET.Element, tag: str, **attributes: object) -> ET.Element:
    """Append an element; numbers become text, attributes that are None are left out."""
    written = {k: numbers(v) for k, v in attributes.items() if v is not None}
    return ET.SubElement(parent, tag, {k.rstrip("_"): v for k, v in written.items()})


def numbers(value: object) -> str:
    """Return a number or numbers as text with 12 significant digits."""
    if isinstance(value, str):
        return value
    return " ".join(_digits(x) for x in np.ravel(np.asarray(value, float)))


def _digits(x: float) -> str:
    return "0" if abs(x) < 1e-15 else f"{x:.12g}"


def to_text(root: ET.Element) -> str:
    """Return an XML document."""
    ET.indent(root)
    return f'<?xml version="1.0"?>\n{ET.tostring(root, "unicode")}\n'


FOLDER = "meshes"


@dc.dataclass(frozen=True)
class MeshFile:
    """A reference to a mesh file.

    Attributes:
        name: Name of the file without suffix; unique in the folder.
        scale: Factors along x, y, z, shape (3,).
        convex: Whether the shape is the mesh's convex hull.
    """

    name: str
    scale: Vector
    convex: bool

    @property
    def path(self) -> str:
        """The path of the file, relative to the models."""
        return f"{FOLDER}/{self.name}.obj"


class Meshes:
    """Collects the mesh files of models, without duplicates.

    Attributes:
        texts: Contents of the files (Wavefront), by `MeshFile.name`.
    """

    def __init__(self) -> None:
        self.texts: dict[str, str] = {}

    def file(self, shape: Shape, name: str) -> MeshFile | None:
        """Return the file of a shape; None for a box, a cylinder or a sphere.

        Wavefront files are copied without materials. Other mesh formats become their
        convex hulls, and other shapes become triangles.

        Args:
            shape: The shape.
            name: Name of the file, for a shape without one.

        Raises:
            ScenarioError: If the shape has no triangles.
        """
        if isinstance(shape, Box | Cylinder | Sphere):
            return None
        scale, convex = np.ones(3), isinstance(shape, Convex)
        if isinstance(shape, Mesh | Convex) and shape.source().is_path():
            path = Path(shape.source().path())
            if path.suffix.lower() == ".obj":
                scale = np.array(shape.scale3())
                return MeshFile(self._add(path.stem, _plain(path)), scale, convex)
            name = path.stem
        triangles = shape_triangles(shape)
        if triangles is None:
            kind = type(shape).__name__
            raise ScenarioError(f"{name}: a {kind} cannot be exported")
        convex = isinstance(shape, Mesh | Convex)
        return MeshFile(self._add(name, _wavefront(triangles)), scale, convex)

    def _add(self, stem: str, text: str) -> str:
        """Add a file, and return its name; equal texts share one."""
        name, count = stem, 1
        while self.texts.setdefault(name, text) != text:
            count += 1
            name = f"{stem}_{count}"
        return name


def _plain(path: Path) -> str:
    """Return a Wavefront file without materials, because models set the colours."""
    lines = path.read_text("utf-8", errors="replace").splitlines()
    kept = [line for line in lines if not line.startswith(("mtllib", "usemtl"))]
    return "\n".join(kept) + "\n"


def _wavefront(triangles: Triangles) -> str:
    points = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in triangles.points]
    faces = [f"f {a} {b} {c}" for a, b, c in triangles.faces + 1]
    return "\n".join([*points, *faces]) + "\n"
