"""Files of objects: triangle meshes, URDF and SDF, and their contents."""

from __future__ import annotations

import contextlib
import dataclasses as dc
import re
import xml.etree.ElementTree as ET
from pathlib import Path
from types import ModuleType
from typing import Any, TypeAlias

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.tree import RotationalInertia, SpatialInertia

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.common.installing import require
from drake_srg.objects.sdf import DRAKE
from drake_srg.parsing import resolve_url
from drake_srg.types import Box, Cylinder, Shape, Sphere, Vector

Color: TypeAlias = tuple[float, float, float]
# trimesh.Trimesh, which has no type information.
TriangleMesh: TypeAlias = Any


@dc.dataclass(frozen=True, eq=False)
class MeshFile:
    """A mesh in a file.

    Attributes:
        path: The file.
        scale: Factors along the file's x, y, z, shape (3,).
    """

    path: Path
    scale: Vector


@dc.dataclass(frozen=True, eq=False)
class Geometry:
    """A visual or collision geometry.

    Attributes:
        shape: A primitive, centred on its frame G, or a mesh.
        X_LG: Pose of G in the link [m].
        color: Of a visual; None: the mesh's own.
        contact: Drake's contact properties, if the file has them.
    """

    shape: Shape | MeshFile
    X_LG: RigidTransform = dc.field(default_factory=RigidTransform)
    color: Color | None = None
    contact: ET.Element | None = None


@dc.dataclass(frozen=True, eq=False)
class Contents:
    """The single link L of an object's file.

    Attributes:
        path: The file.
        visuals: What cameras see.
        collisions: What is touched.
        inertia: M_LLo_L as the file says; None: the file does not.
        mass: As the file says [kg]; None: the file does not.
        warnings: What was mended while reading.
    """

    path: Path
    visuals: list[Geometry]
    collisions: list[Geometry]
    inertia: SpatialInertia | None = None
    mass: float | None = None
    warnings: list[str] = dc.field(default_factory=list)

    def mesh_files(self) -> list[Path]:
        """Return the files of all meshes, each once."""
        shapes = [g.shape for g in (*self.visuals, *self.collisions)]
        files = [shape.path for shape in shapes if isinstance(shape, MeshFile)]
        return list(dict.fromkeys(files))


SUFFIXES = (".obj", ".stl", ".glb", ".gltf")
# Extents of an object [m]: the smallest that contact resolves, and the kitchen's table.
SMALLEST, LARGEST = 0.003, 1.6
# glTF's y points up, and the front is z.
_R_UP = RotationMatrix.MakeXRotation(np.pi / 2).matrix()


def require_trimesh() -> ModuleType:
    """Import trimesh.

    Raises:
        ImportError: If it is missing; the message says how to install it.
    """
    return require("trimesh", "import", "Reading a mesh needs")


