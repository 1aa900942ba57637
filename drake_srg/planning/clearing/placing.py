"""The motions of picks whose load goes into a bin, or to its place in a row."""

from __future__ import annotations

import contextlib
import dataclasses as dc

import numpy as np
from pydrake.math import RigidTransform
from pydrake.trajectories import Trajectory

from drake_srg.planning.clearing.destination import Destination, Spot, Spots
from drake_srg.planning.clearing.maps import standing
from drake_srg.planning.clearing.motions import TIPS, ClearingMotions, HeldLoad
from drake_srg.planning.grasps.top_grasps import TopGrasp
from drake_srg.planning.motion.inverse_kinematics import HandTarget
from drake_srg.planning.motion.limits import MotionLimits
from drake_srg.planning.motion.planning_scene import NoPathError
from drake_srg.planning.motion.trajectories import STRAIGHT, PathPart, joined
from drake_srg.types import AnyMode, HeightMap, Mode, Vector

# A load is let go this high above everything below it [m]: more than it sags in the
# fingers, but low enough to fall softly.
_ABOVE = 0.02
# Angles of the load on its way from hanging to lying [rad].
_ANGLES = np.deg2rad([0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0])
# Distance that the load keeps from the bin's rim [m].
_RIM = 0.03
# Of three loads, one is dropped in the bin's middle, and the others this far to
# either side along it, as a share of its length, so that they do not pile up.
_ASIDE = 0.22
# If the arm cannot lift a load high enough, it draws the load in by these shares of
# the distance.
_DRAWN_IN = (0.15, 0.3, 0.45)
# Share of the full speed at which a load that may hang is lifted. A long load swings:
# at full speed, a hammer of 0.67 kg pulls itself out of the pads.
_GENTLE = 0.6
# Height above its support at which a thing is let go [m].
_ABOVE_PLACE = 0.002
# Radius around a place that contains the whole thing, but no neighbours [m]: the least
# spacing at which the hand can take things.
_AROUND = 0.06


def laying_targets(
    X_WG: RigidTransform, load: HeldLoad, palm: float, spot: Spot, high: float
) -> list[HandTarget]:
    """Return the poses through which the hand lays a load down, the highest first.

    Two pads are a hinge: a long load may hang from them. Dropped like that, it would
    land on one end and topple to any side, perhaps over the rim. So the hand first goes
    straight down until the load stands on its hanging end. Then it moves on an arc
    around that end, until the load lies as it lay on the table. A load that is still
    level ends at the same place. A load that cannot hang goes straight down.

    Args:
        X_WG: The hand over the middle of the bin, as it drops things.
        load: The load.
        palm: Height of the palm above the underside of a level load [m].
        spot: Place where it must lie.
        high: World z of the palm at which the hanging load clears the rim [m].
    """
    middle_W = X_WG.rotation() @ load.middle_G
    outward = np.sign(load.middle_G[2]) * X_WG.rotation().col(2)[:2]
    p_W = X_WG.translation() + spot.aside_W - middle_W
    lying = np.array([*p_W[:2], spot.ground + _ABOVE + palm])
    angles = _ANGLES if load.sag > 0.0 else _ANGLES[-1:]
    arc = lying + load.sag * np.column_stack(
        [np.outer(1.0 - np.sin(angles), outward), np.cos(angles)]
    )
    begin = [*arc[0, :2], max(high, arc[0, 2])]
    return [HandTarget(p_W, X_WG.rotation()) for p_W in (np.array(begin), *arc)]


