"""The motions of one pick: to a grasp from above, and away with its load."""

from __future__ import annotations

import abc
import contextlib
from collections.abc import Iterator, Sequence

import numpy as np
from pydrake.math import RigidTransform
from pydrake.trajectories import Trajectory

from drake_srg.planning.clearing.columns import highest_near, standing
from drake_srg.planning.clearing.destination import Destination, Spots
from drake_srg.planning.clearing.load import Load
from drake_srg.planning.clearing.reach import turned_to
from drake_srg.planning.clearing.ways import Ways
from drake_srg.planning.grasps.top_grasp import TopGrasp
from drake_srg.planning.motion.failure import NoPathError, PlanningFailure
from drake_srg.planning.motion.inverse_kinematics import (
    IkFailure,
    solve_inverse_kinematics,
)
from drake_srg.planning.motion.limits import MotionLimits
from drake_srg.planning.motion.moves import Moves
from drake_srg.planning.motion.path_parts import STRAIGHT, PathPart
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.planning.planner_machine import PlannerConfig
from drake_srg.types import Box, HeightMap, Mode, Vector

# Margin of the hand while it is at a grasp, or between what it has set down [m]: grasps
# keep their own clearance.
TIPS = 0.0
# How far the open hand reaches around its middle. A hand that comes from the side keeps
# the middle of its pads so much higher than whatever is within that radius [m].
HAND_RADIUS, _OVER = 0.16, 0.06
_LOAD_WIDTH = 0.06  # of what hangs below the hand, as planned [m]
_NOWHERE = Spots()
_STARTS = 4  # of inverse kinematics: another grasp comes sooner than a rare posture


