"""Motions of a pick that all destinations share, and motions of the empty hand."""

from __future__ import annotations

import abc
import contextlib
import dataclasses as dc
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from pydrake.math import RigidTransform
from pydrake.trajectories import Trajectory

from drake_srg.planning.clearing.destination import Destination, Spot, Spots
from drake_srg.planning.clearing.maps import (
    HAND_RADIUS,
    highest_near,
    standing,
    thing_at,
)
from drake_srg.planning.grasps.top_grasps import Reach, TopGrasp, palm_pose
from drake_srg.planning.motion.arm_model import restores_fingers
from drake_srg.planning.motion.inverse_kinematics import (
    HandTarget,
    IkFailure,
    solve_from,
    solve_inverse_kinematics,
)
from drake_srg.planning.motion.limits import MotionLimits
from drake_srg.planning.motion.moves import Moves
from drake_srg.planning.motion.planning_scene import (
    NoPathError,
    PlanningFailure,
    PlanningScene,
)
from drake_srg.planning.motion.trajectories import STRAIGHT, PathPart
from drake_srg.planning.planner_machine import PlannerConfig
from drake_srg.types import AnyMode, Box, HeightMap, Mode, Vector

# Number of starts of inverse kinematics. Trying another grasp is faster than finding a
# rare posture.
_STARTS = 4
_WITHIN = 0.01  # error of the radii of the ring that the hand reaches [m]
# At this horizontal distance from a load's place, the hand hides nothing there [m].
# These turns of the first joint are tried to get that far.
_AWAY = 0.6
_TURNS = np.deg2rad(np.arange(15.0, 180.0, 15.0))
# A load turns about the line between the pads until it hangs from them. No household
# object sinks by more than `_MOST_SAG` [m]: the hammer, held by its head, has a handle
# of 0.32 m. A part farther than `_LONG` [m] from the grasp may hang beside its former
# place.
_MOST_SAG, _LONG = 0.22, 0.1
# A step of this height separates things that touch [m]. It exceeds the noise.
_STEP = 0.015
# A load that hangs farther than this below the grasp may topple over the rim when it is
# let go above it [m].
_TALL = 0.1
# Greatest offset in x and y of the hand from the bin's middle when it lets go [m].
_ASIDE = 0.12
# A stuck hand overlaps with the thing that it presses on. This much overlap counts as
# free [m].
_PRESSED = -0.02
# Height above the highest thing in a bin at which the hand leaves [m].
_ABOVE = 0.03
# Margin of the hand at a grasp, or between things that it has set down [m]. Grasps keep
# their own clearance.
TIPS = 0.0
# A hand that comes from the side keeps the middle of its pads this much higher than
# everything within `HAND_RADIUS` [m].
_OVER = 0.06
_LOAD_WIDTH = 0.06  # planned width of the part that hangs below the hand [m]
_NOWHERE = Spots()


def turned_to(scene: PlanningScene, q: Vector, p_W: Vector) -> Vector:
    """Return a posture turned about the arm's first joint to face a place.

    This is the best start of inverse kinematics for a hand there. From a posture that
    faces elsewhere, the solver often ends with the arm bent backwards, or fails. The
    first joint must turn about the vertical.

    Args:
        scene: The arm.
        q: The posture, shape (N,) [rad].
        p_W: The place, shape (2 or 3,) [m].

    Returns:
        Shape (N,) [rad]. If the joint's limits forbid the short way, it turns the long
        way, as far as they allow.
    """
    (x, y), (x_to, y_to) = (
        p[:2] - scene.p_WA[:2] for p in (scene.X_WG(q).translation(), p_W)
    )
    turn = np.arctan2(x * y_to - y * x_to, x * x_to + y * y_to)
    turned = q[0] + turn + 2.0 * np.pi * np.array([0.0, -1.0, 1.0])
    allowed = np.clip(turned, scene.lower[0], scene.upper[0])
    first = allowed[np.argmin(abs(allowed - turned))]
    return np.array([first, *q[1:]])


