"""The ways of an empty hand between picks."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from pydrake.trajectories import Trajectory

from drake_srg.planning.motion.failure import NoPathError, PlanningFailure
from drake_srg.planning.motion.moves import Moves
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.types import Vector

# Distance of a stuck hand from what it presses on: so much of an overlap is free [m].
_PRESSED = -0.02
# How far above the highest thing in a bin a hand leaves it [m].
_ABOVE = 0.03


class Ways:
    """Plans ways of an empty hand in a planning scene; holds nothing between calls.

    Args:
        scene: The arm, the gripper and the furniture.
        moves: The moves in that scene.
        q_over: High over where loads go, with the hand down, shape (N,) [rad].
    """

    def __init__(self, scene: PlanningScene, moves: Moves, q_over: Vector) -> None:
        self.scene, self._moves = scene, moves
        self.q_over = np.asarray(q_over, dtype=float)

    def plan_way(self, q_start: Vector, q_goal: Vector) -> Trajectory | PlanningFailure:
        """Plan the way between postures high above the table, shape (N,) [rad] each."""
        self.scene.SetFingers({})
        try:
            path = self._moves.joint_path(q_start, q_goal)
            return self._moves.timed(path, self._moves.free)
        except NoPathError as error:
            return error.failure

    def plan_retreat(
        self, q_start: Vector, fingers: Mapping[str, float]
    ) -> Trajectory | PlanningFailure:
        """Plan up and over the bin from where something has stopped the hand.

        Args:
            q_start: Where the arm is, at rest, shape (N,) [rad].
            fingers: Angles of the open gripper's joints by name [rad].
        """
        moves = self._moves
        self.scene.SetFingers(fingers)
        with self.scene.reaching(_PRESSED):
            rise = max((moves.tip(self.q_over) - moves.tip(q_start))[2], 0.0)
            for share in (1.0, 0.5, 0.25, 0.0):  # the arm may not get that high there
                try:
                    up = moves.straight(q_start, moves.above(q_start, share * rise))
                    across = moves.joint_path(up[-1], self.q_over)
                    return moves.timed(np.vstack([up, across[1:]]), moves.free)
                except NoPathError as error:
                    failure = error.failure
        return failure

    def plan_up(
        self, q_start: Vector, fingers: Mapping[str, float], palm: float
    ) -> Trajectory | PlanningFailure:
        """Plan straight up to where the palm is `_ABOVE` above a world z [m].

        Args:
            q_start: Where the arm is, at rest, shape (N,) [rad].
            fingers: Angles of the open gripper's joints by name [rad].
            palm: The height [m].
        """
        self.scene.SetFingers(fingers)
        rise = palm + _ABOVE - float(self.scene.X_WG(q_start).translation()[2])
        try:
            with self.scene.reaching(_PRESSED):
                up = self._moves.above(q_start, max(rise, _ABOVE))
                path = self._moves.straight(q_start, up)
            return self._moves.timed(path, self._moves.free, straight=True)
        except NoPathError as error:
            return error.failure
