"""Contents of an object's files, and the reader of its meshes."""

from __future__ import annotations

import dataclasses as dc
import io
import logging
import xml.etree.ElementTree as ET
from pathlib import Path
from types import ModuleType
from typing import Any, TypeAlias

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import SpatialInertia

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.common.installing import require
from drake_srg.objects.meshes.sources import MeshSource, read_source
from drake_srg.types import Shape, Vector

Color: TypeAlias = tuple[float, float, float]
# trimesh.Trimesh, which has no type information.
TriangleMesh: TypeAlias = Any


@dc.dataclass(frozen=True, eq=False)
class MeshFile:
    """A mesh in a file.

    Attributes:
        path: The file.
        scale: Factors along the file's x, y, z, shape (3,).
        named_in: The URDF or SDF file that names it, if one does.
    """

    path: Path
    scale: Vector
    named_in: Path | None = None


@dc.dataclass(frozen=True, eq=False)
class Geometry:
    """A visual or collision geometry.

    Attributes:
        shape: A primitive, centred on its frame G, or a mesh.
        X_LG: Pose of G in the link [m].
        color: Colour of a visual; None: the mesh's own.
        contact: Drake's contact properties as in an SDF, if the file has them.
        friction: Static and dynamic friction from an SDF's `surface`, if given.
    """

    shape: Shape | MeshFile
    X_LG: RigidTransform = dc.field(default_factory=RigidTransform)
    color: Color | None = None
    contact: ET.Element | None = None
    friction: tuple[float, float] | None = None


@dc.dataclass(frozen=True, eq=False)
class Contents:
    """The single link L of an object's file.

    Attributes:
        path: The file.
        visuals: Geometry that cameras see.
        collisions: Geometry that contact uses.
        inertia: M_LLo_L of the file; None if it has none.
        mass: Mass of the file [kg]; None if it has none.
        warnings: Defects that were mended while reading.
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


# Smallest and largest extent of an object [m]: contact resolves no less, and the
# kitchen's table is no larger.
SMALLEST, LARGEST = 0.003, 1.6
# glTF is white by default. Its y points up, and its z forwards.
_DEFAULTS: dict[str, Color] = {".glb": (1.0, 1.0, 1.0), ".gltf": (1.0, 1.0, 1.0)}
_R_UP = RotationMatrix.MakeXRotation(np.pi / 2).matrix()


@dc.dataclass(frozen=True, eq=False)
class ReadMesh:
    """The mesh of a file.

    Attributes:
        solid: All triangles, in one mesh.
        surfaces: The same triangles by colour; None if the file has no colours.
    """

    solid: TriangleMesh
    surfaces: list[tuple[TriangleMesh, Color | None]]


def require_trimesh() -> ModuleType:
    """Import trimesh.

    Raises:
        ImportError: If it is missing; the message says how to install it.
    """
    # Silence its log: our own errors and warnings report the same.
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)
    return require("trimesh", "import", "Reading a mesh needs")


def read_mesh(file: MeshFile, warnings: list[str]) -> ReadMesh:
    """Read the mesh of a file.

    Coinciding vertices are merged, even across materials, and parts that are inside out
    are turned. Closed meshes, such as another program's convex pieces, stay separate.

    Args:
        file: The file, and metres per unit.
        warnings: Receives the mended defects.

    Raises:
        ScenarioError: If the file holds no mesh, or a broken one.
        ImportError: If trimesh is missing.
    """
    path, scale, suffix = file.path, file.scale, file.path.suffix.lower()
    source = read_source(path)
    require_trimesh()
    try:
        with np.errstate(all="ignore"):  # `_piece` reports values that are not finite
            found = _loaded(source)
            colors = [_color(mesh) or _DEFAULTS.get(suffix) for mesh in found]
            pieces = [_piece(mesh, source, scale) for mesh in found]
    except ScenarioError:
        raise
    except Exception as error:  # trimesh's readers may raise anything
        reason = one_line(error) or type(error).__name__
        raise ScenarioError(f"{path}: cannot be read as a mesh: {reason}") from None
    if not found:
        raise ScenarioError(f"{path}: has no triangles (is it another kind of file?)")
    cleaned = [(m, c) for m, c in zip(pieces, colors, strict=True) if len(m.faces)]
    if not cleaned:
        raise ScenarioError(f"{path}: has only triangles without area")
    if source.missing:
        names = ", ".join(dict.fromkeys(source.missing))
        warnings.append(f"does not exist, so its colour is lost: {names}")
    cleaned.sort(key=lambda piece: piece[0].is_watertight)  # in the order of `_joined`
    solid = _joined([mesh for mesh, _ in cleaned])
    low, high = solid.bounds
    check_size(path, low, high, file)
    _turn_outside_out(solid, warnings)
    ends = np.cumsum([len(mesh.faces) for mesh, _ in cleaned])
    rows = np.split(np.arange(len(solid.faces)), ends[:-1])
    by_color: dict[Color | None, list[Any]] = {}
    for (_, color), own in zip(cleaned, rows, strict=True):
        by_color.setdefault(color, []).append(own)
    surfaces = [
        (solid.submesh([np.concatenate(own)], append=True, repair=False), color)
        for color, own in by_color.items()
    ]
    return ReadMesh(solid, surfaces)


def _loaded(source: MeshSource) -> list[TriangleMesh]:
    """Return trimesh's meshes of a source, each moved to its place in the scene."""
    trimesh = require_trimesh()
    suffix = source.path.suffix.lower().replace(".glb", ".gltf")
    content = io.BytesIO(source.content)
    scene = trimesh.load_scene(
        content, file_type=suffix[1:], resolver=source.files, process=False
    )
    return [m for m in scene.dump() if isinstance(m, trimesh.Trimesh) and len(m.faces)]


