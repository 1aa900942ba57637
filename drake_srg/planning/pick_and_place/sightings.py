"""Poses of the planner's object and of other objects, read from blobs."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.common.geometry import ConvexPieces, Solid
from drake_srg.planning.grasps.grasps import pose_along
from drake_srg.planning.pick_and_place.task_motions import Obstacles
from drake_srg.types import Blob, Box, Obstacle, Sphere, Vector

# Blobs farther apart do not show the same object [m].
_APART = 0.03
# A solid within this angle of resting on a face rests on it [rad].
_NEARLY_RESTS = np.deg2rad(5.0)
_UP = np.array([0.0, 0.0, 1.0])


@dc.dataclass(frozen=True, eq=False)
class PickTask:
    """An object to take, and its goal.

    Attributes:
        object_name: Name of its blobs.
        shape: Its known shape.
        goal: Its goal X_WO [m]; the rotation about z is ignored.
        tolerance: Distance from the goal that counts as placed [m].
        obstacles: Names and shapes of the other objects. Motions keep clear of them.
        repeat: Number of cycles. Every second one takes the object back to its first
            place.
    """

    object_name: str
    shape: Solid
    goal: RigidTransform
    tolerance: float = 0.005
    obstacles: Mapping[str, Solid] = dc.field(default_factory=dict)
    repeat: int = 1


@dc.dataclass(frozen=True)
class View:
    """A look through the cameras."""

    blobs: Sequence[Blob]
    obstacles: Sequence[Obstacle] = ()  # everything that is not a known object


class Sightings:
    """Finds in views the object to take, and the others to keep clear of.

    Args:
        task: The object to take, and its goal.
        upright_within: Lean up to which an object counts as standing upright [rad].
    """

    def __init__(self, task: PickTask, upright_within: float) -> None:
        self.task = task
        self._upright = np.cos(upright_within)

    def best(
        self, view: View, rests: Callable[[RigidTransform], bool] | None = None
    ) -> Blob | None:
        """Return the most trustworthy blob of the object, None if it is not seen.

        Args:
            view: Present view.
            rests: Returns whether the object may rest at a pose X_WO. A blob that
                floats, or is inside the table, is less trustworthy.
        """

        def likely(blob: Blob) -> tuple[bool, bool, tuple[bool, int, bool, float]]:
            stands = rests is None or rests(self.pose(blob))
            return blob.certain, stands, blob.trust

        return max(self._own(view), key=likely, default=None)

    def nearest(self, view: View, p_WO: Vector) -> Blob | None:
        """Return the object's blob nearest to its expected place.

        Args:
            view: Present view.
            p_WO: Expected place of the object, shape (3,) [m].
        """

        def distance(blob: Blob) -> float:
            return float(np.linalg.norm(blob.position - p_WO))

        return min(self._own(view), key=distance, default=None)

    def _own(self, view: View) -> list[Blob]:
        name = self.task.object_name
        return [blob for blob in view.blobs if blob.object_name == name]

    def pose(self, blob: Blob) -> RigidTransform:
        """Return the pose X_WO [m]; a round object's rotation is arbitrary."""
        return self._pose(self.task.shape, blob)

    def middle(self, blob: Blob) -> Vector:
        """Return the object's middle in world, shape (3,) [m]."""
        p_W: Vector = blob.X_WO @ middle_of(self.task.shape)
        return p_W

    def obstacles(self, view: View, p_WO: Vector | None = None) -> Obstacles:
        """Return the visible other objects and obstacles.

        Args:
            view: Present view.
            p_WO: Expected place of the object's middle, shape (3,) [m]. A look-alike
                elsewhere counts as an obstacle. An obstacle around this place is taken
                for the object.
        """
        known = tuple(
            (shape, self._pose(shape, blob))
            for blob in view.blobs
            if (shape := self.task.obstacles.get(blob.object_name)) is not None
        )
        unknown = tuple((seen.shape, seen.X_WO) for seen in view.obstacles)
        if p_WO is None:
            return (*known, *unknown)
        apart = [
            (self.task.shape, self.pose(blob))
            for blob in self._own(view)
            if np.linalg.norm(self.middle(blob) - p_WO) > _APART
        ]
        others = [o for o in unknown if not _inside(*o, p_WO)]
        return (*known, *apart, *others)

    def _pose(self, shape: Solid, blob: Blob) -> RigidTransform:
        # An object that nearly stands on something level is upright, even if an image
        # shows a lean.
        if isinstance(shape, Box):
            return _levelled(blob.X_WO, self._upright)
        if isinstance(shape, ConvexPieces):
            return _resting(blob.X_WO, shape)
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
    return _turned_up(X_WO, up) if up[2] >= upright else X_WO