def read_mesh(
    path: Path, scale: Vector, warnings: list[str]
) -> list[tuple[TriangleMesh, Color | None]]:
    """Read the meshes of a file, with their colours.

    Vertices that coincide are merged, and a mesh that is inside out is turned.

    Args:
        path: The file.
        scale: Metres per unit along x, y, z, shape (3,).
        warnings: Receives what was mended.

    Raises:
        ScenarioError: If it is not a mesh, or a broken one.
        ImportError: If trimesh is missing.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise ScenarioError(
            f"{path}: unknown format (allowed: .sdf, .urdf, {', '.join(SUFFIXES)})"
        )
    if not path.is_file():
        raise ScenarioError(f"{path}: cannot be read: no such file")
    trimesh = require_trimesh()
    try:
        scene = trimesh.load_scene(str(path), process=False)
        found = [m for m in scene.dump() if isinstance(m, trimesh.Trimesh)]
    except Exception as error:  # trimesh's readers raise whatever they meet
        reason = one_line(error) or type(error).__name__
        raise ScenarioError(f"{path}: cannot be read as a mesh: {reason}") from None
    found = [mesh for mesh in found if len(mesh.faces)]
    if not found:
        raise ScenarioError(f"{path}: has no triangles (is it another kind of file?)")
    meshes, colors = [], []
    for mesh in found:
        vertices = np.asarray(mesh.vertices, float)
        if not np.all(np.isfinite(vertices)):
            (rows,) = np.nonzero(~np.isfinite(vertices).all(axis=1))
            raise ScenarioError(
                f"{path}: {len(rows)} of {len(vertices)} vertices are not finite, the "
                f"first is vertex {rows[0]}: {vertices[rows[0]].tolist()} "
                "(export the mesh again)"
            )
        if path.suffix.lower() in (".glb", ".gltf"):
            vertices = vertices @ _R_UP.T
        whole = trimesh.Trimesh(vertices * scale, mesh.faces, process=False)
        if np.prod(scale) < 0.0:  # a mirrored mesh is inside out
            whole.invert()
        whole.merge_vertices()
        whole.update_faces(whole.nondegenerate_faces(height=1e-9))
        whole.remove_unreferenced_vertices()
        if len(whole.faces):
            meshes.append(whole)
            colors.append(_color(mesh))
    if not meshes:
        raise ScenarioError(f"{path}: has only triangles without area")
    corners = np.vstack([mesh.bounds for mesh in meshes])
    check_size(path, corners.min(axis=0), corners.max(axis=0))
    meshes = [_turned_outside_out(mesh, warnings) for mesh in meshes]
    return list(zip(meshes, colors, strict=True))


def check_size(path: Path, low: Vector, high: Vector) -> None:
    """Check the extent of an object.

    Args:
        path: Its file, for error messages.
        low: Its least coordinates, shape (3,) [m].
        high: Its greatest coordinates, shape (3,) [m].

    Raises:
        ScenarioError: If an object cannot be as large, small or flat.
    """
    size = high - low
    text = " x ".join(f"{side:.4g}" for side in size)
    unit = ""
    for factor, name in ((0.001, "millimetres"), (0.01, "centimetres"), (1e3, "km")):
        if SMALLEST <= factor * size.max() <= LARGEST / 2:
            unit = f"; if its unit is {name}, scale it by {factor:g}"
            break
    if size.max() > LARGEST:
        raise ScenarioError(
            f"{path}: is {text} m large, more than the table ({LARGEST} m){unit}"
        )
    if size.max() < SMALLEST:
        raise ScenarioError(
            f"{path}: is {text} m large, too small to touch (at least {SMALLEST} m)"
            f"{unit}"
        )
    if size.min() < 1e-5:
        raise ScenarioError(f"{path}: is flat ({text} m): a body needs a volume")


def mesh_parts(mesh: TriangleMesh) -> list[TriangleMesh]:
    """Return the connected parts of a mesh."""
    return list(mesh.split(only_watertight=False, repair=False))


def is_cavity(part: TriangleMesh, whole: TriangleMesh) -> bool:
    """Return whether a part of a mesh bounds a hollow inside it."""
    (low, high), (least, most) = part.bounds, whole.bounds
    return _is_inside_out(part) and bool(np.all(least < low) and np.all(high < most))


def _is_inside_out(mesh: TriangleMesh) -> bool:
    closed = mesh.is_watertight and mesh.is_winding_consistent
    return bool(closed and mesh.volume < 0.0)


def _turned_outside_out(mesh: TriangleMesh, warnings: list[str]) -> TriangleMesh:
    """Return a mesh with the faces of its closed parts turned outwards."""
    parts = mesh_parts(mesh)
    if _is_inside_out(mesh):
        wrong = list(parts)
    else:
        wrong = [p for p in parts if _is_inside_out(p) and not is_cavity(p, mesh)]
    if not wrong:
        return mesh
    for part in wrong:
        part.invert()
    warnings.append(
        f"turned the faces of {len(wrong)} of {len(parts)} parts, which pointed inwards"
    )
    return require_trimesh().util.concatenate(list(parts))


def describe_openness(mesh: TriangleMesh) -> str:
    """Return what keeps a mesh from being closed, and where; empty if it is closed."""
    if mesh.is_volume:
        return ""
    if not mesh.is_watertight:
        edges = mesh.edges_sorted
        _, index, count = np.unique(
            edges, axis=0, return_index=True, return_counts=True
        )
        rim = edges[index[count == 1]]
        if len(rim):
            x, y, z = mesh.vertices[rim[0]].mean(axis=0)
            return f"open at {len(rim)} edges, one at ({x:.4g}, {y:.4g}, {z:.4g}) m"
        return "not closed: more than two faces meet at an edge"
    return "inconsistent: its faces disagree on which side is outside"


def _color(mesh: TriangleMesh) -> Color | None:
    """Return the mean colour of a mesh; None if the file has none."""
    visual = mesh.visual
    material: Any = getattr(visual, "material", None)
    image = next(
        (
            found
            for name in ("baseColorTexture", "image")
            if (found := getattr(material, name, None)) is not None
        ),
        None,
    )
    if image is not None:
        rgb = np.asarray(image.convert("RGB"), float).reshape(-1, 3).mean(axis=0)
    elif material is not None:
        rgb = np.asarray(material.main_color, float)[:3]
    elif getattr(visual, "defined", False):
        rgb = np.asarray(visual.main_color, float)[:3]
    else:
        return None
    r, g, b = (round(float(x) / 255.0, 3) for x in rgb)
    return (r, g, b)


_MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def read_xml(path: Path, warnings: list[str]) -> ET.Element:
    """Return the tree of an XML file; Drake's namespace gets its usual name.

    Args:
        path: The file.
        warnings: Receives what was mended: an invalid header is left out.

    Raises:
        ScenarioError: If it cannot be read.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeError:
        raise ScenarioError(f"{path}: cannot be read: not text in UTF-8") from None
    text = re.sub(r"""xmlns:drake=(["'])[^"']*\1""", f'xmlns:drake="{DRAKE}"', text)
    try:
        return ET.fromstring(text)
    except ET.ParseError as error:
        # Public URDF files have headers such as `<xml version="0.0" ?>`.
        mended = re.sub(r"<\??xml\b[^>]*>", "", text, count=1).strip()
        try:
            root = ET.fromstring(mended)
        except ET.ParseError:
            raise ScenarioError(f"{path}: cannot be read: {error}") from None
        warnings.append("left out the invalid XML header")
        return root


