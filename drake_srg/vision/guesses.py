"""First guesses of a solid's pose from the points of its visible surface."""

from __future__ import annotations

from collections.abc import Sequence
from operator import itemgetter

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.common.geometry import ConvexPieces, Solid
from drake_srg.types import Box, Cylinder, Sphere, Vector
from drake_srg.vision.images import narrowest_rectangle, robust_deviation
from drake_srg.vision.sight import View
from drake_srg.vision.solids import signed_distance, turn_between

# Angle between guesses [rad]. A fit finds the pose if its guess is turned by less than
# about half of this.
_TURN = np.deg2rad(30.0)
# Number of points that rank the guesses, number of steps that move a guess to these
# points, and number of guesses to fit. Few points lie on parts that make a turn
# visible, such as a handle. So if none of the guesses explains the view, as many again
# are fitted.
_POINTS, _STEPS, WORTH_A_FIT = 150, 4, 6
# Turns of the best pose, about the solid's axes and about the vertical, that may fit
# nearly as well [rad], and the number of turns about the solid's axes to fit.
_RIVAL_TURNS = np.deg2rad([-90.0, -40.0, -20.0, 20.0, 40.0, 90.0, 180.0])
_SMALL_TURNS = _RIVAL_TURNS[1:5]
_RIVALS = 12
# A pose turned by more than `_TURNED` [rad] rivals the best one if its unexplained
# share of the blob is at most `_MUCH` times the best one's plus `_MORE` (a dozen
# pixels).
_TURNED, _MUCH, _MORE = np.deg2rad(10.0), 1.2, 0.01
# Distance beyond which a point counts less [m]: it may belong to something in front.
_FAR = 0.005


def guess_pieces(
    shape: ConvexPieces, view: View, *, upright: bool = False
) -> list[RigidTransform]:
    """Return poses X_WO from which a fit may start, the likeliest first.

    Args:
        shape: The solid.
        view: The view of its blob. At least three pixels of the blob have depth.
        upright: Whether the solid's z points upwards. Otherwise, it may also rest on
            any face of its convex hull.
    """
    points = _some_points(view)
    downs = [np.array([0.0, 0.0, -1.0])]
    if not upright:
        downs += [down for down in shape.resting if down[2] > -0.99]
    guesses = [
        _settled(
            shape, RotationMatrix.MakeZRotation(yaw) @ _put_down(down), points, view
        )
        for down in downs
        for yaw in np.arange(0.0, 2 * np.pi, _TURN)
    ]
    return [X_WO for _, X_WO in sorted(guesses, key=itemgetter(0))]


def guess_rivals(
    shape: ConvexPieces, X_WO: RigidTransform, view: View
) -> list[RigidTransform]:
    """Return poses turned far from a given one that may fit about as well.

    Args:
        shape: The solid.
        X_WO: The given pose.
        view: As for `guess_pieces`.
    """
    points = _some_points(view)
    guesses = [
        _settled(
            shape,
            X_WO.rotation() @ RotationMatrix(AngleAxis(turn, axis)),
            points,
            view,
        )
        for axis in np.eye(3)
        for turn in _RIVAL_TURNS
    ]
    X_WM = RigidTransform(points.mean(axis=0))
    X_MO = X_WM.InvertAndCompose(X_WO)
    upright = [
        X_WM @ RigidTransform(RotationMatrix.MakeZRotation(turn), np.zeros(3)) @ X_MO
        for turn in _SMALL_TURNS
    ]
    return [X for _, X in sorted(guesses, key=itemgetter(0))[:_RIVALS]] + upright


def are_rivals(
    shape: ConvexPieces,
    best: tuple[float, RigidTransform],
    other: tuple[float, RigidTransform],
) -> bool:
    """Return whether another pose explains a view nearly as well as the best one.

    `best` and `other` are each a share of unexplained pixels, and a pose X_WO.
    """
    (least, X_1), (unexplained, X_2) = best, other
    return (
        unexplained <= _MUCH * least + _MORE
        and turn_between(shape, X_1.rotation(), X_2.rotation()) > _TURNED
    )


