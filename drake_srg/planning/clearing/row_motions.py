"""The motions of a pick that sets its load down where it belongs, as it stood."""

from __future__ import annotations

import numpy as np
from pydrake.trajectories import Trajectory

from drake_srg.planning.clearing.clearing_motions import TIPS, ClearingMotions
from drake_srg.planning.clearing.columns import standing
from drake_srg.planning.clearing.destination import Destination
from drake_srg.planning.clearing.load import Load
from drake_srg.planning.grasps.top_grasp import TopGrasp
from drake_srg.planning.motion.hand_target import HandTarget
from drake_srg.planning.motion.moves import Moves
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.planning.planner_machine import PlannerConfig
from drake_srg.types import HeightMap, Mode, Vector

# Height above its support at which a thing is let go [m].
_ABOVE = 0.002
# Distance from the place within which all of a thing is [m]: the least spacing of
# things that the hand takes, so that neighbours do not count.
_AROUND = 0.06


def row_destination(p_WO: Vector) -> Destination:
    """Return where a thing with its middle at a place of the row is, (3,) [m]."""
    return Destination(p_WO[:2] - _AROUND, p_WO[:2] + _AROUND, float(p_WO[2]))


class RowMotions(ClearingMotions):
    """Plans picks of things that are set down at a place, as they stood before.

    The hand points down all the way and turns about the vertical only.

    Args:
        scene: The arm, the gripper and the furniture.
        moves: The moves in that scene.
        q_home: Where the arm begins and ends, shape (N,) [rad].
        q_over: High over the row, with the hand down as it sets things down, (N,)
            [rad]. Neither posture may hide the table from the cameras.
        table: Height of the table [m].
        place: Where the thing's middle must be, on its support, shape (3,) [m].
        config: Distances and speeds.
    """

    def __init__(
        self,
        scene: PlanningScene,
        moves: Moves,
        q_home: Vector,
        q_over: Vector,
        *,
        table: float,
        place: Vector,
        config: PlannerConfig,
    ) -> None:
        super().__init__(
            scene,
            moves,
            q_home,
            q_over,
            destination=row_destination(place),
            table=table,
            config=config,
        )
        self._place = np.asarray(place, dtype=float)

    def _carry(
        self,
        q_grasp: Vector,
        grasp: TopGrasp,
        load: Load,
        least: float,
        height_map: HeightMap,
    ) -> dict[Mode, Trajectory]:
        """See `ClearingMotions`; the way with the load ends where it is set down."""
        scene, moves = self.scene, self._moves
        scene.SetFingers(grasp.fingers_closed)
        with scene.reaching(TIPS):
            up = moves.straight(q_grasp, moves.above(q_grasp, least))
            lifting = moves.timed(up, moves.holding, straight=True)
        X_WG = scene.X_WG(self.q_over)
        p_WG = X_WG.translation()
        middle = X_WG.rotation() @ load.middle_G
        level = np.array([*(self._place - p_WG - middle)[:2], 0.0])
        over = HandTarget.from_pose(X_WG).shifted(level)
        palm = float(grasp.X_WG.translation()[2]) - self._table  # above the support
        lower = float(p_WG[2] - self._place[2]) - palm - _ABOVE
        down = over.shifted(np.array([0.0, 0.0, -lower]))
        with standing(scene, height_map, self._table, taken=grasp.p_WC):
            with self._loaded(load.level):
                goal = moves.straight(self.q_over, over)[-1]
                across = moves.joint_path(up[-1], goal)
                crossing = moves.timed(across, moves.holding)
            with scene.reaching(TIPS):
                lowering = moves.timed(
                    moves.straight(goal, down), moves.holding, straight=True
                )
        return {Mode.LIFT: lifting, Mode.TRANSFER: crossing, Mode.PLACE: lowering}
