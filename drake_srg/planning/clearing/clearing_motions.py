"""The motions of one pick: to a grasp from above, and with its load over the bin."""

from __future__ import annotations

import contextlib
import dataclasses as dc
from collections.abc import Iterator, Sequence

import numpy as np
from pydrake.math import RigidTransform
from pydrake.trajectories import Trajectory

from drake_srg.planning.clearing.columns import highest_near, standing
from drake_srg.planning.clearing.destination import Destination, Spots
from drake_srg.planning.clearing.laying import laying_targets
from drake_srg.planning.clearing.load import Load
from drake_srg.planning.clearing.reach import turned_to
from drake_srg.planning.clearing.ways import Ways
from drake_srg.planning.grasps.top_grasp import TopGrasp
from drake_srg.planning.motion.failure import NoPathError, PlanningFailure
from drake_srg.planning.motion.hand_target import HandTarget
from drake_srg.planning.motion.inverse_kinematics import (
    IkFailure,
    solve_inverse_kinematics,
)
from drake_srg.planning.motion.limits import MotionLimits
from drake_srg.planning.motion.moves import Moves
from drake_srg.planning.motion.path_parts import STRAIGHT, PathPart, joined
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.planning.task.config import PlannerConfig
from drake_srg.types import Box, HeightMap, Mode, Vector

# Margin of the hand while it is at a grasp [m]: grasps keep their own clearance.
_TIPS = 0.0
# How far the open hand reaches around its middle. A hand that comes from the side keeps
# the middle of its pads so much higher than whatever is within that radius [m].
HAND_RADIUS, _OVER = 0.16, 0.06
# Distance that the load keeps from the bin's rim [m].
_RIM = 0.03
_LOAD_WIDTH = 0.06  # of what hangs below the hand, as planned [m]
# Shares of the distance from the arm by which a load is drawn in that it cannot lift
# high enough where it is.
_DRAWN_IN = (0.15, 0.3, 0.45)
# A long load swings as it is lifted. At full speed, a hammer of 0.67 kg pulls itself
# out of the pads. Share of that speed while a load that may hang is lifted.
_GENTLE = 0.6
_NOWHERE = Spots()
_STARTS = 4  # of inverse kinematics: another grasp comes sooner than a rare posture


