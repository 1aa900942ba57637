"""Reads triangle meshes, checks them, and mends what can be mended."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from pydrake.math import RotationMatrix

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.common.installing import require
from drake_srg.objects.meshes.contents import Color, TriangleMesh
from drake_srg.types import Vector

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
