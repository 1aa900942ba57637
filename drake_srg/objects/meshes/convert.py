"""Conversion of an object's geometry to a checked SDF of convex pieces."""

from __future__ import annotations

import dataclasses as dc
import json
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.tree import RotationalInertia, SpatialInertia

from drake_srg.objects.meshes.files import (
    Color,
    Contents,
    Geometry,
    MeshFile,
    ReadMesh,
    TriangleMesh,
    check_size,
    describe_openness,
    read_mesh,
    require_trimesh,
)
from drake_srg.objects.meshes.pieces import (
    MOST_CORNERS,
    TOLERANCE,
    Fit,
    convex_pieces,
    measure_fit,
)
from drake_srg.objects.sdf import (
    DRAKE,
    AddChild,
    AddContact,
    AddInertial,
    AddPose,
    facet_length,
)
from drake_srg.types import Box, Cylinder, Shape, Sphere, Vector


@dc.dataclass(frozen=True, eq=False)
class Part:
    """A collision geometry of the link L.

    Attributes:
        shapes: A primitive, or the corners of convex pieces in L, each (n, 3) [m].
        X_LG: Pose of the primitive.
        M_LLo_L: Spatial inertia about L's origin at 1 kg/m³: its mass is the volume.
        low: Least coordinates in L [m].
        high: Greatest coordinates in L [m].
        source: The geometry, for its contact properties.
        fit: Fit of the pieces to their mesh; None for a primitive.
        cut: Whether CoACD made the pieces.
    """

    shapes: list[Shape | Vector]
    X_LG: RigidTransform
    M_LLo_L: SpatialInertia
    low: Vector
    high: Vector
    source: Geometry
    fit: Fit | None = None
    cut: bool = False


class MeshReader:
    """Reads each mesh of an object once.

    Args:
        warnings: Receives the mended defects.
    """

    def __init__(self, warnings: list[str]) -> None:
        self.warnings = warnings
        self._read: dict[tuple[Path, tuple[float, ...]], ReadMesh] = {}

    def solid(self, geometry: Geometry) -> TriangleMesh:
        """Return the whole mesh of a geometry, in the link's frame.

        Raises:
            ScenarioError: If a mesh is broken.
        """
        return self._placed(self._mesh(geometry).solid, geometry)

    def surfaces(self, geometry: Geometry) -> list[tuple[TriangleMesh, Color | None]]:
        """Return the surfaces of a geometry by colour, in the link's frame.

        Raises:
            ScenarioError: If a mesh is broken.
        """
        surfaces = self._mesh(geometry).surfaces
        return [(self._placed(mesh, geometry), color) for mesh, color in surfaces]

    def _mesh(self, geometry: Geometry) -> ReadMesh:
        shape = geometry.shape
        assert isinstance(shape, MeshFile)
        key = (shape.path, tuple(shape.scale))
        if key not in self._read:
            self._read[key] = read_mesh(shape, self.warnings)
        return self._read[key]

    def _placed(self, mesh: TriangleMesh, geometry: Geometry) -> TriangleMesh:
        moved = mesh.copy()
        moved.apply_transform(geometry.X_LG.GetAsMatrix4())
        return moved


def part_of(geometry: Geometry, reader: MeshReader, most: int) -> Part:
    """Return a collision geometry as a part: a primitive, or convex pieces.

    Args:
        geometry: The geometry.
        reader: Reader of its meshes.
        most: Greatest number of pieces per mesh.
    """
    if isinstance(geometry.shape, MeshFile):
        return _mesh_part(geometry, reader, most)
    X_LG, R_LG = geometry.X_LG, geometry.X_LG.rotation()
    M_G = unit_density(geometry.shape)
    M_L = M_G.ReExpress(R_LG).Shift(-X_LG.translation())
    reach = np.array([geometry.shape.half_extent(row) for row in R_LG.matrix()])
    low, high = X_LG.translation() - reach, X_LG.translation() + reach
    return Part([geometry.shape], X_LG, M_L, low, high, geometry)


