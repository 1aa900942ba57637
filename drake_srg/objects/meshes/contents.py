"""The contents of an object's file, whatever its format."""

from __future__ import annotations

import dataclasses as dc
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any, TypeAlias

from pydrake.math import RigidTransform
from pydrake.multibody.tree import SpatialInertia

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
