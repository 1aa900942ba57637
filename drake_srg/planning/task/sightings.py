"""Where the planner's object and the others are, read from blobs."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.common.convex_pieces import ConvexPieces, Solid
from drake_srg.planning.grasps.grasps import pose_along
from drake_srg.planning.task.task_motions import Obstacles
from drake_srg.types import (
    Blob,
    Box,
    Obstacle,
    Sphere,
    Vector,
)

# Blobs further apart do not show the same object [m].
_APART = 0.03
_UP = np.array([0.0, 0.0, 1.0])


@dc.dataclass(frozen=True)
class View:
    """A look through the cameras."""

    blobs: Sequence[Blob]
    obstacles: Sequence[Obstacle] = ()  # everything that is not a known object


class Sightings:
    """Reads views for one object to take and others to keep clear of.

    Args:
        object_name: Name of the object's blobs.
        shape: The object's shape.
        others: Names and shapes of the other objects.
        upright_within: Lean up to which an object counts as standing upright [rad].
    """

    def __init__(
        self,
        object_name: str,
        shape: Solid,
        others: Mapping[str, Solid],
        upright_within: float,
    ) -> None:
        self.object_name = object_name
        self.shape = shape
        self._others = dict(others)
        self._upright = np.cos(upright_within)

    def best(
        self, view: View, rests: Callable[[RigidTransform], bool] | None = None
    ) -> Blob | None:
        """Return the most trustworthy blob of the object, None if it is not seen.

        Args:
            view: What is seen.
            rests: Tells whether the object may rest at a pose X_WO; a look-alike that
                floats, or is in the table, is something else.
        """

        def likely(blob: Blob) -> tuple[bool, bool, tuple[bool, int, bool, float]]:
            stands = rests is None or rests(self.pose(blob))
            return blob.certain, stands, blob.trust

        return max(self._own(view), key=likely, default=None)

    def nearest(self, view: View, p_WO: Vector) -> Blob | None:
        """Return the object's blob nearest to where the object is believed to be.

        Args:
            view: What is seen.
            p_WO: Where the object is believed to be, shape (3,) [m].
        """

        def distance(blob: Blob) -> float:
            return float(np.linalg.norm(blob.position - p_WO))

        return min(self._own(view), key=distance, default=None)

    def _own(self, view: View) -> list[Blob]:
        return [blob for blob in view.blobs if blob.object_name == self.object_name]

    def pose(self, blob: Blob) -> RigidTransform:
        """Return the object's pose X_WO [m]; a round one's turn has no meaning."""
        return self._pose(self.shape, blob)

    def obstacles(self, view: View, p_WO: Vector | None = None) -> Obstacles:
        """Return the other objects and the obstacles that are seen.

        Args:
            view: What is seen.
            p_WO: Where the object is believed to be, shape (3,) [m]. A look-alike
                elsewhere is an obstacle; an obstacle around this place is the object.
        """
        known = tuple(
            (shape, self._pose(shape, blob))
            for blob in view.blobs
            if (shape := self._others.get(blob.object_name)) is not None
        )
        unknown = tuple((seen.shape, seen.X_WO) for seen in view.obstacles)
        if p_WO is None:
            return (*known, *unknown)
        apart = [
            (self.shape, self.pose(blob))
            for blob in self._own(view)
            if np.linalg.norm(blob.position - p_WO) > _APART
        ]
        others = [o for o in unknown if not _inside(*o, p_WO)]
        return (*known, *apart, *others)

    def _pose(self, shape: Solid, blob: Blob) -> RigidTransform:
        # What nearly stands on something level is upright, whatever an image says.
        if isinstance(shape, Box):
            return _levelled(blob.X_WO, self._upright)
        if isinstance(shape, ConvexPieces):
            stands = blob.axis[2] >= self._upright
            return _levelled(blob.X_WO, self._upright) if stands else blob.X_WO
        stands = isinstance(shape, Sphere) or blob.axis[2] >= self._upright
        return pose_along(blob.position, _UP if stands else blob.axis)


def _inside(box: Box, X_WO: RigidTransform, p_W: Vector) -> bool:
    p_O = X_WO.inverse() @ p_W
    return bool(np.all(np.abs(p_O) <= 0.5 * np.array(box.size)))


def _levelled(X_WO: RigidTransform, upright: float) -> RigidTransform:
    """Return a box's pose, turned so that a face that is nearly level is level.

    Args:
        X_WO: The pose [m].
        upright: Cosine of the greatest angle that counts as nearly level.
    """
    R_WO = X_WO.rotation().matrix()
    axis = int(np.argmax(np.abs(R_WO[2])))
    up = np.sign(R_WO[2, axis]) * R_WO[:, axis]  # the level face's normal
    if up[2] < upright:
        return X_WO
    turn = np.cross(up, _UP)
    sine = float(np.linalg.norm(turn))
    if sine > 0.0:
        turning = AngleAxis(np.arctan2(sine, up[2]), turn / sine)
        R_WO = RotationMatrix(turning).matrix() @ R_WO
    R = RotationMatrix.ProjectToRotationMatrix(R_WO)
    return RigidTransform(R, X_WO.translation())


def lean(axis_1: Vector, axis_2: Vector) -> float:
    """Return the angle between two lines of directions (3,), 0 .. pi/2 [rad]."""
    sine = float(np.linalg.norm(np.cross(axis_1, axis_2)))
    return float(np.arctan2(sine, abs(float(axis_1 @ axis_2))))


def standing_at(X_WO: RigidTransform, shape: Solid) -> RigidTransform:
    """Return where an object now at X_WO [m] stands upright on the same level."""
    p_WO, up_O = X_WO.translation(), X_WO.rotation().matrix()[2]
    below = shape.half_extent(-up_O)
    stands = shape.half_extent(-_UP)
    return RigidTransform([*p_WO[:2], p_WO[2] - below + stands])
