"""The motions through taught waypoints, planned at once from one sighting."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from pydrake.trajectories import Trajectory

from drake_srg.planning.motion.failure import NoPathError, PlanningFailure
from drake_srg.planning.motion.hand_target import AxisTarget, HandTarget
from drake_srg.planning.motion.inverse_kinematics import (
    IkFailure,
    solve_inverse_kinematics,
)
from drake_srg.planning.motion.moves import Moves
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.planning.taught.config import TaughtConfig
from drake_srg.types import Mode, Vector

_UP = np.array([0.0, 0.0, 1.0])
_ANGLE = 0.002  # how exactly the hand's z points up [rad]


class TaughtMotions:
    """Plans the motions P0, P1, P2, P3, P4, P0; holds nothing between calls.

    `moves`, `q_home` and `config` can be read from it.

    Args:
        scene: The arm, the gripper and the furniture.
        moves: The moves in that scene.
        q_home: P0, shape (N,) [rad].
        config: The other waypoints.

    Raises:
        ValueError: If a taught posture does not have N entries.
    """

    def __init__(
        self, scene: PlanningScene, moves: Moves, q_home: Vector, config: TaughtConfig
    ) -> None:
        for name in ("lift", "place"):
            count = len(getattr(config, name))
            if count != len(q_home):
                raise ValueError(
                    f"taught.{name}: needs one entry per joint of the arm "
                    f"({len(q_home)}), got {count}"
                )
        self._scene = scene
        self.moves = moves
        self.q_home = np.asarray(q_home, dtype=float)
        self.config = config

    def plan(self, p_WT: Vector) -> Mapping[Mode, Trajectory] | PlanningFailure:
        """Plan the motion of each mode that moves the arm.

        Args:
            p_WT: P2, where the tip grasps, shape (3,) [m].
        """
        try:
            return self._plan(p_WT)
        except NoPathError as error:
            return error.failure

    def _plan(self, p_WT: Vector) -> dict[Mode, Trajectory]:
        self._scene.SetFingers({})
        p_2 = np.asarray(p_WT)
        q_2 = self._reach(p_2, self.q_home)
        q_1 = self._reach(p_2 + np.array(self.config.approach), q_2)
        q_3, q_4 = np.array(self.config.lift), np.array(self.config.place)
        free, holding = self.moves.free, self.moves.holding
        legs = (
            (Mode.PRE_GRASP, self.q_home, q_1, free),
            (Mode.GRASP, q_1, q_2, free),
            (Mode.LIFT, q_2, q_3, holding),
            (Mode.PLACE, q_3, q_4, holding),
            (Mode.HOME, q_4, self.q_home, free),
        )
        return {
            mode: self.moves.timed(self.moves.joint_path(start, end), limits)
            for mode, start, end, limits in legs
        }

    def _reach(self, p_WT: Vector, q_nominal: Vector) -> Vector:
        """Return the posture with the tip at `p_WT` [m] and the hand's z up."""
        axis = AxisTarget(_UP, _UP, angle=_ANGLE)
        target = HandTarget(p_WT, axes=(axis,), p_GT=self.moves.p_GT)
        found = solve_inverse_kinematics(self._scene, target, q_nominal=q_nominal)
        if isinstance(found, IkFailure):
            raise NoPathError(PlanningFailure(found.failure, found.message))
        return found.q