def _resting(X_WO: RigidTransform, solid: ConvexPieces) -> RigidTransform:
    """Return a solid's pose, turned so that it rests on a face if it nearly does."""
    ups = X_WO.rotation().matrix() @ -np.array(solid.resting).T
    up = ups[:, np.argmax(ups[2])]
    return _turned_up(X_WO, up) if up[2] >= np.cos(_NEARLY_RESTS) else X_WO


def _turned_up(X_WO: RigidTransform, up: Vector) -> RigidTransform:
    """Return a pose turned by the smallest angle that points a direction upwards.

    Args:
        X_WO: The pose [m].
        up: The direction in world, a unit vector, shape (3,).
    """
    R_WO = X_WO.rotation().matrix()
    turn = np.cross(up, _UP)
    sine = float(np.linalg.norm(turn))
    if sine > 1e-12:  # less is negligible, and too small to normalize
        turning = AngleAxis(np.arctan2(sine, up[2]), turn / sine)
        R_WO = RotationMatrix(turning).matrix() @ R_WO
    R = RotationMatrix.ProjectToRotationMatrix(R_WO)
    return RigidTransform(R, X_WO.translation())


def set_down_at(
    goal: RigidTransform, X_WO: RigidTransform, shape: Solid
) -> RigidTransform:
    """Return the goal of an object that is now at X_WO [m].

    A solid of several pieces keeps its orientation, all others end with z up.

    Args:
        goal: Goal pose with its z up [m].
        X_WO: Its pose [m].
        shape: Its shape.
    """
    if not isinstance(shape, ConvexPieces):
        return goal
    below = shape.half_extent(-X_WO.rotation().matrix()[2])
    lower = shape.half_extent(-_UP)
    return RigidTransform(X_WO.rotation(), goal.translation() + (below - lower) * _UP)


def middle_of(shape: Solid) -> Vector:
    """Return the middle of an object in its frame, shape (3,) [m]."""
    return shape.middle if isinstance(shape, ConvexPieces) else np.zeros(3)


def distance(X_1: RigidTransform, X_2: RigidTransform, shape: Solid) -> float:
    """Return the distance between two poses of an object, whatever its yaw [m].

    It is the distance between its origins or between its middles, whichever is less:
    look-alike poses of a solid may have different origins.

    Args:
        X_1: A pose [m].
        X_2: Another pose [m].
        shape: The object's.
    """
    points = (np.zeros(3), middle_of(shape))
    return min(float(np.linalg.norm(X_1 @ p - X_2 @ p)) for p in points)


def lean(axis_1: Vector, axis_2: Vector) -> float:
    """Return the angle between two lines, given by directions (3,), 0 .. pi/2 [rad]."""
    sine = float(np.linalg.norm(np.cross(axis_1, axis_2)))
    return float(np.arctan2(sine, abs(float(axis_1 @ axis_2))))


def standing_at(X_WO: RigidTransform, shape: Solid) -> RigidTransform:
    """Return the pose of an object at X_WO [m], upright on the same level."""
    p_WO, up_O = X_WO.translation(), X_WO.rotation().matrix()[2]
    below = shape.half_extent(-up_O)
    stands = shape.half_extent(-_UP)
    return RigidTransform([*p_WO[:2], p_WO[2] - below + stands])