def _mesh_part(geometry: Geometry, reader: MeshReader, most: int) -> Part:
    mesh, warnings = reader.solid(geometry), reader.warnings
    pieces, cut = convex_pieces(mesh, most, warnings)
    openness = describe_openness(mesh)
    if openness:
        warnings.append(
            f"the mesh is {openness}: it counts as solid, with the volume of its pieces"
        )
        hull = require_trimesh().convex.convex_hull
        solids = [mesh_inertia(hull(corners)) for corners in pieces]
    else:
        solids = [mesh_inertia(mesh)]
    points = np.vstack(pieces)
    return Part(
        list(pieces),
        RigidTransform(),
        total(solids),
        points.min(axis=0),
        points.max(axis=0),
        geometry,
        measure_fit(mesh, pieces),
        cut,
    )


def total(solids: list[SpatialInertia]) -> SpatialInertia:
    """Return the sum of spatial inertias about one point."""
    whole = SpatialInertia.Zero()
    for solid in solids:
        whole += solid
    return whole


def mesh_inertia(mesh: TriangleMesh) -> SpatialInertia:
    """Return the spatial inertia of a closed mesh about its origin at 1 kg/m³."""
    I = np.asarray(mesh.moment_inertia)  # noqa: E741 # about the centre of mass
    central = RotationalInertia(I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])
    return SpatialInertia.MakeFromCentralInertia(
        float(mesh.volume), np.asarray(mesh.center_mass), central
    )


def unit_density(shape: Shape) -> SpatialInertia:
    """Return the spatial inertia of a shape about its centre at 1 kg/m³."""
    match shape:
        case Cylinder(radius, length):
            z = [0.0, 0.0, 1.0]
            return SpatialInertia.SolidCylinderWithDensity(1.0, radius, length, z)
        case Box(size):
            return SpatialInertia.SolidBoxWithDensity(1.0, *size)
        case Sphere(radius):
            return SpatialInertia.SolidSphereWithDensity(1.0, radius)


REPORT, MODEL = "import.json", "model.sdf"
DENSITY = 500.0  # of objects without a mass, as of packed food [kg/m³]
_GREY = (0.7, 0.7, 0.7)
# Moments of inertia that differ from the geometry's by more than this factor are
# placeholders.
_PLAUSIBLE = 5.0
_CREASE = 0.7  # edges with larger angles look sharp [rad]
# Hint for the case that more pieces would not help.
_ROUND = (
    f"each piece has {MOST_CORNERS} corners at most; a sphere or a cylinder of an SDF "
    "is exact"
)
_NEAR = 0.001  # an origin this close to the underside is underneath the object [m]


@dc.dataclass(frozen=True)
class Report:
    """Results of an import.

    Attributes:
        size: Extents of the pieces along x, y, z [m].
        mass: Mass of the model [kg].
        volume: Volume of closed meshes, and of the pieces of open ones [m³].
        pieces: Number of collision geometries.
        cut: Whether CoACD made some of the pieces.
        excess: Largest distance by which pieces stand out of their mesh [m].
        gap: Largest distance by which meshes stand out of their pieces [m].
        warnings: Defects that were mended, and assumptions.
    """

    size: list[float]
    mass: float
    volume: float
    pieces: int
    cut: bool
    excess: float
    gap: float
    warnings: list[str]


def read_report(folder: Path) -> Report:
    """Return the report of a folder that `convert` filled."""
    return Report(**json.loads((folder / REPORT).read_text(encoding="utf-8")))