def reach_with_hand_down(
    scene: PlanningScene, q_nominal: Vector, p_WG: Vector
) -> Reach | None:
    """Return the ring around the arm's first joint in which the hand can point down.

    The first joint must turn about the vertical. Obstacles do not count.

    Args:
        scene: The arm.
        q_nominal: A posture with the hand down, shape (N,) [rad].
        p_WG: A possible place of the palm, such as over the middle of the table, shape
            (3,) [m]. Only its height and its direction from the arm count.

    Returns:
        The ring; None if the hand does not reach `p_WG` itself.
    """
    away = p_WG[:2] - scene.p_WA[:2]
    middle = float(np.linalg.norm(away))
    yaw = float(np.arctan2(away[1], away[0]))

    def target(radius: float) -> HandTarget:
        p = np.array([*(scene.p_WA[:2] + radius / middle * away), p_WG[2]])
        return HandTarget.from_pose(palm_pose(p, yaw))

    in_middle = solve_inverse_kinematics(
        scene,
        target(middle),
        q_nominal=q_nominal,
        q_guess=turned_to(scene, q_nominal, p_WG),
        max_starts=_STARTS,
        check_clearance=False,
    )
    if isinstance(in_middle, IkFailure):
        return None
    ends = []
    for beyond in (0.0, float(scene.levers[0])):
        reached, missed, q = middle, beyond, in_middle.q
        while abs(missed - reached) > _WITHIN:
            between = 0.5 * (reached + missed)
            # The posture found nearby is the best start, and no other is needed.
            found = solve_from(scene, target(between), q)
            if found is None:
                missed = between
            else:
                reached, q = between, found
        ends.append(reached)
    x, y = scene.p_WA[:2]
    return Reach((float(x), float(y)), *ends)


def posture_aside(
    scene: PlanningScene, q_over: Vector, places: Sequence[Vector]
) -> Vector:
    """Return a posture over one place with the first joint turned away from all.

    It is the nearest posture with the hand far enough from every place, or else the one
    with the hand farthest from them. The first joint must turn about the vertical.

    Args:
        scene: The arm and the furniture.
        q_over: High over one of the places, shape (N,) [rad].
        places: x, y of their middles in world, shape (2,) each [m].
    """
    scene.SetFingers({})
    best, farthest = q_over, 0.0
    for turn in np.outer(_TURNS, [1.0, -1.0]).ravel():
        q = q_over.copy()
        q[0] += turn
        if not (scene.lower[0] <= q[0] <= scene.upper[0] and scene.is_free(q)):
            continue
        p_WG = scene.X_WG(q).translation()[:2]
        away = min(float(np.linalg.norm(p_WG - p)) for p in places)
        if away > _AWAY:
            return q
        if away > farthest:
            best, farthest = q, away
    return best


