"""Geometry of solids: distance to their surface, outline, symmetric poses.

Points are in the solid's own frame O. A solid consists of convex pieces; the outline of
a piece in an image is the convex hull of the images of some of its points.
"""

from __future__ import annotations

import functools
import itertools

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.common.geometry import ConvexPieces, Solid
from drake_srg.types import Box, Cylinder, Sphere, Vector

# Corners of the polygon that replaces a circle, with errors within 0.1 % of the radius.
_RIM = 72


def signed_distance(shape: Solid, p_O: Vector) -> tuple[Vector, Vector]:
    """Return the signed distance of points to a solid's surface, and its gradient.

    Args:
        shape: The solid.
        p_O: Points [m], shape (n, 3).

    Returns:
        Distances [m], negative inside, shape (n,), and unit gradients, shape (n, 3).
        Outside convex pieces, the distance is that to the plane of the nearest face.
    """
    if isinstance(shape, ConvexPieces):
        return _beyond_pieces(shape, p_O)
    if isinstance(shape, Box):
        distance, shares = _beyond(*(np.abs(p_O) - 0.5 * np.array(shape.size)).T)
        return distance, np.stack(shares, axis=1) * np.sign(p_O)
    if isinstance(shape, Sphere):
        r = np.linalg.norm(p_O, axis=1)
        return r - shape.radius, p_O / np.maximum(r, 1e-12)[:, None]
    x, y, z = p_O.T
    r = np.sqrt(x**2 + y**2)
    distance, (across, along) = _beyond(
        r - shape.radius, np.abs(z) - 0.5 * shape.length
    )
    outwards = across / np.maximum(r, 1e-12)
    gradient = np.stack([outwards * x, outwards * y, along * np.sign(z)], axis=1)
    return distance, gradient


def outline_points(shape: Solid, eye: Vector) -> list[Vector]:
    """Return points of each convex piece whose images span the piece's outline.

    Args:
        shape: The solid.
        eye: The viewpoint, in O [m], shape (3,); outside the solid.

    Returns:
        In O [m], shape (n, 3) each; one for a simple shape.
    """
    if isinstance(shape, ConvexPieces):
        return list(shape.pieces)
    if isinstance(shape, Box):
        corners = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), axis=-1).reshape(-1, 3)
        return [np.asarray(corners * shape.size)]
    angle = 2 * np.pi * np.arange(_RIM) / _RIM
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    if isinstance(shape, Cylinder):
        half = np.array([0.0, 0.0, 0.5 * shape.length])
        rim = shape.radius * circle
        return [np.concatenate([rim + half, rim - half])]
    # The visible rim of a ball is a small circle on the near side of its equator.
    distance = float(np.linalg.norm(eye))
    toward = eye / distance
    sine = shape.radius / distance
    e1 = np.cross(toward, np.eye(3)[np.argmin(np.abs(toward))])
    e1 /= np.linalg.norm(e1)
    basis = np.stack([e1, np.cross(toward, e1), toward])
    radius = shape.radius * np.sqrt(max(0.0, 1.0 - sine**2))
    return [np.asarray(shape.radius * sine * toward + radius * circle @ basis)]


def _beyond_pieces(shape: ConvexPieces, p_O: Vector) -> tuple[Vector, Vector]:
    """Return distances and gradients of the piece that is nearest to each point."""
    least = np.full(len(p_O), np.inf)
    gradient = np.zeros((len(p_O), 3))
    for (normals, offsets), (center, radius) in zip(
        shape.faces, shape.balls, strict=True
    ):
        # Pieces whose enclosing ball is farther than the nearest piece are skipped.
        near = np.flatnonzero(np.linalg.norm(p_O - center, axis=1) - radius < least)
        beyond = p_O[near] @ normals.T - offsets
        face = beyond.argmax(axis=1)
        distance = beyond[np.arange(len(near)), face]
        nearer = distance < least[near]
        least[near[nearer]] = distance[nearer]
        gradient[near[nearer]] = normals[face[nearer]]
    return least, gradient


def _beyond(*away: Vector) -> tuple[Vector, list[Vector]]:
    """Return distances to a solid from the distances beyond each pair of its faces.

    Args:
        away: Negative between the faces, shape (n,) each.

    Returns:
        The distances, shape (n,), and their derivatives by each argument, likewise.
    """
    corner = [np.maximum(beyond, 0.0) for beyond in away]
    outside = np.sqrt(sum(beyond**2 for beyond in corner))
    between = outside <= 0.0  # between all pairs of faces, the nearest pair counts
    nearest = functools.reduce(np.maximum, away)
    shares, scale = [], 1.0 / np.maximum(outside, 1e-12)
    for beyond, past in zip(away, corner, strict=True):
        own = between & (beyond == nearest)
        shares.append(np.where(own, 1.0, past * scale))
        between = between & ~own
    return np.where(outside <= 0.0, nearest, outside), shares


