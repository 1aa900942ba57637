"""The motions of a push, and back over the bin."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from pydrake.trajectories import Trajectory

from drake_srg.planning.clearing.columns import highest_near
from drake_srg.planning.clearing.pushing import Push, best_push
from drake_srg.planning.clearing.reach import turned_to
from drake_srg.planning.grasps.fingers import Fingers
from drake_srg.planning.grasps.relief import Relief
from drake_srg.planning.grasps.top_grasp import palm_pose
from drake_srg.planning.grasps.top_grasp_search import Reach
from drake_srg.planning.motion.failure import NoPathError
from drake_srg.planning.motion.hand_target import HandTarget
from drake_srg.planning.motion.inverse_kinematics import (
    IkSolution,
    solve_inverse_kinematics,
)
from drake_srg.planning.motion.moves import Moves
from drake_srg.planning.motion.path_parts import STRAIGHT, PathPart
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.types import HeightMap, Vector

_OVER = 0.06  # height of the hand's ends above everything on the way there [m]
_STARTS = 4  # of inverse kinematics


class PushMotions:
    """Plans pushes in a planning scene; holds nothing between calls.

    Args:
        scene: The arm, the gripper, the furniture and the bin.
        moves: The moves in that scene.
        q_over: High over the bin, shape (N,) [rad].
        fingers: The gripper's.
        table: Height of the table [m].
        reach: Where the hand can be; None for everywhere.
        relief: Returns what stands on the table according to a height map.
        period: Of the planner [s]; None: the arm rests between all motions.
    """

    def __init__(
        self,
        scene: PlanningScene,
        moves: Moves,
        q_over: Vector,
        *,
        fingers: Fingers,
        table: float,
        reach: Reach | None,
        relief: Callable[[HeightMap], Relief],
        period: float | None,
    ) -> None:
        self._scene, self._moves, self._q_over = scene, moves, q_over
        self._fingers, self._table = fingers, table
        self._reach, self._relief = reach, relief
        self._period = period

    def plan(
        self, q_start: Vector, height_map: HeightMap, tried: Sequence[Push] = ()
    ) -> tuple[Push, tuple[Trajectory, ...]] | None:
        """Plan to a heap, through its top, and over the bin; None without a way.

        Args:
            q_start: Where the arm is, at rest, shape (N,) [rad].
            height_map: Of the table.
            tried: See `best_push`.
        """
        push = best_push(self._relief(height_map), self._table, self._reach, tried)
        if push is None:
            return None
        moves = self._moves
        up = np.array([0.0, 0.0, self._fingers.deepest])
        # Broadside first.
        for yaw in (push.yaw + 0.5 * np.pi, push.yaw - 0.5 * np.pi, push.yaw):
            self._scene.SetFingers(self._fingers.closed(0.0).joints)
            start, end = (
                HandTarget.from_pose(palm_pose(p + up, yaw))
                for p in (push.start_W, push.end_W)
            )
            ik = solve_inverse_kinematics(
                self._scene,
                start,
                q_nominal=self._q_over,
                q_guess=turned_to(self._scene, self._q_over, push.start_W),
                max_starts=_STARTS,
            )
            if not isinstance(ik, IkSolution):
                continue
            highest = highest_near(height_map, push.start_W, np.inf)
            rise = highest + _OVER - push.start_W[2]
            try:
                down = moves.straight(ik.q, moves.above(ik.q, rise))[::-1]
                across = moves.straight(ik.q, end)
                away = moves.straight(across[-1], moves.above(across[-1], rise))
                to = PathPart(moves.joint_path(q_start, down[0]))
                back = PathPart(moves.joint_path(away[-1], self._q_over))
                return push, (
                    *self._free(to, PathPart(down, STRAIGHT)),
                    moves.timed(across, moves.holding, straight=True),
                    *self._free(PathPart(away, STRAIGHT), back),
                )
            except NoPathError:
                continue
        return None

    def _free(self, *parts: PathPart) -> tuple[Trajectory, ...]:
        """Return the motions of an empty hand along parts of a path.

        Raises:
            NoPathError: If there are none.
        """
        moves = self._moves
        apart = tuple(moves.timed_part(part, moves.free) for part in parts)
        if self._period is None:
            return apart
        return moves.without_rest(apart, parts, moves.free, self._period)
