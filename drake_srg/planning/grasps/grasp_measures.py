"""Measures of how well contact patches hold an object.

Wrenches are about the object's center of mass. Moments are divided by the object's
size (its greatest distance from that center), so that force and moment have one unit
(Roa and Suárez, Autonomous Robots 38:65, 2015, section 2.3).
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np
from pydrake.geometry import ContactSurface, GeometryId, SceneGraphInspector
from pydrake.multibody.plant import (
    ContactResults,
    HydroelasticContactInfo,
    PointPairContactInfo,
)
from pydrake.solvers import ClpSolver, MathematicalProgram

from drake_srg.types import Vector

# Friction where a geometry has none [-]: Drake's own default.
_NO_FRICTION = 0.0


@dc.dataclass(frozen=True, eq=False)
class Patch:
    """The contact of one geometry of the hand with the object.

    Attributes:
        p_W: Points that represent parts of its area, shape (n, 3) [m].
        n_W: Unit normals there, into the object, shape (n, 3).
        normal_force: Normal force of each part, shape (n,) [N].
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
        inspector: Source of the geometries' friction.
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
    """Return 1 for the pair (object, hand), -1 for (hand, object), else 0."""
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
    """Merge the faces of a patch around five points: its centre and four ends.

    The ends are the faces that lie farthest along the principal directions of the
    pressure. Every face adds its force to the nearest point, and the point moves to the
    center of pressure of its faces, so that force and moment of the normals remain.

    Args:
        p: Middles of the faces, shape (n, 3) [m].
        n: Unit normals, shape (n, 3).
        force: Normal forces, shape (n,) [N], at least one above 0.
        points: 1 or 5.

    Returns:
        The same for the points; points without force are omitted.
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


_EDGES = 8  # of the pyramids that approximate friction cones
_GRAVITY = 9.81  # m/s²
# No machine in a laboratory accelerates a hand more than this [m/s²].
MOST_ACCELERATION = 1000.0


@dc.dataclass(frozen=True, eq=False)
class Body:
    """The object in the hand.

    Attributes:
        mass: [kg].
        p_WB: Its center of mass, shape (3,) [m].
        size: Its greatest distance from its center of mass [m].
        g_W: Gravity, shape (3,) [m/s²].
    """

    mass: float
    p_WB: Vector
    size: float
    g_W: Vector = dc.field(default_factory=lambda: np.array([0.0, 0.0, -_GRAVITY]))


def cone_wrenches(patches: Sequence[Patch], body: Body) -> Vector:
    """Return the wrenches of the edges of all friction cones.

    Each wrench is that of a normal force of 1 N.

    Returns:
        Force [N] and moment over size [N], shape (points, edges, 6).
    """
    p, n, mu = _points(patches)
    # Any two unit vectors across the normal: the axis of its smallest entry is far from
    # it.
    axis = np.eye(3)[np.abs(n).argmin(axis=1)]
    first = np.cross(n, axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(n, first)
    angle = 2.0 * np.pi * np.arange(_EDGES) / _EDGES
    across = (
        np.cos(angle)[:, None] * first[:, None]
        + np.sin(angle)[:, None] * second[:, None]
    )
    force = n[:, None] + mu[:, None, None] * across
    moment = np.cross((p - body.p_WB)[:, None], force) / body.size
    return np.concatenate([force, moment], axis=2)


def _points(patches: Sequence[Patch]) -> tuple[Vector, Vector, Vector]:
    p = np.concatenate([patch.p_W for patch in patches])
    n = np.concatenate([patch.n_W for patch in patches])
    mu = np.concatenate([np.full(len(q.p_W), q.friction) for q in patches])
    return p, n, mu


@dc.dataclass(frozen=True)
class WrenchSpace:
    """The convex hull of the wrenches that the contacts can exert.

    Attributes:
        epsilon: Radius of the largest ball about the origin inside it; 0 without force
            closure (Ferrari and Canny, ICRA 1992).
        volume: Its volume; 0 if it is flat (Miller and Allen, ICRA 1999).
    """

    epsilon: float = 0.0
    volume: float = 0.0

    @property
    def closed(self) -> bool:
        """Whether the grasp has force closure (Nguyen, IJRR 7:3, 1988)."""
        return self.epsilon > 0.0


def wrench_space(
    patches: Sequence[Patch], body: Body, *, weighted: bool = False
) -> WrenchSpace:
    """Return the wrench space of a grasp.

    Args:
        patches: Contacts; the `centroid` of each gives the measure of textbooks.
        body: The object.
        weighted: Whether each point presses with its present normal force, in units of
            the object's weight, instead of with 1 (Krug et al., ICRA 2017).
    """
    from scipy.spatial import ConvexHull, QhullError

    if not patches:
        return WrenchSpace()
    wrenches = cone_wrenches(patches, body)
    if weighted:
        force = np.concatenate([patch.normal_force for patch in patches])
        wrenches = wrenches * (force / (body.mass * _GRAVITY))[:, None, None]
    points = wrenches.reshape(-1, 6)
    if np.linalg.matrix_rank(points - points[0]) < 6:  # flat, or too few points
        return WrenchSpace()
    # Pads are flat, so many points share a facet. Moving all a little ("QJ") takes half
    # of the time of merging facets.
    try:
        hull = ConvexHull(points, qhull_options="QJ")
    except QhullError:  # nearly flat
        return WrenchSpace()
    epsilon = float(np.min(-hull.equations[:, -1]))
    return WrenchSpace(max(epsilon, 0.0), float(hull.volume))


def resisted_acceleration(patches: Sequence[Patch], body: Body) -> float:
    """Return the acceleration that the grasp withstands in six directions [m/s²].

    For each of ±x, ±y and ±z, a linear program finds the greatest acceleration of the
    hand at which forces in the friction cones carry the object along. No patch presses
    harder than now (the bound of Krug et al., ICRA 2017, for motors at their limit).
    The result is the least of the six, or 0 if the grasp cannot even carry the weight.
    """
    if not patches:
        return 0.0
    wrenches = cone_wrenches(patches, body).reshape(-1, 6)
    owner = np.repeat(
        np.arange(len(patches)), [_EDGES * len(patch.p_W) for patch in patches]
    )
    bound = np.array([patch.normal_force.sum() for patch in patches])
    presses = (owner == np.arange(len(patches))[:, None]).astype(float)
    most = MOST_ACCELERATION
    for direction in np.concatenate([np.eye(3), -np.eye(3)]):
        program = MathematicalProgram()
        force = program.NewContinuousVariables(len(wrenches))
        a = program.NewContinuousVariables(1)
        # Each variable is the normal force along one edge of a cone [N].
        pull = np.concatenate([direction, np.zeros(3)]) * body.mass
        weight = np.concatenate([body.g_W, np.zeros(3)]) * body.mass
        program.AddLinearEqualityConstraint(
            np.column_stack([wrenches.T, -pull]), -weight, np.concatenate([force, a])
        )
        program.AddLinearConstraint(presses, np.zeros(len(patches)), bound, force)
        program.AddBoundingBoxConstraint(0.0, np.inf, force)
        program.AddBoundingBoxConstraint(0.0, most, a)
        program.AddLinearCost([-1.0], a)
        result = ClpSolver().Solve(program)
        if not result.is_success():
            return 0.0
        most = float(result.GetSolution(a)[0])
    return most


def friction_margin(patches: Sequence[Patch], body: Body) -> float:
    """Return the greatest friction force of all patches over the object's weight.

    For a pinch, this is the acceleration that the pads withstand across their normals,
    in units of gravity.
    """
    total = sum(patch.friction * patch.normal_force.sum() for patch in patches)
    return float(total / (body.mass * _GRAVITY))


def slip_margin(patches: Sequence[Patch]) -> float:
    """Return the least unused share of friction, 0 .. 1; 0 without contact.

    A force-torque sensor could measure it (Bicchi, Salisbury and Brock, IJRR 12:249,
    1993).
    """
    least = 1.0 if patches else 0.0
    for patch in patches:
        normal = patch.normal_force @ patch.n_W
        pressed = np.linalg.norm(normal)
        most = patch.friction * pressed
        tangential = patch.f_W - (patch.f_W @ normal) / pressed**2 * normal
        used = np.linalg.norm(tangential) / most if most else 1.0
        least = min(least, max(0.0, 1.0 - float(used)))
    return least


def _centroids(patches: Sequence[Patch]) -> list[Patch]:
    return [patch.centroid for patch in patches]


# Every measure by name: the higher, the better.
MEASURES: Mapping[str, Callable[[Sequence[Patch], Body], float]] = {
    "force closure": lambda p, b: float(wrench_space(p, b).closed),
    "epsilon, centroids": lambda p, b: wrench_space(_centroids(p), b).epsilon,
    "epsilon, patches": lambda p, b: wrench_space(p, b).epsilon,
    "epsilon, forces": lambda p, b: wrench_space(p, b, weighted=True).epsilon,
    "volume, centroids": lambda p, b: wrench_space(_centroids(p), b).volume,
    "volume, patches": lambda p, b: wrench_space(p, b).volume,
    "volume, forces": lambda p, b: wrench_space(p, b, weighted=True).volume,
    "resisted acceleration": resisted_acceleration,
    "friction margin": friction_margin,
    "slip margin": lambda p, _: slip_margin(p),
}