class BinMotions(ClearingMotions):
    """Plans picks of things that go into a bin: a destination with a rim."""

    def _with_destination(
        self, load: HeldLoad, number: int, filled: float, spots: Spots
    ) -> HeldLoad:
        """Return a load, with the fields that depend on the bin; see `plan`.

        Loads go to the middle of the bin and to either side in turn.
        """
        size = self.destination.high - self.destination.low
        aside = _ASIDE * np.where(size == size.max(), size, 0.0)
        side = 0 if load.long else (number + 1) % 3 - 1
        return dc.replace(
            load,
            aside_W=side * np.array([*aside, 0.0]),
            piled=max(filled - self._rim, 0.0),
            spots=spots.tall if load.tall else spots.long if load.may_hang else (),
        )

    @property
    def _rim(self) -> float:
        """Height of the bin's rim [m]."""
        assert self.destination.rim is not None, "a bin has a rim"
        return self.destination.rim

    def _carry(
        self,
        q_grasp: Vector,
        grasp: TopGrasp,
        load: HeldLoad,
        least: float,
        height_map: HeightMap,
    ) -> dict[AnyMode, Trajectory]:
        """Return the motions with a load, which is lifted by `least` [m] or more.

        A load that cannot be lifted so high is assumed to stay level.
        """
        scene, moves = self.scene, self._moves
        for lifted in (load, load.level):
            rise = self._rim + lifted.piled + lifted.sag + _RIM - self._table
            scene.SetFingers(grasp.fingers_closed)
            try:
                with scene.reaching(TIPS):
                    above = moves.above(q_grasp, max(least, rise))
                    up = PathPart(moves.straight(q_grasp, above), STRAIGHT)
                    lifting = moves.timed_part(up, self._lifting(load))
                with standing(scene, height_map, self._table, taken=grasp.p_WC):
                    return self._into_bin(up, lifting, grasp, load, lifted)
            except NoPathError as error:
                failed = error
        raise failed

    def _lifting(self, load: HeldLoad) -> MotionLimits:
        """Return the limits of motions that lift a load."""
        limits = self._moves.holding
        return limits.scaled(_GENTLE, _GENTLE**2) if load.may_hang else limits

    def _drawn_in(self, q: Vector, load: HeldLoad) -> Vector:
        """Return the path up and towards the arm's first joint from `q`, (k, N) [rad].

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

    def _into_bin(
        self,
        up: PathPart,
        lifting: Trajectory,
        grasp: TopGrasp,
        load: HeldLoad,
        lifted: HeldLoad,
    ) -> dict[AnyMode, Trajectory]:
        """Return the motions with a load along `up` and on to the place of its release.

        The load is dropped with its middle over the bin's, or to one side of it. It is
        then just above the rim and the contents, or as high as the hand at `q_over`. If
        the arm reaches a place in `load.spots`, the load is laid or set down there
        instead.

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
                with self.scene.reaching(TIPS):
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
        load: HeldLoad,
        lifted: HeldLoad,
    ) -> tuple[dict[AnyMode, Trajectory], Vector]:
        """Return the motions with a load to a place, and their end, shape (N,) [rad].

        Args:
            up: The line on which it is lifted.
            lifting: The motion along that line, which ends at rest.
            place: The hand where it lets go, or where the way down begins.
            load: The load.
            lifted: The load as assumed for the height of the lift.

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


def row_destination(p_WO: Vector) -> Destination:
    """Return the destination of a thing at a place of the row, (3,) [m]."""
    return Destination(p_WO[:2] - _AROUND, p_WO[:2] + _AROUND, np.asarray(p_WO, float))


class RowMotions(ClearingMotions):
    """Plans picks of things that are set down at a place, as they stood before.

    The hand points down all the way and turns about the vertical only. Its destination
    is a `row_destination`; for the other arguments see `ClearingMotions`.
    """

    def _carry(
        self,
        q_grasp: Vector,
        grasp: TopGrasp,
        load: HeldLoad,
        least: float,
        height_map: HeightMap,
    ) -> dict[AnyMode, Trajectory]:
        """Return the motions with a load, which is lifted by `least` [m] or more.

        The path with the load ends where it is set down.
        """
        scene, moves = self.scene, self._moves
        scene.SetFingers(grasp.fingers_closed)
        with scene.reaching(TIPS):
            up = moves.straight(q_grasp, moves.above(q_grasp, least))
            lifting = moves.timed(up, moves.holding, straight=True)
        place, X_WG = self.destination.place, scene.X_WG(self.q_over)
        assert place is not None, "a row has places"
        p_WG = X_WG.translation()
        middle = X_WG.rotation() @ load.middle_G
        level = np.array([*(place - p_WG - middle)[:2], 0.0])
        over = HandTarget.from_pose(X_WG).shifted(level)
        palm = float(grasp.X_WG.translation()[2]) - self._table  # above the support
        lower = float(p_WG[2] - place[2]) - palm - _ABOVE_PLACE
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