def read_link(path: Path) -> Contents:
    """Read a URDF or SDF file with one free link.

    Raises:
        ScenarioError: If it cannot be read, has several links, or holds something else
            than boxes, cylinders, spheres and meshes.
    """
    warnings: list[str] = []
    root = read_xml(path, warnings)
    formats = {"robot": _Urdf, "sdf": _Sdf}
    if root.tag not in formats:
        raise ScenarioError(
            f"{path}: must hold <robot> (URDF) or <sdf>, got <{root.tag}>"
        )
    read = formats[root.tag](path)
    links = root.findall(read.link)
    if len(links) != 1:
        raise ScenarioError(
            f"{path}: must have one link, got {len(links)} (a single rigid body)"
        )
    visuals = [read.geometry(node) for node in links[0].findall("visual")]
    collisions = [read.geometry(node) for node in links[0].findall("collision")]
    if not visuals and not collisions:
        raise ScenarioError(f"{path}: its link has no geometry")
    if not collisions:
        warnings.append("no collision geometry: took the visual one")
    if not visuals:
        warnings.append("no visual geometry: took the collision one")
    mass, inertia = read.inertial(links[0])
    return Contents(
        path, visuals or collisions, collisions or visuals, inertia, mass, warnings
    )


class _Sdf:
    """Reads the elements of an SDF file, whose values are elements of their own."""

    link, mesh, color = "model/link", "uri", ("material", "diffuse")

    def __init__(self, path: Path) -> None:
        self._path = path

    def text(self, node: ET.Element | None, key: str) -> str | None:
        """Return the text of a value; None if it is missing."""
        return None if node is None else node.findtext(key)

    def pose(self, node: ET.Element) -> RigidTransform:
        """Return the pose of an element in the link."""
        pose = node.find("pose")
        if pose is None:
            return RigidTransform()
        if pose.get("relative_to") or pose.get("degrees", "false") != "false":
            raise ScenarioError(
                f"{self._path}: <pose>: must be in radians and relative to the link"
            )
        values = self._numbers("pose", pose.text, 6)
        return RigidTransform(RollPitchYaw(values[3:]), values[:3])

    def mass(self, inertial: ET.Element) -> str | None:
        """Return the text of the mass; None if it is missing."""
        return inertial.findtext("mass")

    def _numbers(self, key: str, text: str | None, count: int = 1) -> Vector:
        """Return the numbers in a text.

        Raises:
            ScenarioError: If there are others than `count` finite numbers.
        """
        try:
            values = np.array([float(word) for word in (text or "").split()])
        except ValueError:
            values = np.array([])
        if values.shape != (count,) or not np.all(np.isfinite(values)):
            needed = "a finite number" if count == 1 else f"{count} finite numbers"
            raise ScenarioError(f"{self._path}: {key}: needs {needed}, got {text!r}")
        return values

    def geometry(self, node: ET.Element) -> Geometry:
        """Return a visual or collision geometry."""
        shapes = node.findall("geometry/*")
        if len(shapes) != 1:
            raise ScenarioError(
                f"{self._path}: <{node.tag}>: needs one geometry, got {len(shapes)}"
            )
        material, key = self.color
        text = self.text(node.find(material), key)
        color = None if text is None else self._numbers(key, text, 4)
        return Geometry(
            self._shape(shapes[0]),
            self.pose(node),
            None if color is None else (color[0], color[1], color[2]),
            node.find(f"{{{DRAKE}}}proximity_properties"),
        )

    def _shape(self, node: ET.Element) -> Shape | MeshFile:
        def size(key: str, count: int = 1) -> Vector:
            values = self._numbers(key, self.text(node, key), count)
            if not np.all(values > 0.0):
                problem = f"must be greater than 0, got {values.tolist()}"
                raise ScenarioError(f"{self._path}: <{node.tag}> {key}: {problem}")
            return values

        match node.tag:
            case "box":
                return Box(size("size", 3).tolist())
            case "cylinder":
                return Cylinder(float(size("radius")[0]), float(size("length")[0]))
            case "sphere":
                return Sphere(float(size("radius")[0]))
            case "mesh":
                scale = self._numbers("scale", self.text(node, "scale") or "1 1 1", 3)
                uri = self.text(node, self.mesh) or ""
                return MeshFile(_resolved(self._path, uri.strip()), scale)
        raise ScenarioError(
            f"{self._path}: unknown geometry <{node.tag}> "
            "(allowed: box, cylinder, sphere, mesh)"
        )

    def inertial(self, link: ET.Element) -> tuple[float | None, SpatialInertia | None]:
        """Return a link's mass and spatial inertia; None if missing or invalid."""
        node = link.find("inertial")
        text = None if node is None else self.mass(node)
        if node is None or text is None:
            return None, None
        mass = float(self._numbers("mass", text)[0])
        X_LI = self.pose(node)
        found = [self.text(node.find("inertia"), key) for key in _MOMENTS]
        if not mass > 0.0 or None in found[:3]:
            return (mass if mass > 0.0 else None), None
        moments = [
            float(self._numbers(key, text or "0")[0])
            for key, text in zip(_MOMENTS, found, strict=True)
        ]
        try:
            I_I = RotationalInertia(*moments)
            return mass, SpatialInertia.MakeFromCentralInertia(
                mass, X_LI.translation(), I_I.ReExpress(X_LI.rotation())
            )
        except RuntimeError:  # no body has these moments
            return mass, None