def convert(contents: Contents, most: int, folder: Path) -> None:
    """Write model, meshes and report of an object into a folder.

    Args:
        contents: Contents of the object's file.
        most: Greatest number of pieces per mesh.
        folder: An empty folder.

    Raises:
        ScenarioError: If a mesh is broken.
        ImportError: If a package of the extra `import` is missing.
    """
    reader = MeshReader(list(contents.warnings))
    warnings = reader.warnings
    parts = [part_of(geometry, reader, most) for geometry in contents.collisions]
    low = np.min([part.low for part in parts], axis=0)
    high = np.max([part.high for part in parts], axis=0)
    p_LO = _origin(parts, low, high, warnings)
    volume = total([part.M_LLo_L for part in parts])
    inertia = _inertia(contents, volume, (low, high), warnings)
    check_size(contents.path, low, high)
    fits = [part.fit for part in parts if part.fit is not None]
    excess = max((fit.excess for fit in fits), default=0.0)
    gap = max((fit.gap for fit in fits), default=0.0)
    full = any(part.cut and len(part.shapes) >= most for part in parts)
    advice = "try more pieces" if full else _ROUND
    for what, value in (
        ("pieces stand out of the mesh", excess),
        ("the mesh stands out of its pieces", gap),
    ):
        if value > TOLERANCE:
            warnings.append(
                f"{what} by up to {1e3 * value:.1f} mm, more than "
                f"{1e3 * TOLERANCE:.0f} mm ({advice})"
            )
    root = ET.Element("sdf", {"version": "1.9"})
    link = AddChild(AddChild(root, "model", name="object"), "link", name="object")
    AddInertial(link, inertia.Shift(p_LO))
    AddVisuals(link, contents, reader, p_LO, folder)
    shapes = [(shape, part) for part in parts for shape in part.shapes]
    for i, (shape, part) in enumerate(shapes):
        node = AddChild(link, "collision", name=f"piece_{i}")
        if isinstance(shape, np.ndarray):
            hull = require_trimesh().convex.convex_hull(shape - p_LO)
            mesh = AddMesh(node, folder / f"piece_{i}.obj", hull)
            AddChild(mesh, f"{{{DRAKE}}}declare_convex")
        else:
            AddPrimitive(node, shape, part.X_LG, p_LO)
        radius = getattr(shape, "radius", None)
        AddContact(
            node,
            None if radius is None else facet_length(radius),
            part.source.friction,
            part.source.contact,
        )
    report = Report(
        size=(high - low).tolist(),
        mass=inertia.get_mass(),
        volume=volume.get_mass(),
        pieces=len(shapes),
        cut=any(part.cut for part in parts),
        excess=excess,
        gap=gap,
        warnings=list(dict.fromkeys(warnings)),
    )
    ET.indent(root, "  ")
    model = ET.tostring(root, encoding="unicode")
    (folder / MODEL).write_text(model + "\n", encoding="utf-8")
    text = json.dumps(dc.asdict(report), indent=2)
    (folder / REPORT).write_text(text + "\n", encoding="utf-8")


def _origin(
    parts: Sequence[Part], low: Vector, high: Vector, warnings: list[str]
) -> Vector:
    """Return the object's origin in the link, p_LO (3,) [m].

    It is the centre of a single primitive, otherwise a point at the underside.
    """
    if len(parts) == 1 and not isinstance(parts[0].shapes[0], np.ndarray):
        X_LG = parts[0].X_LG
        if X_LG.rotation().IsNearlyIdentity():
            return X_LG.translation()
    below = bool(np.all(low[:2] < 0.0) and np.all(high[:2] > 0.0))
    if below and abs(low[2]) <= _NEAR:
        return np.array([0.0, 0.0, low[2]])
    x, y = 0.5 * (low + high)[:2]
    p_LO = np.array([x, y, low[2]])
    text = ", ".join(f"{value:.4g}" for value in p_LO)
    warnings.append(f"moved the origin to the middle of the underside, ({text}) m")
    return p_LO