# Turned convex pieces look alike if their corners are within this of the surface [m].
_ALIKE = 2e-3


def least_turned(solid: Solid, X_WO: RigidTransform) -> RigidTransform:
    """Return the least rotated of the poses that look like a given one.

    For a ball, it has no rotation. For a cylinder, z points upwards, without a turn
    about it. A box has four poses that look alike, and more if it has sides of equal
    length. Convex pieces have only the given one.
    """
    R_WO = X_WO.rotation().matrix()
    match solid:
        case Sphere():
            return RigidTransform(X_WO.translation())
        case Cylinder():
            z_W = R_WO[:, 2] * np.copysign(1.0, R_WO[2, 2])
            R_WO = _turn_of_z(z_W)
        case Box(size):
            turns = _turns_onto_itself(np.array(size))
            R_WO = max((R_WO @ turn for turn in turns), key=np.trace)
    return RigidTransform(RotationMatrix(R_WO), X_WO.translation())


def turn_between(solid: Solid, R_1: RotationMatrix, R_2: RotationMatrix) -> float:
    """Return the least angle between orientations that look like two given ones [rad].

    It is 0 for a ball and the angle between the axes for a cylinder. Two orientations
    of convex pieces look alike if the corners of one are within 2 mm of the other's
    surface.
    """
    R_12 = R_1.InvertAndCompose(R_2).matrix()
    match solid:
        case Sphere():
            return 0.0
        case Cylinder():
            return _between_axes(R_12, 2, flips=True)
        case Box(size):
            turns = _turns_onto_itself(np.array(size))
        case ConvexPieces():
            turns, axis = _turns_of_pieces(solid)
            if axis is not None:
                flips = any(turn[axis, axis] < -0.5 for turn in turns)
                return _between_axes(R_12, axis, flips)
    R_12 = max((R_12 @ turn for turn in turns), key=np.trace)
    return float(RotationMatrix(R_12).ToAngleAxis().angle())


def round_axis(solid: Solid) -> int | None:
    """Return the axis (0: x) about which convex pieces or a cylinder are round."""
    match solid:
        case Cylinder():
            return 2
        case ConvexPieces():
            return _turns_of_pieces(solid)[1]
    return None


def _between_axes(R_12: Vector, axis: int, flips: bool) -> float:
    """Return the angle between two axes [rad]; with `flips`, their ends look alike."""
    sine = np.linalg.norm(np.delete(R_12[:, axis], axis))
    cosine = abs(R_12[axis, axis]) if flips else R_12[axis, axis]
    return float(np.arctan2(sine, cosine))


@functools.cache
def _turns_of_pieces(solid: ConvexPieces) -> tuple[list[Vector], int | None]:
    """Return rotations (3, 3) that map a solid onto itself, and its round axis.

    Candidates are turns about x, y and z in steps of 30 degrees. If all turns about an
    axis map the solid onto itself, it is round about that axis.
    """
    turns: list[Vector] = []
    is_round: int | None = None
    for axis in range(3):
        about = [
            RotationMatrix(AngleAxis(angle, np.eye(3)[axis])).matrix()
            for angle in np.deg2rad(range(0, 360, 30))
        ]
        kept = [turn for turn in about if _keeps(solid, turn)]
        turns += kept
        if len(kept) == len(about):
            is_round = axis
    return turns, is_round


def _keeps(solid: ConvexPieces, turn: Vector) -> bool:
    return bool(signed_distance(solid, solid.corners @ turn.T)[0].max() < _ALIKE)


def _turn_of_z(z_W: Vector) -> Vector:
    """Return the least rotation (3, 3) that takes z to a unit vector with z >= 0."""
    x, y, z = z_W
    share = 1.0 / (1.0 + z)
    return np.array(
        [
            [1.0 - share * x * x, -share * x * y, x],
            [-share * x * y, 1.0 - share * y * y, y],
            [-x, -y, z],
        ]
    )


def _turns_onto_itself(size: Vector) -> list[Vector]:
    """Return the rotations that map a box onto itself, (3, 3) each."""
    signs = [np.diag(s) for s in itertools.product((1.0, -1.0), repeat=3)]
    swaps = [np.eye(3)[list(order)] for order in itertools.permutations(range(3))]
    turns = (swap @ sign for swap in swaps for sign in signs)
    return [
        turn
        for turn in turns
        if np.linalg.det(turn) > 0 and np.array_equal(np.abs(turn) @ size, size)
    ]