class ClearingMotions(Ways):
    """Plans the motions of a pick in a planning scene; holds nothing between calls.

    `scene`, `q_home`, `q_over` and `destination` can be read from it.

    Args:
        scene: The arm, the gripper, the furniture and the bin.
        moves: The moves in that scene.
        q_home: Where the arm begins and ends, shape (N,) [rad].
        q_over: High over the bin, with the hand down, shape (N,) [rad]. In neither
            posture may the arm hide the table from the cameras.
        destination: The bin.
        table: Height of the table [m].
        rim: Height of the bin's rim [m].
        aside: From the bin's middle to where every third load is dropped, and to the
            other side for the one after it, shape (2,) [m]: things do not pile up.
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
        rim: float,
        aside: Vector,
        config: PlannerConfig,
    ) -> None:
        super().__init__(scene, moves, q_over)
        self._config = config
        self.q_home = np.asarray(q_home, dtype=float)
        self.destination = destination
        self._table, self._rim = table, rim
        self._aside = np.array([*aside, 0.0])

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
        """Plan from `q_start` to a grasp, and with what it takes over the bin.

        Args:
            q_start: Where the arm is, at rest, shape (N,) [rad].
            grasp: The grasp.
            height_map: Of the table, for motions to keep clear of what is on it.
            number: Of loads that were dropped before.
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
        side = 0 if load.long else (number + 1) % 3 - 1
        load = dc.replace(
            load,
            aside_W=side * self._aside,
            piled=max(filled - self._rim, 0.0),
            spots=spots.tall if load.tall else spots.long if load.may_hang else (),
        )
        # High above the things around, the hand is out of their way. Far from its base,
        # the arm does not get that high: then the hand passes between them, if it can,
        # and draws what hangs from it in.
        for height in dict.fromkeys((approach, near)):
            try:
                to = self._approach(q_start, q_grasp, grasp, height, height_map)
            except NoPathError as error:
                failed = error
                continue
            for lifted in (load, load.level):
                try:
                    return to | self._carry(
                        q_grasp, grasp, load, height, height_map, lifted
                    )
                except NoPathError as error:
                    failed = error
        raise failed

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
        with scene.reaching(_TIPS):
            down = PathPart(
                moves.straight(q_grasp, moves.above(q_grasp, height))[::-1], STRAIGHT
            )
            lowering = moves.timed_part(down, moves.free)
        with standing(self.scene, height_map, self._table):
            to = PathPart(moves.joint_path(q_start, down.path[0]))
            approach = moves.timed_part(to, moves.free)
            motions = self._without_rest((approach, lowering), (to, down), moves.free)
        return dict(zip((Mode.PRE_GRASP, Mode.GRASP), motions, strict=True))

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

    def _carry(
        self,
        q_grasp: Vector,
        grasp: TopGrasp,
        load: Load,
        least: float,
        height_map: HeightMap,
        lifted: Load,
    ) -> dict[Mode, Trajectory]:
        """Return the motions with the load, which is lifted by `least` [m] or more.

        It is lifted as high as `lifted` needs, and let go as `load` needs.

        Raises:
            NoPathError: If there are none.
        """
        scene, moves = self.scene, self._moves
        rise = self._rim + lifted.piled + lifted.sag + _RIM - self._table
        scene.SetFingers(grasp.fingers_closed)
        with scene.reaching(_TIPS):
            path = moves.straight(q_grasp, moves.above(q_grasp, max(least, rise)))
            up = PathPart(path, STRAIGHT)
            lifting = moves.timed_part(up, self._lifting(load))
        with standing(scene, height_map, self._table, taken=grasp.p_WC):
            return self._into_bin(up, lifting, grasp, load, lifted)

    def _lifting(self, load: Load) -> MotionLimits:
        """Return the limits of motions that lift a load."""
        limits = self._moves.holding
        return limits.scaled(_GENTLE, _GENTLE**2) if load.may_hang else limits

    def _drawn_in(self, q: Vector, load: Load) -> Vector:
        """Return the way up and towards the arm's first joint from `q`, (k, N) [rad].

        Raises:
            NoPathError: If the arm cannot go there.
        """
        X_WG = self.scene.X_WG(q)
        away = (X_WG.translation() - self.scene.p_WA) * [1.0, 1.0, 0.0]
        up = np.array([0.0, 0.0, load.sag + load.piled])
        for share in _DRAWN_IN:
            target = HandTarget.from_pose(X_WG).shifted(up - share * away)
            try:
                path: Vector = self._moves.straight(q, target)
            except NoPathError as error:
                failed = error
            else:
                return path
        raise failed

    def _reach(self, grasp: TopGrasp) -> Vector:
        """Return the posture of a grasp nearest to `q_over`, either finger in front.

        Raises:
            NoPathError: If the arm cannot reach it.
        """
        self.scene.SetFingers(grasp.fingers_open)
        q_guess = turned_to(self.scene, self.q_over, grasp.p_WC)
        found = []
        with self.scene.reaching(_TIPS):
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

    def _into_bin(
        self,
        up: PathPart,
        lifting: Trajectory,
        grasp: TopGrasp,
        load: Load,
        lifted: Load,
    ) -> dict[Mode, Trajectory]:
        """Return the motions with a load along `up` and on to where it is let go.

        The load's middle is over the bin's or beside that, and just above its rim and
        whatever is in it, or as far above as the hand is at `q_over`. It is dropped
        there. Where `load.spots` has a place that the arm reaches, it is laid or set
        down there instead.

        Raises:
            NoPathError: If the arm cannot go there.
        """
        X_WG, moves = self.scene.X_WG(self.q_over), self._moves
        palm = float(grasp.X_WG.translation()[2]) - self._table
        least = self._rim + load.piled + load.sag + _RIM + palm
        high = min(float(X_WG.translation()[2]), least)
        for spot in load.spots:
            begin, *others = laying_targets(X_WG, load, palm, spot, high)
            with contextlib.suppress(NoPathError):
                carried, q_begin = self._carried(up, lifting, begin, load, lifted)
                with self.scene.reaching(_TIPS):
                    down = moves.through(q_begin, others)
                    laying = moves.timed(down, moves.holding)
                return carried | {Mode.PLACE: laying}
        aside = load.aside_W - X_WG.rotation() @ load.expected_middle
        lower = float(X_WG.translation()[2]) - high
        place = HandTarget.from_pose(X_WG).shifted(np.array([*aside[:2], -lower]))
        return self._carried(up, lifting, place, load, lifted)[0]

    def _carried(
        self,
        up: PathPart,
        lifting: Trajectory,
        place: HandTarget,
        load: Load,
        lifted: Load,
    ) -> tuple[dict[Mode, Trajectory], Vector]:
        """Return the motions with a load to a place, and their end, shape (N,) [rad].

        Args:
            up: The line on which it is lifted.
            lifting: The motion along that line, which ends at rest.
            place: Where it is let go, or the way down begins.
            load: The load.
            lifted: The load as it must clear what is below it as it is lifted.

        Raises:
            NoPathError: If the arm cannot go there.
        """
        moves, q = self._moves, up.path[-1]
        with self._loaded(lifted):
            over = moves.straight(self.q_over, place)[-1]
            drawn = q[np.newaxis] if lifted is load else self._drawn_in(q, load)
            with self._loaded(load):
                across = PathPart(moves.joint_path(drawn[-1], over))
            if lifted is not load:
                lift = joined([up, PathPart(drawn)])
                lifting = moves.timed_part(lift, self._lifting(load))
            motions = (lifting, moves.timed_part(across, moves.holding))
            if lifted is load and not load.may_hang:
                motions = self._without_rest(motions, (up, across), moves.holding)
        return dict(zip((Mode.LIFT, Mode.TRANSFER), motions, strict=True)), over

    @contextlib.contextmanager
    def _loaded(self, load: Load) -> Iterator[None]:
        """Let the hand carry a box as long as there is room below the grasp."""
        length = load.below + load.sag
        box = Box([length, _LOAD_WIDTH, _LOAD_WIDTH])
        middle = RigidTransform(load.p_GC + np.array([0.5 * length, 0.0, 0.0]))
        with self.scene.holding(box, middle):
            yield