def _piece(mesh: TriangleMesh, source: MeshSource, scale: Vector) -> TriangleMesh:
    """Return one of trimesh's meshes in metres, z up, checked and cleaned.

    Raises:
        ScenarioError: If a vertex is not finite, or a triangle names a missing vertex.
    """
    path, vertices = source.path, np.asarray(mesh.vertices, float)
    if not np.all(np.isfinite(vertices)):
        (rows,) = np.nonzero(~np.isfinite(vertices).all(axis=1))
        raise ScenarioError(
            f"{path}: {len(rows)} of {len(vertices)} vertices are not finite, the "
            f"first is vertex {rows[0]}: {vertices[rows[0]].tolist()} "
            "(export the mesh again)"
        )
    if not 0 <= mesh.faces.min() <= mesh.faces.max() < len(vertices):
        last = f"the last of its {len(vertices)} vertices"
        raise ScenarioError(
            f"{path}: a triangle names a vertex beyond {last} (export the mesh again)"
        )
    if path.suffix.lower() in (".glb", ".gltf"):
        vertices = vertices @ _R_UP.T
    whole = require_trimesh().Trimesh(vertices * scale, mesh.faces, process=False)
    if np.prod(scale) < 0.0:  # a mirrored mesh is inside out
        whole.invert()
    whole.merge_vertices()
    whole.update_faces(whole.nondegenerate_faces(height=1e-9))
    whole.remove_unreferenced_vertices()
    return whole


def _joined(pieces: list[TriangleMesh]) -> TriangleMesh:
    """Return one mesh of all pieces; open ones come first and share vertices."""
    trimesh = require_trimesh()
    opened = trimesh.util.concatenate([p for p in pieces if not p.is_watertight])
    if not opened:
        return trimesh.util.concatenate(pieces)
    opened.merge_vertices()
    return trimesh.util.concatenate([opened, *(p for p in pieces if p.is_watertight)])


def check_size(
    path: Path, low: Vector, high: Vector, mesh: MeshFile | None = None
) -> None:
    """Check the extent of an object.

    Args:
        path: Its file, for error messages.
        low: Its least coordinates, shape (3,) [m].
        high: Its greatest coordinates, shape (3,) [m].
        mesh: The mesh with this extent; None for the whole of a URDF or SDF.

    Raises:
        ScenarioError: If the extent is too large, too small or too flat.
    """
    size = high - low
    text = " x ".join(f"{side:.4g}" for side in size)
    unit = ""
    for factor, name in ((0.001, "millimetres"), (0.01, "centimetres"), (1e3, "km")):
        if SMALLEST <= factor * size.max() <= LARGEST / 2:
            if mesh is None:
                advice = "write its sizes in metres"
            elif mesh.named_in is None:
                advice = f"scale it by {factor * mesh.scale[0]:g}"
            else:
                scale = " ".join(f"{factor * x:g}" for x in mesh.scale)
                advice = f'give <mesh> the scale "{scale}" in {mesh.named_in.name}'
            unit = f"; if its unit is {name}, {advice}"
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


def _turn_outside_out(mesh: TriangleMesh, warnings: list[str]) -> None:
    """Turn the faces of a mesh's closed parts outwards; faces keep their order."""
    groups = require_trimesh().graph.connected_components(
        mesh.face_adjacency, nodes=np.arange(len(mesh.faces)), min_len=1
    )
    parts = mesh.submesh(groups, only_watertight=False, append=False, repair=False)
    if _is_inside_out(mesh):
        wrong = list(range(len(parts)))
    else:
        wrong = [
            i
            for i, part in enumerate(parts)
            if _is_inside_out(part) and not is_cavity(part, mesh)
        ]
    if not wrong:
        return
    faces = np.array(mesh.faces)
    for i in wrong:
        faces[groups[i]] = faces[groups[i], ::-1]
    mesh.faces = faces
    warnings.append(
        f"turned the faces of {len(wrong)} of {len(parts)} parts, which pointed inwards"
    )


def describe_openness(mesh: TriangleMesh) -> str:
    """Return why a mesh is not closed, and where it is open; empty if it is closed."""
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
    if material is None:
        if not getattr(visual, "defined", False):
            return None
        rgb = np.asarray(visual.main_color, float)[:3] / 255.0
    elif hasattr(material, "baseColorFactor"):  # glTF: white by default
        factor, image = material.baseColorFactor, material.baseColorTexture
        rgb = np.ones(3) if factor is None else np.asarray(factor, float)[:3] / 255.0
        rgb = rgb if image is None else rgb * _mean_color(image)
    elif material.image is not None:
        rgb = _mean_color(material.image)
    else:
        rgb = np.asarray(material.main_color, float)[:3] / 255.0
    r, g, b = (round(float(x), 3) for x in rgb)
    return (r, g, b)


def _mean_color(image: Any) -> Vector:
    """Return the mean of an image of PIL, red, green, blue 0 .. 1."""
    return np.asarray(image.convert("RGB"), float).reshape(-1, 3).mean(axis=0) / 255.0