def _inertia(
    contents: Contents,
    volume: SpatialInertia,
    bounds: tuple[Vector, Vector],
    warnings: list[str],
) -> SpatialInertia:
    """Return the spatial inertia of the link about its origin.

    Args:
        contents: Contents of the file, which may have an inertia.
        volume: Inertia of the geometry at 1 kg/m³.
        bounds: Least and greatest coordinates of the geometry.
        warnings: Receives replacements and assumptions.
    """
    mass = contents.mass
    if mass is None:
        mass = DENSITY * volume.get_mass()
        warnings.append(
            f"no mass in the file: assumed {mass:.4g} kg unless you set it "
            f"({DENSITY:.0f} kg/m³ over {1e6 * volume.get_mass():.4g} cm³)"
        )
    geometry = SpatialInertia(mass, volume.get_com(), volume.get_unit_inertia())
    if contents.inertia is None:
        if contents.mass is not None:
            warnings.append("no possible moments of inertia: took the geometry's")
        return geometry
    ours, file = _central_moments(geometry), _central_moments(contents.inertia)
    com = contents.inertia.get_com()
    inside = np.all(bounds[0] <= com) and np.all(com <= bounds[1])
    if inside and np.all(np.abs(np.log(file / ours)) < np.log(_PLAUSIBLE)):
        return contents.inertia
    warnings.append(
        "replaced implausible inertia: principal moments "
        f"{_listed(file)} kg m², the geometry's are {_listed(ours)} kg m²"
    )
    return geometry


def _central_moments(M: SpatialInertia) -> Vector:
    """Return the principal moments about the centre of mass, sorted, (3,) [kg m²]."""
    central = M.Shift(M.get_com()).CalcRotationalInertia()
    return np.sort(np.linalg.eigvalsh(central.CopyToFullMatrix3()))


def _listed(values: Vector) -> str:
    return ", ".join(f"{value:.2g}" for value in values)


def AddVisuals(
    link: ET.Element,
    contents: Contents,
    reader: MeshReader,
    p_LO: Vector,
    folder: Path,
    name: str = "visual",
) -> None:
    """Append the visuals of a link, and write their meshes.

    Args:
        link: The element.
        contents: Contents of the link.
        reader: Reader of its meshes.
        p_LO: The element's origin in the link [m], shape (3,).
        folder: Folder for the meshes.
        name: Start of the names of visuals and files.
    """
    count = 0
    for geometry in contents.visuals:
        if not isinstance(geometry.shape, MeshFile):
            node = AddChild(link, "visual", name=f"{name}_{count}")
            AddPrimitive(node, geometry.shape, geometry.X_LG, p_LO)
            _AddColor(node, geometry.color or _GREY)
            count += 1
            continue
        for mesh, color in reader.surfaces(geometry):
            node = AddChild(link, "visual", name=f"{name}_{count}")
            mesh.apply_translation(-p_LO)
            AddMesh(node, folder / f"{name}_{count}.obj", mesh)
            _AddColor(node, geometry.color or color or _GREY)
            count += 1


def _AddColor(visual: ET.Element, color: Sequence[float]) -> None:
    AddChild(AddChild(visual, "material"), "diffuse", [*color, 1.0])


def AddPrimitive(
    parent: ET.Element, shape: Shape | Vector, X_LG: RigidTransform, p_LO: Vector
) -> None:
    """Append pose and geometry of a primitive; see `AddVisuals`."""
    AddPose(parent, X_LG.translation() - p_LO, RollPitchYaw(X_LG.rotation()).vector())
    geometry = AddChild(parent, "geometry")
    match shape:
        case Cylinder(radius, length):
            cylinder = AddChild(geometry, "cylinder")
            AddChild(cylinder, "radius", radius)
            AddChild(cylinder, "length", length)
        case Box(size):
            AddChild(AddChild(geometry, "box"), "size", size)
        case Sphere(radius):
            AddChild(AddChild(geometry, "sphere"), "radius", radius)


def AddMesh(parent: ET.Element, path: Path, mesh: TriangleMesh) -> ET.Element:
    """Write a mesh to a file, and append a geometry that names it."""
    shaded = require_trimesh().graph.smooth_shade(mesh, angle=_CREASE)
    lines = [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in shaded.vertices]
    lines += [f"vn {x:.3f} {y:.3f} {z:.3f}" for x, y, z in shaded.vertex_normals]
    corners = [[f"{k}//{k}" for k in face] for face in np.asarray(shaded.faces) + 1]
    lines += ["f " + " ".join(face) for face in corners]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    node = AddChild(AddChild(parent, "geometry"), "mesh")
    AddChild(node, "uri", path.name)
    return node