class _Urdf(_Sdf):
    """Reads the elements of a URDF file, whose values are attributes."""

    link, mesh, color = "link", "filename", ("material/color", "rgba")

    def text(self, node: ET.Element | None, key: str) -> str | None:
        return None if node is None else node.get(key)

    def pose(self, node: ET.Element) -> RigidTransform:
        origin = node.find("origin")
        xyz, rpy = (
            self._numbers(key, self.text(origin, key) or "0 0 0", 3)
            for key in ("xyz", "rpy")
        )
        return RigidTransform(RollPitchYaw(rpy), xyz)

    def mass(self, inertial: ET.Element) -> str | None:
        return self.text(inertial.find("mass"), "value")


def _resolved(path: Path, uri: str) -> Path:
    """Return the file that a URI in a file names: relative, absolute or in a package.

    A package is ours, or a folder of that name above or beside the file.

    Raises:
        ScenarioError: If there is no such file.
    """
    scheme, colon, rest = uri.partition("://")
    name, _, inside = rest.partition("/")
    if not colon:
        candidates = [path.parent / uri]
    elif scheme == "file":
        candidates = [Path(rest)]
    else:  # package:// and Gazebo's model://
        above = path.resolve().parents
        candidates = [folder / name / inside for folder in above]
    for candidate in candidates:
        if candidate.is_file():
            return candidate
    if scheme == "package" and name == "drake_srg":
        with contextlib.suppress(RuntimeError):
            return resolve_url(uri)
    raise ScenarioError(f"{path}: its mesh {uri!r} does not exist")
