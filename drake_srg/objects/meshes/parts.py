"""The geometry of an object in convex parts, with their inertia."""

from __future__ import annotations

import dataclasses as dc
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.tree import RotationalInertia, SpatialInertia

from drake_srg.objects.meshes.contents import Color, Geometry, MeshFile, TriangleMesh
from drake_srg.objects.meshes.mesh_file import (
    describe_openness,
    read_mesh,
    require_trimesh,
)
from drake_srg.objects.meshes.pieces import Fit, convex_pieces, measure_fit
from drake_srg.types import Box, Cylinder, Shape, Sphere, Vector

ColoredMesh = tuple[TriangleMesh, Color | None]


@dc.dataclass(frozen=True, eq=False)
class Part:
    """A collision geometry of the link L.

    Attributes:
        shapes: A primitive, or the corners of convex pieces in L, each (n, 3) [m].
        X_LG: Pose of the primitive.
        M_LLo_L: Spatial inertia about L's origin at 1 kg/m³: its mass is the volume.
        low: Least coordinates in L [m].
        high: Greatest coordinates in L [m].
        contact: Drake's contact properties, if the file has them.
        fit: How well pieces stand for their mesh; None for a primitive.
        cut: Whether CoACD made them.
    """

    shapes: list[Shape | Vector]
    X_LG: RigidTransform
    M_LLo_L: SpatialInertia
    low: Vector
    high: Vector
    contact: ET.Element | None = None
    fit: Fit | None = None
    cut: bool = False


class MeshReader:
    """Reads each mesh of an object once.

    Args:
        warnings: Receives what is mended.
    """

    def __init__(self, warnings: list[str]) -> None:
        self.warnings = warnings
        self._read: dict[tuple[Path, tuple[float, ...]], list[ColoredMesh]] = {}

    def meshes(self, geometry: Geometry) -> list[ColoredMesh]:
        """Return the meshes of a geometry in the link, with their colours.

        Raises:
            ScenarioError: If a mesh is broken.
        """
        shape = geometry.shape
        assert isinstance(shape, MeshFile)
        key = (shape.path, tuple(shape.scale))
        if key not in self._read:
            self._read[key] = read_mesh(shape.path, shape.scale, self.warnings)
        moved = [(mesh.copy(), color) for mesh, color in self._read[key]]
        for mesh, _ in moved:
            mesh.apply_transform(geometry.X_LG.GetAsMatrix4())
        return moved


def parts_of(geometry: Geometry, reader: MeshReader, most: int) -> list[Part]:
    """Return the parts of a collision geometry.

    Args:
        geometry: The geometry.
        reader: Of its meshes.
        most: Greatest number of pieces per mesh.
    """
    if isinstance(geometry.shape, MeshFile):
        meshes = [mesh for mesh, _ in reader.meshes(geometry)]
        return [_mesh_part(m, geometry, reader.warnings, most) for m in meshes]
    X_LG, R_LG = geometry.X_LG, geometry.X_LG.rotation()
    M_G = _unit_density(geometry.shape)
    M_L = M_G.ReExpress(R_LG).Shift(-X_LG.translation())
    reach = np.array([geometry.shape.half_extent(row) for row in R_LG.matrix()])
    low, high = X_LG.translation() - reach, X_LG.translation() + reach
    return [Part([geometry.shape], X_LG, M_L, low, high, geometry.contact)]


def _mesh_part(
    mesh: TriangleMesh, geometry: Geometry, warnings: list[str], most: int
) -> Part:
    pieces, cut = convex_pieces(mesh, most, warnings)
    openness = describe_openness(mesh)
    if openness:
        warnings.append(
            f"the mesh is {openness}: it counts as solid, with the volume of its pieces"
        )
        hull = require_trimesh().convex.convex_hull
        solids = [_mesh_inertia(hull(corners)) for corners in pieces]
    else:
        solids = [_mesh_inertia(mesh)]
    points = np.vstack(pieces)
    return Part(
        list(pieces),
        RigidTransform(),
        total(solids),
        points.min(axis=0),
        points.max(axis=0),
        geometry.contact,
        measure_fit(mesh, pieces),
        cut,
    )


def total(solids: list[SpatialInertia]) -> SpatialInertia:
    """Return the sum of spatial inertias about one point."""
    whole = SpatialInertia.Zero()
    for solid in solids:
        whole += solid
    return whole


def _mesh_inertia(mesh: TriangleMesh) -> SpatialInertia:
    """Return the spatial inertia of a closed mesh about its origin at 1 kg/m³."""
    I = np.asarray(mesh.moment_inertia)  # noqa: E741 # about the centre of mass
    central = RotationalInertia(I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])
    return SpatialInertia.MakeFromCentralInertia(
        float(mesh.volume), np.asarray(mesh.center_mass), central
    )


def _unit_density(shape: Shape) -> SpatialInertia:
    match shape:
        case Cylinder(radius, length):
            z = [0.0, 0.0, 1.0]
            return SpatialInertia.SolidCylinderWithDensity(1.0, radius, length, z)
        case Box(size):
            return SpatialInertia.SolidBoxWithDensity(1.0, *size)
        case Sphere(radius):
            return SpatialInertia.SolidSphereWithDensity(1.0, radius)
