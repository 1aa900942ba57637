"""How fast the points of an arm move, in many postures at once."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
from pydrake.multibody.tree import Frame, Joint, RevoluteJoint
from pydrake.systems.framework import Context

from drake_srg.common.cross import cross
from drake_srg.types import Vector


@dc.dataclass(frozen=True)
class ArmChain:
    """The joints of an arm in a row, where they are if all angles are 0.

    Attributes:
        axes: Their directions in W, shape (N, 3).
        points: A point of each axis in W, and the hand's origin, shape (N + 1, 3) [m].
        turns: Which joints turn, shape (N,); the others slide.
        reach: No point of a link is farther from the line between the two points at its
            ends than this, nor a point of the hand from the hand's origin [m].
    """

    axes: Vector
    points: Vector
    turns: Vector
    reach: float

    @classmethod
    def of_joints(
        cls, joints: Sequence[Joint], hand: Frame, context: Context, reach: float
    ) -> ArmChain:
        """Return the chain of a plant's joints.

        Args:
            joints: Of one degree of freedom each, from the base to the hand.
            hand: The hand's frame.
            context: The plant's, with all angles of the arm at 0.
            reach: See the attribute.
        """
        poses = [joint.frame_on_parent().CalcPoseInWorld(context) for joint in joints]
        turns = [isinstance(joint, RevoluteJoint) for joint in joints]
        axes = [
            X_WF.rotation()
            @ (joint.revolute_axis() if turn else joint.translation_axis())
            for X_WF, joint, turn in zip(poses, joints, turns, strict=True)
        ]
        poses.append(hand.CalcPoseInWorld(context))
        points = [X_WF.translation() for X_WF in poses]
        return cls(np.array(axes), np.array(points), np.array(turns, float), reach)

    def speeds(self, path: Vector) -> Vector:
        """Return bounds on the speed of every point at both ends of a path's lines.

        Args:
            path: Postures, shape (K, N) [rad or m].

        Returns:
            Speeds at the beginning and at the end of each line, if the line takes one
            unit of time, shape (2, K - 1) [m per unit of time].
        """
        axes, points = self._placed(path)
        v = np.diff(path, axis=0).T[..., None]
        turns = self.turns[:, None, None]
        ends = []
        for at in (np.s_[:, :-1], np.s_[:, 1:]):
            # Of each link: how fast it turns, and how fast the points at its ends move.
            w = np.cumsum(turns * v * axes[at], axis=0)
            slide = np.cumsum((1.0 - turns) * v * axes[at], axis=0)
            along = cross(w, np.diff(points[at], axis=0))
            last = np.cumsum(along, axis=0) + slide
            speed = np.linalg.norm([last - along, last], axis=-1).max(axis=0)
            ends.append((speed + self.reach * np.linalg.norm(w, axis=-1)).max(axis=0))
        return np.array(ends)

    def _placed(self, q: Vector) -> tuple[Vector, Vector]:
        """Return axes (N, K, 3) and points (N + 1, K, 3) at postures (K, N), in W."""
        R, t = np.eye(3), np.zeros((len(q), 3))  # of what the joints so far move
        axes, points = [], []
        for axis, point, turns, value in zip(
            self.axes, self.points[:-1], self.turns, q.T, strict=True
        ):
            axes.append(np.broadcast_to(R @ axis, t.shape))
            points.append(R @ point + t)
            if turns:
                turned = R @ _rotations(axis, value)
                t = points[-1] - turned @ point
                R = turned
            else:
                t = t + value[:, None] * axes[-1]
        points.append(R @ self.points[-1] + t)
        return np.array(axes), np.array(points)


def _rotations(axis: Vector, angle: Vector) -> Vector:
    """Return the rotations about an axis by angles (K,), shape (K, 3, 3)."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = (f(angle)[:, None, None] for f in (np.sin, np.cos))
    return np.asarray(np.eye(3) + s * K + (1.0 - c) * (K @ K))