@dc.dataclass(frozen=True)
class HeldLoad:
    """A load in the hand, according to the map before the lift."""

    p_GC: Vector  # the grasp in the hand, shape (3,) [m]
    below: float  # how far it hangs below the grasp [m]
    sag: float  # how much lower it may hang, turned in the hand [m]
    long: bool  # it needs the whole bin
    # From the grasp to the expected middle of the level load, in the hand, (3,) [m].
    middle_G: Vector
    # From the bin's middle to the place where it is dropped, in world, shape (3,) [m].
    aside_W: Vector = dc.field(default_factory=lambda: np.zeros(3))
    piled: float = 0.0  # how far the bin's contents rise above its rim [m]
    spots: tuple[Spot, ...] = ()  # where it may be laid down, the best one first

    @property
    def may_hang(self) -> bool:
        """Whether it may hang far below the hand when it is let go."""
        return self.long and self.sag > 0.0

    @property
    def tall(self) -> bool:
        """Whether it stays level, but is so tall that it might topple over the rim."""
        return self.below > _TALL and not self.may_hang

    @property
    def expected_middle(self) -> Vector:
        """From the grasp to the best guess of its middle, in the hand, (3,) [m].

        A long load is either level or hangs below the hand. The guess is halfway
        between.
        """
        return 0.5 * self.middle_G if self.long else self.middle_G

    @property
    def level(self) -> HeldLoad:
        """The same load, if it stays level in the hand and the bin is not full."""
        return dc.replace(self, sag=0.0, piled=0.0)

    @classmethod
    def seen(
        cls, X_WG: RigidTransform, p_WC: Vector, height_map: HeightMap, table: float
    ) -> HeldLoad:
        """Return a load as a map shows it.

        Args:
            X_WG: The hand's pose at the grasp [m].
            p_WC: The grasp, shape (3,) [m].
            height_map: Height map of the table before the lift.
            table: Height of the table [m].
        """
        # Neighbours may hang from the load, but do not move its middle.
        touching = _away(height_map, table, p_WC)
        across_W = X_WG.rotation().matrix()[:2, 2]  # of the line between the pads
        hangs = float(np.max(np.abs(touching @ across_W)))
        below = max(float(p_WC[2]) - table, 0.01)
        long = bool(np.max(np.linalg.norm(touching, axis=1)) > _LONG)
        own = _away(height_map, table, p_WC, _STEP)
        middle = np.clip(0.5 * (own.min(axis=0) + own.max(axis=0)), -_ASIDE, _ASIDE)
        return cls(
            p_GC=X_WG.inverse() @ p_WC,
            below=below,
            sag=min(max(hangs - below, 0.0), _MOST_SAG),
            long=long,
            middle_G=X_WG.rotation().inverse() @ np.array([*middle, 0.0]),
        )


def _away(
    height_map: HeightMap, table: float, p_WC: Vector, step: float = np.inf
) -> Vector:
    """Return the cells of `thing_at` a grasp, relative to the grasp, (n, 2) [m]."""
    away: Vector = thing_at(height_map, table, p_WC, step) - p_WC[:2]
    return away