class ClearingMotions(Ways, abc.ABC):
    """Plans the motions of a pick in a planning scene; holds nothing between calls.

    `scene`, `q_home`, `q_over` and `destination` can be read from it.

    Args:
        scene: The arm, the gripper and the furniture.
        moves: The moves in that scene.
        q_home: Where the arm begins and ends, shape (N,) [rad].
        q_over: High over where loads go, with the hand down, shape (N,) [rad]. In
            neither posture may the arm hide the table from the cameras.
        destination: Where loads go.
        table: Height of the table [m].
        config: Distances and speeds.
    """

    def __init__(
        self,
        scene: PlanningScene,
        moves: Moves,
        q_home: Vector,
        q_over: Vector,
        *,
        destination: Destination,
        table: float,
        config: PlannerConfig,
    ) -> None:
        super().__init__(scene, moves, q_over)
        self._config = config
        self.q_home = np.asarray(q_home, dtype=float)
        self.destination = destination
        self._table = table

    def plan(
        self,
        q_start: Vector,
        grasp: TopGrasp,
        height_map: HeightMap,
        number: int = 0,
        *,
        filled: float = -np.inf,
        spots: Spots = _NOWHERE,
    ) -> dict[Mode, Trajectory] | PlanningFailure:
        """Plan from `q_start` to a grasp, and with what it takes to where that goes.

        Args:
            q_start: Where the arm is, at rest, shape (N,) [rad].
            grasp: The grasp.
            height_map: Of the table, for motions to keep clear of what is on it.
            number: Of loads that were dropped before; only bins take note of it, and
                of what follows.
            filled: World z up to which the bin may be filled [m].
            spots: Where loads that may hang from the hand are laid down, and tall ones
                set down. All others are dropped, and without spots, these, too.
        """
        try:
            return self._plan(
                np.asarray(q_start), grasp, height_map, number, filled, spots
            )
        except NoPathError as error:
            return error.failure

    def _plan(
        self,
        q_start: Vector,
        grasp: TopGrasp,
        height_map: HeightMap,
        number: int,
        filled: float,
        spots: Spots,
    ) -> dict[Mode, Trajectory]:
        q_grasp = self._reach(grasp)
        over = highest_near(height_map, grasp.p_WC, HAND_RADIUS) + _OVER
        near = self._config.approach_distance
        approach = max(near, over - float(grasp.p_WC[2]))
        load = Load.seen(self.scene.X_WG(q_grasp), grasp.p_WC, height_map, self._table)
        if grasp.wrapped:  # the palm keeps it level
            load = load.level
        load = self._with_destination(load, number, filled, spots)
        # High above the things around, the hand is out of their way. Far from its base,
        # the arm does not get that high: then the hand passes between them, if it can,
        # and draws what hangs from it in.
        for height in dict.fromkeys((approach, near)):
            try:
                to = self._approach(q_start, q_grasp, grasp, height, height_map)
                return to | self._carry(q_grasp, grasp, load, height, height_map)
            except NoPathError as error:
                failed = error
        raise failed

    def _with_destination(
        self, load: Load, number: int, filled: float, spots: Spots
    ) -> Load:
        """Return a load with what is known of where it goes; see `plan`."""
        return load

    @abc.abstractmethod
    def _carry(
        self,
        q_grasp: Vector,
        grasp: TopGrasp,
        load: Load,
        least: float,
        height_map: HeightMap,
    ) -> dict[Mode, Trajectory]:
        """Return the motions with a load, which is lifted by `least` [m] or more.

        Args:
            q_grasp: Where the arm is, shape (N,) [rad].
            grasp: The grasp.
            load: What it takes.
            least: The least height [m].
            height_map: Of the table.

        Raises:
            NoPathError: If there are none.
        """

    def _approach(
        self,
        q_start: Vector,
        q_grasp: Vector,
        grasp: TopGrasp,
        height: float,
        height_map: HeightMap,
    ) -> dict[Mode, Trajectory]:
        """Return the motions to a grasp, the last one down from `height` [m] above.

        Raises:
            NoPathError: If there are none.
        """
        scene, moves = self.scene, self._moves
        scene.SetFingers(grasp.fingers_open)
        with scene.reaching(TIPS):
            down = PathPart(
                moves.straight(q_grasp, moves.above(q_grasp, height))[::-1], STRAIGHT
            )
            lowering = moves.timed_part(down, moves.free)
        with standing(self.scene, height_map, self._table):
            to = PathPart(moves.joint_path(q_start, down.path[0]))
            approach = moves.timed_part(to, moves.free)
            motions = self._without_rest((approach, lowering), (to, down), moves.free)
        return dict(zip((Mode.PRE_GRASP, Mode.GRASP), motions, strict=True))

    def _reach(self, grasp: TopGrasp) -> Vector:
        """Return the posture of a grasp nearest to `q_over`, either finger in front.

        Raises:
            NoPathError: If the arm cannot reach it.
        """
        self.scene.SetFingers(grasp.fingers_open)
        q_guess = turned_to(self.scene, self.q_over, grasp.p_WC)
        found = []
        with self.scene.reaching(TIPS):
            for either in (grasp, grasp.half_turn()):
                ik = solve_inverse_kinematics(
                    self.scene,
                    either.target(),
                    q_nominal=self.q_over,
                    q_guess=q_guess,
                    max_starts=_STARTS,
                )
                found.append(ik)
        solved = [ik for ik in found if not isinstance(ik, IkFailure)]
        if solved:
            return min(solved, key=lambda ik: ik.cost).q
        failed = [ik for ik in found if isinstance(ik, IkFailure)]
        nearest = min(failed, key=lambda ik: ik.violation)
        raise NoPathError(PlanningFailure(nearest.failure, nearest.message))

    def _without_rest(
        self,
        apart: tuple[Trajectory, ...],
        parts: Sequence[PathPart],
        limits: MotionLimits,
    ) -> tuple[Trajectory, ...]:
        """See `Moves.without_rest`; the arm rests where `cut_corners` is not set."""
        if not self._config.cut_corners:
            return apart
        return self._moves.without_rest(apart, parts, limits, self._config.period)

    @contextlib.contextmanager
    def _loaded(self, load: Load) -> Iterator[None]:
        """Let the hand carry a box as long as there is room below the grasp."""
        length = load.below + load.sag
        box = Box([length, _LOAD_WIDTH, _LOAD_WIDTH])
        middle = RigidTransform(load.p_GC + np.array([0.5 * length, 0.0, 0.0]))
        with self.scene.holding(box, middle):
            yield
