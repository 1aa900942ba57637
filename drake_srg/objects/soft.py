"""Soft objects: boxes of deformable finite elements.

A soft object has vertices and no pose. Its pose is defined as the rigid motion nearest
to the motion of its vertices.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from pydrake.common import MemoryFile
from pydrake.geometry import (
    AddContactMaterial,
    GeometryInstance,
    IllustrationProperties,
    InMemoryMesh,
    Mesh,
    PerceptionProperties,
    ProximityProperties,
    Rgba,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.fem import DeformableBodyConfig
from pydrake.multibody.plant import (
    CoulombFriction,
    DiscreteContactApproximation,
    MultibodyPlant,
)
from pydrake.multibody.tree import ModelInstanceIndex

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.config import ObjectConfig
from drake_srg.types import Box, Vector

# The faces of a unit cell: corners in order, counterclockwise as seen from outside.
_FACES = np.array(
    [
        [[0, 0, 0], [0, 0, 1], [0, 1, 1], [0, 1, 0]],
        [[1, 0, 0], [1, 1, 0], [1, 1, 1], [1, 0, 1]],
        [[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]],
        [[0, 1, 0], [0, 1, 1], [1, 1, 1], [1, 1, 0]],
        [[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0]],
        [[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]],
    ]
)


def box_mesh(
    size: npt.ArrayLike, resolution: float
) -> tuple[Vector, npt.NDArray[np.int64]]:
    """Fill a box around the origin with tetrahedra.

    The box is cut into cells, and each cell into twelve tetrahedra, from its centre to
    the two halves of each face. So every tetrahedron has a vertex inside the box. Drake
    needs this to compute how deeply something penetrates a deformable body.

    Args:
        size: Extents along x, y, z [m].
        resolution: Longest edge of the cells [m].

    Returns:
        Vertices, shape (n, 3) [m], and the four vertices' indices of each tetrahedron,
        shape (m, 4), ordered so that its volume is positive.
    """
    size = np.asarray(size, dtype=float)
    counts = np.maximum(np.ceil(size / resolution - 1e-9), 1).astype(int)
    corners, cells = (
        np.array(list(np.ndindex(*n.tolist()))) for n in (counts + 1, counts)
    )
    vertices = np.vstack([corners, cells + 0.5]) / counts * size - 0.5 * size
    tetrahedra = []
    for center, cell in enumerate(cells, len(corners)):
        for face in _FACES + cell:
            # The diagonal joins corners whose indices have an even sum, so both cells
            # cut their common face in the same way.
            a, b, c, d = np.roll(face, -(face[0].sum() % 2), axis=0)
            for triangle in ((a, b, c), (a, c, d)):
                numbers = np.ravel_multi_index(np.transpose(triangle), counts + 1)
                tetrahedra.append([center, *numbers])
    return vertices, np.array(tetrahedra)


def vtk_text(vertices: Vector, tetrahedra: npt.NDArray[np.int64]) -> str:
    """Return a mesh of `box_mesh` as the text of a legacy VTK file."""

    def lines(rows: npt.NDArray[np.generic]) -> str:
        return "\n".join(" ".join(map(repr, row)) for row in rows.tolist())

    n, m = len(vertices), len(tetrahedra)
    return (
        "# vtk DataFile Version 3.0\ntetrahedra\nASCII\nDATASET UNSTRUCTURED_GRID\n"
        f"POINTS {n} double\n{lines(vertices)}\n"
        f"CELLS {m} {5 * m}\n{lines(np.insert(tetrahedra, 0, 4, axis=1))}\n"
        f"CELL_TYPES {m}\n{lines(np.full((m, 1), 10))}\n"  # 10: VTK_TETRA
    )


# In tests, a hand held a soft cube with steps of 5 ms, and lost it with 10 ms. With
# `lagged`, an untouched sponge jumps around on its table, and Drake reports no error.
_LARGEST_STEP = 0.005  # s
_APPROXIMATION = DiscreteContactApproximation.kSap


def AddSoftObject(
    plant: MultibodyPlant, name: str, config: ObjectConfig
) -> ModelInstanceIndex:
    """Add a soft object to a plant that is not finalized, as model instance `name`.

    Raises:
        ScenarioError: If the plant's settings do not suit soft bodies, or the shape is
            not a box.
        ValueError: If `soft`, `mass` or `friction` is missing.
    """
    soft, key = config.soft, f"objects.{name}.soft"
    if soft is None or config.mass is None or config.friction is None:
        raise ValueError("A soft object needs soft, mass and friction.")
    if not isinstance(config.shape, Box):
        raise ScenarioError(f"{key}: needs a shape (allowed: !Box)")
    if not 0.0 < plant.time_step() <= _LARGEST_STEP:
        raise ScenarioError(
            f"{key}: needs a plant_config.time_step above 0 and up to {_LARGEST_STEP} "
            f"s, got {plant.time_step():g} s"
        )
    if plant.get_discrete_contact_approximation() != _APPROXIMATION:
        raise ScenarioError(
            f"{key}: needs plant_config.discrete_contact_approximation: sap, because "
            "soft objects move by themselves with the others"
        )
    size = config.shape.size
    resolution = config.resolution or 0.25 * min(size)
    text = vtk_text(*box_mesh(size, resolution))
    mesh = Mesh(InMemoryMesh(mesh_file=MemoryFile(text, ".vtk", name)))
    body = DeformableBodyConfig()
    body.set_youngs_modulus(soft.youngs_modulus)
    body.set_poissons_ratio(soft.poissons_ratio)
    body.set_mass_density(config.mass / float(np.prod(size)))
    body.set_stiffness_damping_coefficient(soft.damping)
    geometry = GeometryInstance(RigidTransform(), mesh, name)
    proximity = ProximityProperties()
    friction = CoulombFriction(config.friction, config.friction)
    AddContactMaterial(properties=proximity, friction=friction)
    # The sum of Drake's defaults for two surfaces [s], because the other may have 0.
    # This contact is nearly rigid: with half of the sum, a box bounces off a sponge.
    proximity.AddProperty("material", "relaxation_time", 0.2)
    geometry.set_proximity_properties(proximity)
    illustration, perception = IllustrationProperties(), PerceptionProperties()
    for properties in (illustration, perception):
        properties.AddProperty("phong", "diffuse", Rgba(*config.color, 1.0))
    geometry.set_illustration_properties(illustration)
    geometry.set_perception_properties(perception)
    model = plant.AddModelInstance(name)
    # The resolution hint matters only for shapes that Drake meshes itself.
    plant.mutable_deformable_model().RegisterDeformableBody(
        geometry, model, body, resolution_hint=1.0
    )
    return model


def nearest_pose(p_RV: Vector, p_WV: Vector) -> RigidTransform:
    """Return the pose X_WR that brings reference positions nearest to present ones.

    It minimises the sum of squared distances, by the singular value decomposition of
    Arun, Huang and Blostein (1987), IEEE T-PAMI 9(5).

    Args:
        p_RV: Undeformed vertices in the object's frame, shape (3, n) [m].
        p_WV: The same vertices now, in world, shape (3, n) [m].
    """
    middle_R, middle_W = p_RV.mean(axis=1), p_WV.mean(axis=1)
    cross = (p_WV - middle_W[:, None]) @ (p_RV - middle_R[:, None]).T
    u, _, vt = np.linalg.svd(cross)
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    R_WR = RotationMatrix.ProjectToRotationMatrix(u @ mirror @ vt)
    return RigidTransform(R_WR, middle_W - R_WR @ middle_R)