def _some_points(view: View) -> Vector:
    """Return evenly spread points of the blob, shape (n, 3), at most `_POINTS`."""
    points = view.seen
    return points[:: -(-len(points) // _POINTS)]


def _put_down(down: Vector) -> RotationMatrix:
    """Return a rotation R_WO that turns a direction in O downwards."""
    return RotationMatrix.MakeFromOneVector(-down, 2).inverse()


def _settled(
    shape: ConvexPieces, R_WO: RotationMatrix, points: Vector, view: View
) -> tuple[float, RigidTransform]:
    """Return the best pose of a given rotation, and its misfit.

    The solid starts where its extents match those of the points: the centres agree in
    the camera's x and y, the nearest points in depth. Because the points may show only
    a part, the solid then moves until its surface is near them.

    Returns:
        The mean distance of the points to the surface [m], in which far points count
        less, and the pose.
    """
    R = R_WO.matrix()
    solid, seen = shape.corners @ R.T @ view.R_WD, points @ view.R_WD
    seen_center, solid_center = (
        0.5 * (p.max(axis=0) + p.min(axis=0)) for p in (seen, solid)
    )
    offset = seen_center - solid_center
    offset[2] = np.quantile(seen[:, 2], 0.02) - solid[:, 2].min()
    p_WO = view.R_WD @ offset
    for step in range(_STEPS + 1):
        error, gradient = signed_distance(shape, (points - p_WO) @ R)
        weight = 1.0 / np.maximum(1.0, np.abs(error) / _FAR)
        if step < _STEPS:
            g = gradient @ R.T
            H = (g.T * weight) @ g + 1e-3 * len(g) * np.eye(3)
            p_WO = p_WO + np.linalg.solve(H, g.T @ (weight * error))
    misfit = float(np.mean(weight * np.abs(error)))
    return misfit, RigidTransform(R_WO, p_WO)


_UP = np.array([0.0, 0.0, 1.0])

# Least thickness of a plane through points [m], for renderers: their depth is exact.
_PLANE_THICKNESS = 5e-5
# A top that seems to lean more than this [rad] is a wrong fit and counts as level.
_MOST_LEAN = np.deg2rad(15.0)


def guess_upright(shape: Cylinder | Box | ConvexPieces, view: View) -> RigidTransform:
    """Return a pose X_WO with the solid's z upwards, from which a fit may start.

    Args:
        shape: The solid.
        view: The view of its blob. At least three pixels of the blob have depth.
    """
    points = view.seen
    if isinstance(shape, Box):
        return _standing_box(shape, points, view.noise, upright=True)
    if isinstance(shape, ConvexPieces):
        return guess_pieces(shape, view, upright=True)[0]
    forward = points.mean(axis=0) - view.origin
    forward /= np.linalg.norm(forward)
    return _cylinder(shape, points, _UP, forward, view)


def guess_poses(shape: Solid, view: View) -> list[RigidTransform]:
    """Return poses X_WO from which a fit may start.

    A box is assumed to rest on one of its faces, within 15 degrees. Convex pieces stand
    upright or rest on a face of their convex hull. A cylinder's normals are parallel or
    perpendicular to its axis. So the axis is an eigenvector of the normals' second
    moments, whichever part is visible. In case noise spoils the normals, other guesses
    take the normal of the top and the direction in which the points extend farthest.
    Either end of a cylinder may be hidden.

    Args:
        shape: The solid.
        view: The view of its blob. At least three pixels of the blob have depth.
    """
    points = view.seen
    middle = points.mean(axis=0)
    forward = (middle - view.origin) / np.linalg.norm(middle - view.origin)
    if isinstance(shape, Sphere):
        # On average, a ball's visible surface is this far before its centre.
        return [RigidTransform(middle + 2 / 3 * shape.radius * forward)]
    if isinstance(shape, Box):
        return [_box_on_a_side(shape, i, points, view.noise) for i in (2, 0, 1)]
    if isinstance(shape, ConvexPieces):
        return guess_pieces(shape, view)
    top, _, _ = fit_plane(points, 2 * shape.radius, view.noise)
    long = np.linalg.eigh(np.cov(points.T))[1][:, -1]
    normals = _normals(view)
    axes = [top, long, *np.linalg.eigh(normals.T @ normals)[1].T]
    return [
        _cylinder(shape, points, end * axis, forward, view)
        for axis in axes
        for end in (1, -1)
    ]


def _normals(view: View) -> Vector:
    """Return unit normals at pixels of the blob whose four neighbours are in it, too.

    Returns:
        In W, shape (n, 3).
    """
    known = view.blob & view.valid
    points = np.where(known[..., None], view.points, 0.0)
    right, down = (points - np.roll(points, 2, axis=k) for k in (1, 0))
    n = np.cross(right[1:-1, 2:], down[2:, 1:-1])
    n = n[known[1:-1, 2:] & known[1:-1, :-2] & known[2:, 1:-1] & known[:-2, 1:-1]]
    return n / np.maximum(np.linalg.norm(n, axis=1), 1e-12)[:, None]


def _cylinder(
    shape: Cylinder, points: Vector, axis: Vector, forward: Vector, view: View
) -> RigidTransform:
    """Return the pose of a cylinder along an axis, with its end at the points' end."""
    middle = points.mean(axis=0)
    end = np.quantile((points - middle) @ axis, 0.98)
    # On average, a cylinder's surface seen from the side is this far before its axis.
    behind = np.pi / 4 * shape.radius * (forward - (forward @ axis) * axis)
    center = middle + (end - 0.5 * shape.length) * axis + behind
    # Choose its x relative to the camera, so that the result turns with the camera.
    x = view.R_WD[:, np.argmin(np.abs(axis @ view.R_WD))]
    x = x - (x @ axis) * axis
    x /= np.linalg.norm(x)
    R_WO = RotationMatrix(np.column_stack([x, np.cross(axis, x), axis]))
    return RigidTransform(R_WO, center)


def _box_on_a_side(shape: Box, up: int, points: Vector, noise: float) -> RigidTransform:
    """Return the pose of a box whose `up`-th axis is nearly vertical."""
    order = [(up + 1) % 3, (up + 2) % 3, up]
    R_OS = RotationMatrix(np.eye(3)[:, order])
    side = Box([shape.size[i] for i in order])
    X_WS = _standing_box(side, points, noise)
    return X_WS @ RigidTransform(R_OS.inverse())


def _standing_box(
    shape: Box,
    points: Vector,
    noise: float,
    *,
    upright: bool = False,
) -> RigidTransform:
    """Return the pose of a box whose top is the plane through the topmost points."""
    normal, center, thickness = fit_plane(points, min(shape.size[:2]), noise)
    normal = _UP if upright else normal
    e1 = np.cross(_UP if abs(normal[2]) < 0.5 else [0.0, 1.0, 0.0], normal)
    basis = np.stack([e1, np.cross(normal, e1)]) / np.linalg.norm(e1)
    top = points[np.abs((points - center) @ normal) <= thickness]
    x, y, yaw = guess_rectangle((top - center) @ basis.T, shape.size)
    c, s = np.cos(yaw), np.sin(yaw)
    R = np.column_stack([basis.T @ [c, s], basis.T @ [-s, c], normal])
    position = center + np.array([x, y]) @ basis - 0.5 * shape.height * normal
    return RigidTransform(RotationMatrix(R), position)


def fit_plane(
    points: Vector, extent: float, noise: float = 0.0
) -> tuple[Vector, Vector, float]:
    """Return the nearly level plane through the topmost points.

    It starts from the highest points. Its thickness shrinks to four standard deviations
    of the points within. A patch that is too narrow to show its slope counts as level.

    Args:
        points: Shape (n, 3), n > 0, z up [m].
        extent: Size of the surface [m].
        noise: Standard deviation of the points [m].

    Returns:
        Unit normal (3,), a point of the plane (3,), half its thickness [m].
    """
    floor = max(_PLANE_THICKNESS, 4 * noise)
    steepest = np.cos(_MOST_LEAN)
    normal, thickness = _UP, max(3e-3, floor)
    center = np.array([0.0, 0.0, np.quantile(points[:, 2], 0.95)])
    for _ in range(6):
        height = (points - center) @ normal
        top = points[np.abs(height) <= thickness]
        if len(top) < 3:
            break
        center = top.mean(axis=0)
        variance, axes = np.linalg.eigh(np.cov(top.T))
        lean = axes[:, 0] * np.copysign(1.0, axes[2, 0])
        wide = variance[1] > (0.1 * extent) ** 2
        normal = lean if wide and lean[2] > steepest else _UP
        spread = robust_deviation((top - center) @ normal)
        thickness = min(thickness, max(floor, 4 * spread))
    return normal, center, thickness


def guess_rectangle(points: Vector, size: Sequence[float]) -> Vector:
    """Return a first guess (x, y, yaw) of a rectangle from points inside it.

    Args:
        points: Shape (n, 2) [m].
        size: Size of the rectangle, along its x and y [m].
    """
    middle, sides, yaw = narrowest_rectangle(points)
    if (sides[0] < sides[1]) != (size[0] < size[1]):
        yaw += np.pi / 2
    return np.array([*middle, yaw])
