"""What holds an object: contact patches with their normal forces and friction."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Collection

import numpy as np
from pydrake.geometry import ContactSurface, GeometryId, SceneGraphInspector
from pydrake.multibody.plant import (
    ContactResults,
    HydroelasticContactInfo,
    PointPairContactInfo,
)

from drake_srg.types import Vector

# Friction where a geometry has none [-]: Drake's own default.
_NO_FRICTION = 0.0


@dc.dataclass(frozen=True, eq=False)
class Patch:
    """The contact of one geometry of the hand with the object.

    Attributes:
        p_W: Points that stand for parts of its area, shape (n, 3) [m].
        n_W: Unit normals there, into the object, shape (n, 3).
        normal_force: Of each part, shape (n,) [N].
        friction: Coefficient of the pair.
        f_W: The total force on the object, shape (3,) [N].
    """

    p_W: Vector
    n_W: Vector
    normal_force: Vector
    friction: float
    f_W: Vector

    @property
    def centroid(self) -> Patch:
        """The patch as a single point: its center of pressure."""
        share = self.normal_force / self.normal_force.sum()
        n_W = share @ self.n_W
        return dc.replace(
            self,
            p_W=(share @ self.p_W)[None],
            n_W=(n_W / np.linalg.norm(n_W))[None],
            normal_force=self.normal_force.sum(keepdims=True),
        )


def contact_patches(
    results: ContactResults,
    inspector: SceneGraphInspector,
    *,
    thing: Collection[GeometryId],
    hand: Collection[GeometryId],
    points: int = 5,
) -> list[Patch]:
    """Return the contacts of a hand with an object.

    Args:
        results: Value of the plant's output port `contact_results`.
        inspector: Knows the geometries' friction.
        thing: Collision geometries of the object.
        hand: Collision geometries of the hand.
        points: Largest number of points of a patch, 1 or 5.
    """
    found: list[Patch | None] = []
    for k in range(results.num_hydroelastic_contacts()):
        info = results.hydroelastic_contact_info(k)
        surface = info.contact_surface()
        pair = (surface.id_M(), surface.id_N())
        sign = _side(pair, thing, hand)
        if sign:
            mu = combined_friction(inspector, *pair)
            found.append(_hydroelastic(info, sign, mu, points))
    for k in range(results.num_point_pair_contacts()):
        point = results.point_pair_contact_info(k)
        pair = (point.point_pair().id_A, point.point_pair().id_B)
        sign = _side(pair, thing, hand)
        if sign:
            found.append(_point(point, sign, combined_friction(inspector, *pair)))
    return [patch for patch in found if patch is not None]


def combined_friction(
    inspector: SceneGraphInspector, a: GeometryId, b: GeometryId
) -> float:
    """Return the friction of two geometries, combined as Drake does."""
    values = []
    for geometry in (a, b):
        properties = inspector.GetProximityProperties(geometry)
        if not properties.HasProperty("material", "coulomb_friction"):
            return _NO_FRICTION
        friction = properties.GetProperty("material", "coulomb_friction")
        values.append(float(friction.dynamic_friction()))
    total = sum(values)
    return 2.0 * values[0] * values[1] / total if total else 0.0


def _side(
    pair: tuple[GeometryId, GeometryId],
    thing: Collection[GeometryId],
    hand: Collection[GeometryId],
) -> float:
    """Return 1 for a pair of thing and hand, -1 for hand and thing, else 0."""
    first, second = pair
    if first in thing and second in hand:
        return 1.0
    return -1.0 if second in thing and first in hand else 0.0


def _hydroelastic(
    info: HydroelasticContactInfo, sign: float, mu: float, points: int
) -> Patch | None:
    surface: ContactSurface = info.contact_surface()
    triangles = surface.is_triangle()
    mesh = surface.tri_mesh_W() if triangles else surface.poly_mesh_W()
    field = surface.tri_e_MN() if triangles else surface.poly_e_MN()
    faces = range(surface.num_faces())
    p = np.array([mesh.element_centroid(i) for i in faces])
    # Drake's normals point out of N into M.
    n = sign * np.array([surface.face_normal(i) for i in faces])
    pressure = [field.EvaluateCartesian(i, p[i]) for i in faces]
    force = np.array([surface.area(i) for i in faces]) * np.maximum(pressure, 0.0)
    if force.sum() <= 0.0:
        return None
    p, n, force = merged(p, n, force, points)
    f_W = sign * info.F_Ac_W().translational()
    return Patch(p, n, force, mu, np.array(f_W))


def _point(info: PointPairContactInfo, sign: float, mu: float) -> Patch | None:
    # Drake reports the force on B, and its normal points from B into A.
    n = sign * np.array(info.point_pair().nhat_BA_W)
    f_W = -sign * np.array(info.contact_force())
    force = float(n @ f_W)
    if force <= 0.0:
        return None
    p = np.array(info.contact_point())
    return Patch(p[None], n[None], np.array([force]), mu, f_W)


def merged(
    p: Vector, n: Vector, force: Vector, points: int
) -> tuple[Vector, Vector, Vector]:
    """Merge the faces of a patch around few points: its middle and four ends.

    The ends are the faces that lie farthest along the principal directions of the
    pressure. Every face adds its force to the nearest point, and the point moves to the
    center of pressure of its faces, so that force and moment of the normals remain.

    Args:
        p: Middles of the faces, shape (n, 3) [m].
        n: Unit normals, shape (n, 3).
        force: Normal forces, shape (n,) [N], some above 0.
        points: 1 or 5.

    Returns:
        The same for the points, of which those without force are left out.
    """
    share = force / force.sum()
    middle = share @ p
    seeds = [middle]
    if points > 1 and len(p) > 1:
        away = (p - middle) * np.sqrt(share)[:, None]
        directions = np.linalg.svd(away, full_matrices=False)[2][:2]
        along = (p - middle) @ directions.T
        # Halfway, so that every point gets a part of the area.
        ends = [*along.argmin(axis=0), *along.argmax(axis=0)]
        seeds += [middle + 2 / 3 * (p[i] - middle) for i in ends]
    distance = np.linalg.norm(p[:, None] - np.array(seeds), axis=2)
    nearest = distance.argmin(axis=1)
    kept = []
    for k in range(len(seeds)):
        mine = (nearest == k) & (force > 0.0)
        if mine.any():
            total = force[mine].sum()
            normal = force[mine] @ n[mine]
            normal /= np.linalg.norm(normal)
            kept.append((force[mine] @ p[mine] / total, normal, total))
    where, normals, forces = (np.array(values) for values in zip(*kept, strict=True))
    return where, normals, forces
