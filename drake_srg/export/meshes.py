"""The mesh files beside exported models."""

from __future__ import annotations

import dataclasses as dc
from pathlib import Path

import numpy as np
from pydrake.geometry import Box, Convex, Cylinder, Mesh, Shape, Sphere

from drake_srg.common.exceptions import ScenarioError
from drake_srg.replay.triangles import Triangles, shape_triangles
from drake_srg.types import Vector

FOLDER = "meshes"


@dc.dataclass(frozen=True)
class MeshFile:
    """A mesh as models refer to it.

    Attributes:
        name: Of the file, without its suffix; unique in the folder.
        scale: Factors along x, y, z, shape (3,).
        convex: Whether it stands for its convex hull.
    """

    name: str
    scale: Vector
    convex: bool

    @property
    def path(self) -> str:
        """The file, relative to the models."""
        return f"{FOLDER}/{self.name}.obj"


class Meshes:
    """Collects the mesh files that models need, each once.

    Attributes:
        texts: Contents of the files (Wavefront), by `MeshFile.name`.
    """

    def __init__(self) -> None:
        self.texts: dict[str, str] = {}

    def file(self, shape: Shape, name: str) -> MeshFile | None:
        """Return the file of a shape; None for a box, a cylinder or a sphere.

        Wavefront files are copied, without materials. Other shapes and formats become
        what a replay shows of them, which for other mesh formats is the convex hull.

        Args:
            shape: The shape.
            name: For a shape that has no file yet.

        Raises:
            ScenarioError: If the shape cannot be drawn.
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
    """Return a Wavefront file without materials, which the models give."""
    lines = path.read_text("utf-8", errors="replace").splitlines()
    kept = [line for line in lines if not line.startswith(("mtllib", "usemtl"))]
    return "\n".join(kept) + "\n"


def _wavefront(triangles: Triangles) -> str:
    points = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in triangles.points]
    faces = [f"f {a} {b} {c}" for a, b, c in triangles.faces + 1]
    return "\n".join([*points, *faces]) + "\n"
