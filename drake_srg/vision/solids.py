"""Geometry of the known solids: distances to their surface and points of their outline.

Points are in the solid's own frame O. The solids are convex, so a solid's outline in an
image is the convex hull of the images of some of its points.
"""

from __future__ import annotations

import functools

import numpy as np

from drake_srg.common.convex_pieces import ConvexPieces, Solid
from drake_srg.types import Box, Cylinder, Sphere, Vector

# Corners of the polygon that stands for a circle, which is within 0.1 % of the radius.
_RIM = 72


def signed_distance(shape: Solid, p_O: Vector) -> tuple[Vector, Vector]:
    """Return the signed distance of points to a solid's surface, and its gradient.

    Args:
        shape: The solid.
        p_O: Points [m], shape (n, 3).

    Returns:
        Distances [m], negative inside, shape (n,), and unit gradients, shape (n, 3).
        Outside convex pieces, it is the distance to the plane of the nearest face.
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
    """Return points of each convex piece whose images have its outline as their hull.

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
        # Planes are nearer than the piece, by no more than this for a point that far.
        near = np.flatnonzero(np.linalg.norm(p_O - center, axis=1) - radius < least)
        beyond = p_O[near] @ normals.T - offsets
        face = beyond.argmax(axis=1)
        distance = beyond[np.arange(len(near)), face]
        nearer = distance < least[near]
        least[near[nearer]] = distance[nearer]
        gradient[near[nearer]] = normals[face[nearer]]
    return least, gradient


def _beyond(*away: Vector) -> tuple[Vector, list[Vector]]:
    """Return distances from how far points are beyond each of some pairs of faces.

    Args:
        away: Negative between the faces, shape (n,) each.

    Returns:
        The distances, shape (n,), and their derivatives by each argument, likewise.
    """
    corner = [np.maximum(beyond, 0.0) for beyond in away]
    outside = np.sqrt(sum(beyond**2 for beyond in corner))
    between = outside <= 0.0  # then the nearest pair counts
    nearest = functools.reduce(np.maximum, away)
    shares, scale = [], 1.0 / np.maximum(outside, 1e-12)
    for beyond, past in zip(away, corner, strict=True):
        own = between & (beyond == nearest)
        shares.append(np.where(own, 1.0, past * scale))
        between = between & ~own
    return np.where(outside <= 0.0, nearest, outside), shares