class ClearingMotions(abc.ABC):
    """Plans the motions of picks, and of the empty hand between them.

    It keeps no state between calls. `scene`, `q_home`, `q_over` and `destination` can
    be read from it.

    Args:
        scene: The arm, the gripper and the furniture.
        moves: The moves in that scene.
        q_home: Posture in which the arm begins and ends, shape (N,) [rad].
        q_over: Posture high over the destination, with the hand down, shape (N,) [rad].
            In neither posture may the arm hide the table from the cameras.
        destination: Destination of the loads.
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
        self.scene, self._moves, self._config = scene, moves, config
        self.q_home = np.asarray(q_home, dtype=float)
        self.q_over = np.asarray(q_over, dtype=float)
        self.destination = destination
        self._table = table

    @restores_fingers
    def plan(
        self,
        q_start: Vector,
        grasp: TopGrasp,
        height_map: HeightMap,
        number: int = 0,
        *,
        filled: float = -np.inf,
        spots: Spots = _NOWHERE,
    ) -> dict[AnyMode, Trajectory] | PlanningFailure:
        """Plan from `q_start` to a grasp, and with its load to the destination.

        Args:
            q_start: Posture of the arm, at rest, shape (N,) [rad].
            grasp: The grasp.
            height_map: Height map of the table; motions keep clear of the things on it.
            number: Number of loads that were dropped before. Only bins use it and the
                next two arguments.
            filled: World z up to which the bin may be filled [m].
            spots: Places to lay down loads that may hang from the hand, and to set down
                tall ones. Without a spot, a load is dropped.
        """
        try:
            q_grasp = self._reach(grasp)
        except NoPathError as error:
            return error.failure
        over = highest_near(height_map, grasp.p_WC, HAND_RADIUS) + _OVER
        near = self._config.approach_distance
        approach = max(near, over - float(grasp.p_WC[2]))
        X_WG = self.scene.X_WG(q_grasp)
        load = HeldLoad.seen(X_WG, grasp.p_WC, height_map, self._table)
        if grasp.wrapped:  # the palm keeps it level
            load = load.level
        load = self._with_destination(load, number, filled, spots)
        # High above the things around it, the hand cannot hit them. Far from its base,
        # the arm cannot rise that high. The hand then passes between the things, if it
        # can, and draws in the load that hangs from it.
        for height in dict.fromkeys((approach, near)):
            try:
                to = self._approach(q_start, q_grasp, grasp, height, height_map)
                return to | self._carry(q_grasp, grasp, load, height, height_map)
            except NoPathError as error:
                failure = error.failure
        return failure

    def _with_destination(
        self, load: HeldLoad, number: int, filled: float, spots: Spots
    ) -> HeldLoad:
        """Return a load, with the fields that depend on the destination; see `plan`."""
        return load

    @abc.abstractmethod
    def _carry(
        self,
        q_grasp: Vector,
        grasp: TopGrasp,
        load: HeldLoad,
        least: float,
        height_map: HeightMap,
    ) -> dict[AnyMode, Trajectory]:
        """Return the motions with a load, which is lifted by `least` [m] or more.

        Args:
            q_grasp: Posture of the arm, shape (N,) [rad].
            grasp: The grasp.
            load: The load.
            least: Least height of the lift [m].
            height_map: Height map of the table.

        Raises:
            NoPathError: If there is no such motion.
        """

    def _approach(
        self,
        q_start: Vector,
        q_grasp: Vector,
        grasp: TopGrasp,
        height: float,
        height_map: HeightMap,
    ) -> dict[AnyMode, Trajectory]:
        """Return the motions to a grasp, the last one down from `height` [m] above.

        Raises:
            NoPathError: If there is no such motion.
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
        """Return a grasp's posture nearest to `q_over`, with either finger in front.

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
        """Join motions; without `cut_corners`, the arm rests between them."""
        if not self._config.cut_corners:
            return apart
        return self._moves.without_rest(apart, parts, limits, self._config.period)

    @contextlib.contextmanager
    def _loaded(self, load: HeldLoad) -> Iterator[None]:
        """Let the hand carry a box that reaches as far down as the load may hang."""
        length = load.below + load.sag
        box = Box([length, _LOAD_WIDTH, _LOAD_WIDTH])
        middle = RigidTransform(load.p_GC + np.array([0.5 * length, 0.0, 0.0]))
        with self.scene.holding(box, middle):
            yield

    @restores_fingers
    def plan_way(self, q_start: Vector, q_goal: Vector) -> Trajectory | PlanningFailure:
        """Plan the way between postures high above the table, shape (N,) [rad] each."""
        self.scene.SetFingers({})
        try:
            path = self._moves.joint_path(q_start, q_goal)
            return self._moves.timed(path, self._moves.free)
        except NoPathError as error:
            return error.failure

    @restores_fingers
    def plan_retreat(
        self, q_start: Vector, fingers: Mapping[str, float]
    ) -> Trajectory | PlanningFailure:
        """Plan up and over the bin from where something has stopped the hand.

        Args:
            q_start: Posture of the arm, at rest, shape (N,) [rad].
            fingers: Angles of the open gripper's joints by name [rad].
        """
        moves = self._moves
        self.scene.SetFingers(fingers)
        with self.scene.reaching(_PRESSED):
            rise = max((moves.tip(self.q_over) - moves.tip(q_start))[2], 0.0)
            for share in (1.0, 0.5, 0.25, 0.0):  # the arm may not reach that high there
                try:
                    up = moves.straight(q_start, moves.above(q_start, share * rise))
                    across = moves.joint_path(up[-1], self.q_over)
                    return moves.timed(np.vstack([up, across[1:]]), moves.free)
                except NoPathError as error:
                    failure = error.failure
        return failure

    @restores_fingers
    def plan_up(
        self, q_start: Vector, fingers: Mapping[str, float], palm: float
    ) -> Trajectory | PlanningFailure:
        """Plan straight up to where the palm is `_ABOVE` above a world z [m].

        Args:
            q_start: Posture of the arm, at rest, shape (N,) [rad].
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
